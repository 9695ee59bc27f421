//! A job as text for people.

use umi_protocol::job::{
    Approach, Compensation, CorrectionSpec, Dialect, FeatureSpec, Job, Lessons, ProgramEnd,
    Reference, SendWhen, Teach, WitnessSpec,
};
use umi_protocol::latch::SignalLevel;
use umi_protocol::pattern::{
    Coding, FieldFormat, Handshake, LinePattern, Overflow, ReceiverConfig,
};
use umi_protocol::program::Withheld;
use umi_protocol::serial::Cts;

use crate::show::terminal::{CAUTION, FAINT, TITLE, Table, count, fixed, one_line, paint};
use serde_json::{Value, json};
use umi_client::job::guards::{ASSUMED_RADIUS_MM, GuardTable, SeenFrom};
use umi_core::correction::dialect::{form, is_read_back};
use umi_core::job::{judges_touches, moves_something};

/// What a job probes, judges and sends.
#[must_use]
pub fn text(job: &Job) -> String {
    let mut text = format!(
        "{}\n",
        paint(TITLE, format_args!("job {}", one_line(&job.name)))
    );
    let mut general = Table::new("<<");
    general.row([
        "reference",
        match job.reference {
            Reference::Given => "positions given in the job",
            Reference::Taught if job.teach == Teach::Asked => "taught when asked for",
            Reference::Taught => "taught: the first setup that keeps all limits",
        },
    ]);
    general.row([
        "setup given up after",
        &format!("{} s without a hit", job.plate_timeout_s),
    ]);
    general.row(["compensation", &compensation(job.compensation)]);
    let line = job.line.settings();
    let cts = match line.cts {
        Cts::AsWired => "CTS where the board has it",
        Cts::Ignored => "without CTS",
        Cts::Followed => "with CTS",
    };
    let said = format!("{} baud, {}, {cts}", line.baud, line.frame());
    general.row(["line to the control", &said]);
    receiver(&mut general, &job.receiver);
    if let Some(of) = &job.witness {
        for (number, said) in witness(of).iter().enumerate() {
            let title = if number == 0 { "second witness" } else { "" };
            general.row([title, said]);
        }
    }
    if judges_touches(job) {
        let skip = &job.skip;
        let rests = match skip.active {
            SignalLevel::High => "low",
            SignalLevel::Low => "high",
        };
        let said = format!(
            "rests {rests} for {} ms before a touch; narrower than {} us is a spark; {} us late",
            skip.hold_off_ms(),
            skip.min_width_us(),
            skip.delay_us
        );
        general.row(["skip line", &said]);
        if skip.each_hit {
            general.row(["", "a hit that is printed without a touch is refused"]);
        }
    }
    text += &format!("{general}\n");
    text += &format!("{}\n", features(job));
    text += &format!("{}\n", limits(job));
    text += &match &job.correction {
        Some(spec) => correction(spec).to_string(),
        None if moves_something(job) => {
            "  no correction; programs are rewritten as probed in G54\n".to_owned()
        }
        None => "  no correction: the job only measures\n".to_owned(),
    };
    for note in notes(job) {
        text += &format!("\n{}\n", paint(CAUTION, wrapped(&note.message)));
    }
    text
}

/// What somebody must know who takes this job.
pub struct Note {
    /// Its stable name.
    code: &'static str,
    /// The sentence.
    message: String,
}

/// All that is told of a job beside its tables: what is not guarded, and what must fit to it.
#[must_use]
pub fn notes(job: &Job) -> Vec<Note> {
    let mut notes = Vec::new();
    let mut note = |code, message: String| notes.push(Note { code, message });
    if job.correction.is_some() && !has_alarm(job) {
        let said = "a READ without an OK verdict gets nothing: this control has no word that \
                    raises an alarm";
        note("read_gets_nothing", said.to_owned());
    }
    if let Some((code, said)) = other_count(job) {
        note(code, said);
    }
    for (code, said) in job
        .correction
        .iter()
        .flat_map(|spec| of_correction(job, spec))
    {
        note(code, said.to_owned());
    }
    if let Some(open) = umi_core::job::not_guarded(job) {
        note(open.code(), open.to_string());
    }
    notes
}

