//! A job as text for people.

use umi_protocol::job::{
    Approach, Compensation, CorrectionSpec, Job, Lessons, ProgramEnd, Reference, SendWhen, Teach,
    WitnessSpec,
};
use umi_protocol::latch::SignalLevel;
use umi_protocol::pattern::{
    Coding, FieldFormat, Handshake, LinePattern, Overflow, ReceiverConfig,
};
use umi_protocol::program::Withheld;
use umi_protocol::serial::Cts;

use crate::show::terminal::{CAUTION, FAINT, TITLE, Table, count, paint};
use serde_json::{Value, json};
use umi_client::guards::{ASSUMED_RADIUS_MM, GuardTable, SeenFrom};

/// What a job probes, judges and sends.
#[must_use]
pub fn text(job: &Job) -> String {
    let mut text = format!("{}\n", paint(TITLE, format_args!("job {}", job.name)));
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
    }
    text += &format!("{general}\n");
    text += &format!("{}\n", features(job));
    text += &format!("{}\n", limits(job));
    text += &match &job.correction {
        Some(spec) => correction(spec).to_string(),
        None => "  no correction: the job only measures\n".to_owned(),
    };
    if job.correction.is_some() && !has_alarm(job) {
        let said = "a READ without an OK verdict gets nothing: this control has no word that \
                    raises an alarm";
        text += &format!("\n  {}\n", paint(CAUTION, said));
    }
    if let Some(open) = umi_core::job::not_guarded(job) {
        text += &format!("\n  {}\n", paint(CAUTION, open));
    }
    text
}

/// Whether a READ that finds no correction gets a program that raises an alarm.
#[must_use]
pub fn has_alarm(job: &Job) -> bool {
    job.correction.is_some_and(|spec| {
        umi_core::correction::alarm(&spec, &Withheld::NoVerdict, Coding::Ascii).is_some()
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
        let datum = feature.datum && feature.kind.has_position();
        let approach: Vec<&str> = feature.approach.iter().map(|a| approach(*a)).collect();
        table.row([
            feature.name.to_string(),
            feature.id.map_or("-".into(), |id| id.to_string()),
            kind,
            feature.hits.to_string(),
            position,
            radius,
            if datum { "yes" } else { "no" }.to_owned(),
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
        row.extend(position.map(|x| format!("{x:.4}")));
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

/// From here on no error is meant by a size, µm.
const ABSURD_UM: f64 = 1000.0;

/// Which errors a job sees, for people.
#[must_use]
pub fn guards(table: &GuardTable, has_frame: bool) -> String {
    let titles = ["what may happen", "seen", "by, or would be"];
    let mut rows = Table::new("<><").titles(&titles);
    for row in &table.rows {
        let seen = match row.seen {
            SeenFrom::Always => "always".to_owned(),
            SeenFrom::Size(um) if um < 100.0 => format!("from {um:.1} µm"),
            SeenFrom::Size(um) if um < ABSURD_UM => format!("from {um:.0} µm"),
            // No error of this kind is as large: what sees it then is the end of the table.
            SeenFrom::Size(um) => format!("no, below {:.0} mm", um * 1e-3),
            SeenFrom::After(seconds) => format!("after {seconds} s"),
            SeenFrom::Never => "no".to_owned(),
        };
        rows.row([row.what.to_owned(), seen, row.by.to_owned()]);
    }
    let assumed = if table.has_places {
        String::new()
    } else {
        paint(
            FAINT,
            format_args!(
                "  no `position_mm` in the job: features taken evenly on a circle of \
                 {ASSUMED_RADIUS_MM} mm;\n  enter where they stand, for the figures of this plate\n"
            ),
        )
    };
    let frame = if has_frame {
        paint(
            FAINT,
            "  `frame`: an offset from 1 µm, G52 and G92 from 3 µm on, by hw/control;\n  \
             runs of older macros are refused. What is set after the last hit nobody sees.\n  \
             Macros of your own that print blocks: `G65 P8819` before each block\n",
        )
    } else {
        String::new()
    };
    format!("{rows}{assumed}{frame}")
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
    json!({ "has_places": table.has_places, "rows": rows.collect::<Vec<_>>() })
}