/// What a correction's end and its way to the control leave open.
fn of_correction(job: &Job, spec: &CorrectionSpec) -> Vec<(&'static str, &'static str)> {
    let mut said = Vec::new();
    let has_parity = job.line.settings().data_bits == 7
        || !matches!(job.receiver.coding, Coding::Auto | Coding::Ascii);
    if has_parity && !is_read_back(spec.dialect) {
        said.push((
            "parity_sees_half",
            "parity sees 25 of the 45 ways in which one digit of the correction becomes another on \
             its way to the control: a dialect that reads back what is stored sees all",
        ));
    }
    if spec.ends_with == ProgramEnd::M30 && form(spec.dialect).turn_ends_with_program {
        said.push((
            "end_takes_the_turn",
            "ends_with = \"M30\" resets the control, and the correction's rotation with it: only the \
             offset stays. Say ends_with = \"M99\" and call it from the part program",
        ));
    }
    said
}

/// The notes for machines: those of the job, and what its table of guards assumes.
#[must_use]
pub fn notes_json(job: &Job, table: Option<&GuardTable>) -> Value {
    let of_table = table.map_or_else(Vec::new, |table| guard_notes(table, job.guards.frame));
    let all = notes(job).into_iter().chain(of_table);
    all.map(|note| json!({ "code": note.code, "message": note.message }))
        .collect()
}

/// Characters of a line of a note, at most.
const NOTE_WIDTH: usize = 77;

/// A sentence in lines, two blanks before each.
fn wrapped(sentence: &str) -> String {
    let mut text = String::new();
    let mut room = 0;
    for word in sentence.split(' ') {
        let length = word.chars().count() + 1;
        if length > room {
            text += if text.is_empty() { "  " } else { "\n  " };
            room = NOTE_WIDTH;
        } else {
            text += " ";
        }
        text += word;
        room -= length.min(room);
    }
    text
}

/// Where the job compares another variable than the macros of hw/control count runs in.
fn other_count(job: &Job) -> Option<(&'static str, String)> {
    let (variable, dialect) = (job.guards.run_variable?, job.correction?.dialect);
    let (ours, theirs) = match dialect {
        Dialect::Siemens => (None, "R"),
        Dialect::Heidenhain => (None, "QR"),
        Dialect::LinuxCnc => (Some(4531), "#"),
        _ => (Some(531), "#"),
    };
    match ours {
        Some(ours) if ours == variable => None,
        Some(ours) => Some((
            "other_run_variable",
            format!(
                "runs are compared in #{variable}, and hw/control counts them in #{ours}: change \
                 one of them, or each correction is an alarm"
            ),
        )),
        None => Some((
            "run_counted_by_you",
            format!(
                "runs are compared in {theirs}{variable}: your own program must count them there, \
                 keep the number while the control is off, and print the lines of hw/control; \
                 there are no macros for this control"
            ),
        )),
    }
}

/// Whether a READ that finds no correction gets a program that raises an alarm.
#[must_use]
pub fn has_alarm(job: &Job) -> bool {
    job.correction.is_some_and(|spec| {
        umi_core::correction::alarm(&spec, &Withheld::NoVerdict, None, Coding::Ascii).is_some()
    })
}

fn compensation(compensation: Compensation) -> String {
    match compensation {
        Compensation::InMacro => "in the macro: the lines hold contact points".into(),
        Compensation::OnBoard {
            tip_radius_mm,
            pretravel_mm: [x, y, z],
        } => format!("on the board: tip radius {tip_radius_mm} mm, pretravel X {x} Y {y} Z {z} mm"),
    }
}

fn witness(witness: &WitnessSpec) -> [String; 3] {
    let [x, y, z] = witness.counts_per_mm;
    let origin = match witness.origin_counts {
        Some(_) => "origin given",
        None => "origin learned from the first OK setup",
    };
    [
        format!("encoders at the skip edge: X {x} Y {y} Z {z} counts/mm"),
        origin.to_owned(),
        format!(
            "the control may be {} ms late, {} mm off",
            witness.delay_ms, witness.tolerance_mm
        ),
    ]
}

fn receiver(table: &mut Table, receiver: &ReceiverConfig) {
    table.row(["code", &receiver.coding.to_string()]);
    for (number, of) in receiver.patterns.iter().enumerate() {
        let title = if number == 0 { "lines" } else { "" };
        table.row([title, &pattern(of)]);
    }
    let travel = receiver
        .travel_mm
        .map_or("not stated".to_owned(), |travel| {
            let axes = ["X", "Y", "Z"].iter().zip(travel.to_array());
            let ranges: Vec<String> = axes
                .map(|(axis, [low, high])| format!("{axis} {low} to {high}"))
                .collect();
            format!("{} mm", ranges.join(", "))
        });
    table.row(["travel", &travel]);
    table.row([
        "line given up after",
        &format!("{} s of silence", receiver.idle_timeout_s),
    ]);
    let handshake = match receiver.handshake {
        Handshake::None => "never",
        Handshake::XonXoff => "by XOFF, until XON",
    };
    table.row(["control held", handshake]);
}

fn pattern(pattern: &LinePattern) -> String {
    match pattern {
        LinePattern::Block(block) => {
            let words: Vec<&str> = block.headers.iter().map(|word| word.as_str()).collect();
            let spans = if block.spans_sessions {
                ", over several POPEN/PCLOS"
            } else {
                ""
            };
            format!(
                "block of points under {}, {}{spans}",
                words.join(" or "),
                format(&block.format)
            )
        }
        LinePattern::PointLine(line) => {
            format!("`{}` x y z, {}", line.label, format(&line.format))
        }
        LinePattern::RingCsv(ring) => format!(
            "table Index,X,Y of {} as {} at Z {} mm, {}",
            count(ring.rows.into(), "row"),
            ring.name,
            ring.z_mm,
            format(&ring.format)
        ),
        LinePattern::LabelledWords(words) => {
            let mut text = format!("words {}", words.axes);
            if !words.prefix.is_empty() {
                text += &format!(" after `{}`", words.prefix);
            }
            if !words.ignored.is_empty() {
                text += &format!(", {} not used", words.ignored);
            }
            text + &any_format(words.format.as_ref())
        }
        LinePattern::GrblProbe => "GRBL [PRB:x,y,z:s]".into(),
        LinePattern::LinuxCncProbe => "LinuxCNC, nine numbers a line".into(),
        LinePattern::Checked(checked) => {
            format!("openumi's checked line, {}", format(&checked.format))
        }
        LinePattern::Template(template) => {
            format!(
                "`{}`{}",
                template.text,
                any_format(template.format.as_ref())
            )
        }
    }
}

fn any_format(of: Option<&FieldFormat>) -> String {
    of.map_or_else(|| ", any digits".into(), |of| format!(", {}", format(of)))
}

fn format(format: &FieldFormat) -> String {
    let overflow = match format.overflow {
        Overflow::DropsDigits => "",
        Overflow::Expands => ", wider if needed",
    };
    format!("[{}{}]{overflow}", format.integer_digits, format.decimals)
}

/// What a feature counts for: the part's datum, or what is held against it.
fn counts_for(job: &Job, feature: &FeatureSpec) -> String {
    let guards = &job.guards;
    let mut closings = guards.closing.iter();
    if let Some(closing) = closings.find(|closing| closing.feature == feature.name) {
        return format!("closes {}", closing.repeats);
    }
    if guards.fixed.contains(&feature.name) {
        return "on the table".into();
    }
    let is_datum = feature.datum && feature.kind.has_position();
    if is_datum { "yes" } else { "no" }.into()
}

fn features(job: &Job) -> Table {
    let titles = [
        "feature",
        "id",
        "kind",
        "hits",
        "nominal position",
        "radius",
        "datum",
        "approach",
    ];
    let mut table = Table::new("<><>>><<").titles(&titles);
    for feature in &job.features {
        let kind = format!("{:?}", feature.kind).to_lowercase();
        let position = feature.position_mm.map_or("-".into(), triple);
        let radius = feature.radius_mm.map_or("-".into(), |r| format!("{r} mm"));
        let approach: Vec<&str> = feature.approach.iter().map(|a| approach(*a)).collect();
        table.row([
            feature.name.to_string(),
            feature.id.map_or("-".into(), |id| id.to_string()),
            kind,
            feature.hits.to_string(),
            position,
            radius,
            counts_for(job, feature),
            if approach.is_empty() {
                "-".to_owned()
            } else {
                approach.join(" ")
            },
        ]);
    }
    table
}

const fn approach(approach: Approach) -> &'static str {
    match approach {
        Approach::PlusX => "+x",
        Approach::MinusX => "-x",
        Approach::PlusY => "+y",
        Approach::MinusY => "-y",
        Approach::PlusZ => "+z",
        Approach::MinusZ => "-z",
    }
}

fn limits(job: &Job) -> Table {
    let limits = &job.limits;
    let mut table = Table::new("<>").titles(&["limit", "at most"]);
    let optional = |value: Option<f64>, unit| {
        value.map_or("not checked".into(), |value| format!("{value} {unit}"))
    };
    let [x, y, z] = limits.shift_mm;
    for (name, value) in [
        ("radius error", format!("{} mm", limits.radius_error_mm)),
        ("rms of a feature", format!("{} mm", limits.rms_mm)),
        ("approach to normal", optional(limits.approach_deg, "deg")),
        ("lone hit of a sphere", optional(limits.lone_hit_mm, "mm")),
        (
            "last touch from the first",
            optional(job.again.map(|again| again.within_mm), "mm"),
        ),
        ("distance error", format!("{} mm", limits.distance_error_mm)),
        (
            "rms of the registration",
            format!("{} mm", limits.registration_rms_mm),
        ),
        ("rotation about Z", format!("{} deg", limits.rotation_deg)),
        ("tilt", format!("{} deg", limits.tilt_deg)),
        ("shift in X, Y, Z", format!("{x}, {y}, {z} mm")),
        (
            "expected error at the part",
            optional(limits.expected_error_mm, "mm"),
        ),
    ] {
        table.row([name.to_owned(), value]);
    }
    if let Some(probing) = &job.guards.probing {
        let [x, y, z] = probing.sigma_mm;
        let sigma = match probing.same_mm() {
            Some(all) => format!("{all} mm"),
            None => format!("{x}, {y}, {z} mm"),
        };
        let name = match probing.same_mm() {
            Some(_) => "a hit scatters (sigma)",
            None => "a hit scatters in X, Y, Z",
        };
        table.row([name.to_owned(), sigma]);
    }
    table
}

fn correction(spec: &CorrectionSpec) -> Table {
    let mut table = Table::new("<<").titles(&["correction", spec.dialect.name()]);
    let end = match spec.ends_with {
        ProgramEnd::M99 => "M99",
        ProgramEnd::M30 => "M30",
    };
    let send = match spec.send {
        SendWhen::OnRequest => "when the control asks for it (READ)",
        SendWhen::OnVerdict => "as soon as the verdict is OK",
        SendWhen::Never => "never to the control, only shown",
    };
    for (name, value) in [
        (
            "probed in",
            format!("{} at {} mm", spec.probed_in, triple(spec.probed_origin_mm)),
        ),
        (
            "writes",
            format!(
                "{} as program O{:04}, {end}",
                written(spec),
                spec.program_number
            ),
        ),
        (
            "part",
            format!(
                "{} to {} mm",
                triple(spec.part_min_mm),
                triple(spec.part_max_mm)
            ),
        ),
        ("leaves at most", format!("{} mm", spec.leftover_mm)),
        ("sent", send.to_owned()),
    ] {
        table.row([name.to_owned(), value]);
    }
    table
}

/// The work offset, and what else the dialect writes.
fn written(spec: &CorrectionSpec) -> String {
    let form = umi_core::correction::dialect::form(spec.dialect);
    match form.set {
        Some(_) => format!("{} and set {}", spec.write_to, form.set(spec)),
        None => spec.write_to.to_string(),
    }
}

fn triple([x, y, z]: [f64; 3]) -> String {
    format!("({x}, {y}, {z})")
}

/// Reference positions that a board was taught.
#[must_use]
pub fn taught(positions_mm: &[[f64; 3]], job: &Job) -> String {
    let datums = umi_core::job::datums(job).map(|(_, feature)| feature.name.as_str());
    let mut table = Table::new("<>>>").titles(&["taught (mm)", "X", "Y", "Z"]);
    for (name, position) in datums.zip(positions_mm) {
        let mut row = vec![name.to_owned()];
        row.extend(position.map(|x| fixed(x, 4)));
        table.row(row);
    }
    if positions_mm.is_empty() {
        paint(FAINT, "  nothing taught\n")
    } else {
        table.to_string()
    }
}

/// How the job's features were when they were taught: from the smallest to the largest, and
/// what is allowed beyond.
#[must_use]
pub fn learned(learned: &Lessons, job: &Job) -> String {
    let Some(limits) = job.guards.learned else {
        return String::new();
    };
    let span = |low: f64, high: f64| {
        if low < high {
            format!("{low:.4} to {high:.4}")
        } else {
            format!("{low:.4}")
        }
    };
    let titles = ["learned (mm)", "radius", "rms", "centring"];
    let mut table = Table::new("<>>>").titles(&titles);
    for (place, feature) in job.features.iter().enumerate() {
        let Some((low, high)) = learned.of(place) else {
            return String::new();
        };
        table.row([
            feature.name.to_string(),
            span(low.radius_mm, high.radius_mm),
            span(low.rms_mm, high.rms_mm),
            span(low.centring_mm, high.centring_mm),
        ]);
    }
    table.row([
        "allowed beyond".to_owned(),
        format!("±{:.4}", limits.radius_mm),
        format!("+{:.4}", limits.rms_mm),
        format!("+{:.4}", limits.centring_mm),
    ]);
    let by = count(u64::from(learned.further) + 1, "clamping");
    format!(
        "\n{table}{}\n",
        paint(FAINT, format_args!("  taught by {by}"))
    )
}

/// From here on sizes are told in mm, µm.
const MILLIMETRE_UM: f64 = 1000.0;

/// Which errors a job sees, for people.
#[must_use]
pub fn guards(table: &GuardTable, has_frame: bool) -> String {
    let titles = ["what may happen", "seen", "by, or would be"];
    let mut rows = Table::new("<><").titles(&titles);
    for row in &table.rows {
        let seen = match row.seen {
            SeenFrom::Always => "always".to_owned(),
            SeenFrom::Size(um) if um < 100.0 => format!("from {um:.1} µm"),
            SeenFrom::Size(um) if um < MILLIMETRE_UM => format!("from {um:.0} µm"),
            SeenFrom::Size(um) => format!("from {:.0} mm", um * 1e-3),
            SeenFrom::After(seconds) => format!("after {seconds} s"),
            SeenFrom::Never => "no".to_owned(),
        };
        rows.row([row.what.to_owned(), seen, row.by.to_owned()]);
    }
    let mut text = rows.to_string();
    for note in guard_notes(table, has_frame) {
        text += &format!("{}\n", paint(FAINT, wrapped(&note.message)));
    }
    text
}

/// What the table assumes, and where its guards end.
fn guard_notes(table: &GuardTable, has_frame: bool) -> Vec<Note> {
    let mut notes = Vec::new();
    if !table.has_places {
        notes.push(Note {
            code: "assumed_places",
            message: format!(
                "no `position_mm` at {}: all features are taken evenly on a circle of \
                 {ASSUMED_RADIUS_MM} mm; enter where each stands, for the figures of this plate",
                table.without_place.join(", ")
            ),
        });
    }
    if has_frame {
        notes.push(Note {
            code: "frame_limits",
            message:
                "`frame`: offset, tool length from 1 µm, G52, G92 from 3 µm on, by hw/control; \
                      runs of older macros are refused. What is set after the last hit nobody \
                      sees. Macros of your own that print blocks: `G65 P8819` before each block"
                    .to_owned(),
        });
    }
    notes
}

/// The same for machines.
#[must_use]
pub fn guards_json(table: &GuardTable) -> Value {
    let rows = table.rows.iter().map(|row| {
        let (seen, from_um, after_s) = match row.seen {
            SeenFrom::Always => ("always", None, None),
            SeenFrom::Size(um) => ("from", Some(um), None),
            SeenFrom::After(seconds) => ("after", None, Some(seconds)),
            SeenFrom::Never => ("no", None, None),
        };
        json!({
            "code": row.code, "what": row.what, "by": row.by,
            "seen": seen, "from_um": from_um, "after_s": after_s,
        })
    });
    json!({
        "has_places": table.has_places,
        "without_place": table.without_place,
        "rows": rows.collect::<Vec<_>>(),
    })
}
