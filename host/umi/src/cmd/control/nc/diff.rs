//! `umi nc diff`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::{BAD, GOOD, Table, count, paint, print, print_json};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use umi_client::files::points::name;
use umi_client::files::tool_path::diff::{self, Depends, DiffLimits, Largest, PathDifference};
use umi_client::job::correction::Basis;
use umi_client::problem::{Problem, ProblemKind};
use umi_core::registration::RigidTransform;
use umi_desk::tool_path::{self, PathFrame};
use umi_report::pages::paths;
use umi_virtual::nc::{ControlFamily, ControlSettings, DecimalPoint};

use crate::cmd::Format;
use crate::cmd::control::basis::MovedBy;
use crate::cmd::control::offsets::Offsets;
use crate::cmd::control::options::Count;
use crate::output::Force;

/// Compare two programs motion by motion, the first carried by a transform
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Diff {
    /// The first program, as the nominal one
    #[arg(value_name = "A")]
    first: PathBuf,
    /// The second, as the rewritten one
    #[arg(value_name = "B")]
    second: PathBuf,
    #[command(flatten)]
    moved_by: MovedBy,
    #[command(flatten)]
    offsets: Offsets,
    /// Programs that both call, as macros (repeatable)
    #[arg(long, value_name = "FILE")]
    load: Vec<PathBuf>,
    /// Write a page with pictures of both paths
    #[arg(short, long, value_name = "PAGE.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// How far ends and ways may lie from their images: by itself a thousandth of an inch, more than
    /// twice what umi nc rewrite's arcs may
    #[arg(long, value_name = "MM", default_value_t = 0.025)]
    within_mm: f64,
    /// Ends farther apart than this are not the same place: they are not found at all
    #[arg(long, value_name = "MM", default_value_t = 0.05)]
    near_mm: f64,
    /// The control whose language both are
    #[arg(long, value_enum, default_value_t = Language::Fanuc)]
    control: Language,
    /// What a length without a decimal point counts
    #[arg(long, value_enum, default_value_t = Count::Units)]
    integers: Count,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Both programs are interpreted by the virtual machine's control, with tools of
length zero and home at machine zero; numbers without a point are mm, or 0.001 mm with
--integers increments. Without a transform the programs are compared as they are.
Arcs may have become chords. Every motion is followed all the way, in its direction and by all its
turns: where it strays more than --within-mm from the image of the first program's, the programs
differ.
What stands between motions is compared by its text and its place: T, M codes, H, G9, G43, G44, G49,
G61, G64, G10, variables, IF, WHILE, GOTO and the blocks it leads to, and /. A mode (G90, G21, G54, G17, G40)
or a unit of numbers without a point that only one program takes for granted is a difference, too.
Blocks that a decision leads round are compared by their text; where that differs, or would have to be
moved, the answer is not compared.
Not compared: feeds, dwells, spindle (M3, M4, M5), coolant (M7, M8, M9), prints, comments, N numbers,
and shifts (G52, G92) behind the last motion, which a program that follows would meet.
Work offsets that no --origin gives, and no job, lie far from each other: motions in another one are
somewhere else. Variables that a program does not set are empty.
Motions in machine coordinates (G28, G30, G53), and those with an axis that is still there or was
not named yet, have no image and are left out; axes have to be sent to the same places. The way of
the motion behind them is not measured, only its end.

Examples:
  umi nc diff part.nc here.nc --verdict today.umij
  umi nc diff part.nc here.nc --transform moved.json -o diff.html --json
  umi nc diff part.nc here.nc --transform moved.json --within-mm 0.005
  umi nc diff part.nc here.nc --transform moved.json --load pocket.nc
  umi nc diff part.nc here.nc --transform moved.json --integers increments

Exit status: 0 all motions have their image within --within-mm, 1 file, usage, or a block that the
virtual control does not interpret (code not_interpreted: G41, ,C, G28 without an axis, rotary axes,
no feed; nothing is compared), 2 they differ, or something in them cannot be compared.";

#[derive(Clone, Copy, ValueEnum)]
enum Language {
    /// Fanuc
    Fanuc,
    /// Haas
    Haas,
    /// Mitsubishi, Mazak EIA
    Mitsubishi,
    /// LinuxCNC
    Linuxcnc,
}

impl Diff {
    pub fn run(self) -> Result<(), Failure> {
        let near_is_good = self.near_mm > 0.0 && self.near_mm <= 100.0;
        if !near_is_good {
            return Err(Failure::trouble(
                "usage",
                "--near-mm is above 0, at most 100",
            ));
        }
        let within_is_good = self.within_mm > 0.0 && self.within_mm <= 100.0;
        if !within_is_good {
            return Err(Failure::trouble(
                "usage",
                "--within-mm is above 0, at most 100",
            ));
        }
        let limits = DiffLimits {
            near_mm: self.near_mm,
            within_mm: self.within_mm,
        };
        if let Some(path) = &self.output {
            let mut inputs = vec![self.first.as_path(), self.second.as_path()];
            inputs.extend(self.load.iter().map(PathBuf::as_path));
            inputs.extend(self.moved_by.inputs());
            self.force.check(path, &inputs)?;
        }
        let basis = self.moved_by.read_in(self.offsets.stated())?;
        let measured_in = basis.as_ref().and_then(Basis::measured_in);
        let (measured_in, origins_mm) = self.offsets.of(measured_in)?;
        let transform = match basis {
            Some(basis) => basis.transform()?,
            None => RigidTransform::identity(),
        };
        let frame = measured_in.map_or(PathFrame::FirstMotion, |of| PathFrame::Of(of.offset));
        let dialect = match self.control {
            Language::Fanuc => ControlFamily::Fanuc,
            Language::Haas => ControlFamily::Haas,
            Language::Mitsubishi => ControlFamily::Mitsubishi,
            Language::Linuxcnc => ControlFamily::LinuxCnc,
        };
        let settings = ControlSettings {
            decimal_point: match self.integers {
                Count::Units => DecimalPoint::Calculator,
                Count::Increments => DecimalPoint::Increments,
            },
            increment_mm: match self.integers {
                Count::Units => 1e-6,
                Count::Increments => 1e-3,
            },
            // A program that leaves its feed to what ran before is compared, too.
            feed_mm_min: Some(100.0),
            // Anywhere but home: what is sent there is not the same.
            second_reference_mm: Some([-1.0; 3]),
            ..ControlSettings::of(dialect)
        };
        // Nothing is compared then: the answer is not that they differ.
        let not_interpreted = |problem: Problem| match problem.code {
            "alarm" => Problem {
                kind: ProblemKind::Trouble,
                code: "not_interpreted",
                message: format!("nothing is compared: {problem}"),
                ..problem
            },
            _ => problem,
        };
        let driven = |path, frame| {
            tool_path::drive(path, &self.load, &settings, &origins_mm, frame)
                .map_err(not_interpreted)
        };
        let first = driven(&self.first, frame)?;
        // Its frame is that of both: under another work offset the second is somewhere else.
        let second = driven(&self.second, PathFrame::At(first.frame_mm))?;
        let mut found = diff::compare(&first.moves, &second.moves, &transform, limits);
        found.compare_beside(&first.beside, &second.beside, &transform);
        if let Some(path) = &self.output {
            let title = format!("{} and {}", name(&self.first), name(&self.second));
            let page = paths::html(
                &title,
                &found.in_words(),
                &facts(&found),
                &first.moves,
                &second.moves,
                &transform,
                &found,
            );
            std::fs::write(path, page).map_err(|error| Failure::file("write", path, &error))?;
        }
        if self.format.json {
            print_json(&machine(&found))?;
        } else {
            let style = if found.is_complete() { GOOD } else { BAD };
            print(&format!(
                "{}\n\n{}",
                paint(style, found.in_words()),
                text(&found)
            ))?;
        }
        if found.is_complete() {
            Ok(())
        } else {
            Err(Failure::Negative)
        }
    }
}

fn machine(found: &PathDifference) -> Value {
    let decides = |of: &[Depends]| -> Vec<Value> {
        of.iter()
            .map(|of| json!({"line": of.line, "what": of.what}))
            .collect()
    };
    let largest = |of: &Option<Largest>| {
        of.map_or(Value::Null, |of| {
            json!({
                "deviation_mm": of.mm,
                "line_a": of.lines[0],
                "line_b": of.lines[1],
                "at_mm": of.at_mm,
            })
        })
    };
    json!({
        "type": "diff",
        "complete": found.is_complete(),
        "within": found.is_within(),
        "within_mm": found.limits.within_mm,
        "moves_a": found.moves[0],
        "moves_b": found.moves[1],
        "left_out_a": found.away[0],
        "left_out_b": found.away[1],
        "matched": found.matched,
        "missing_lines_a": found.missing,
        "other_rate": found.other_rate,
        "inserted_lines_b": found.inserted,
        "left_over_b": found.left_over,
        "not_compared_lines_a": found.not_compared[0],
        "not_compared_lines_b": found.not_compared[1],
        "decides_a": decides(&found.decides[0]),
        "decides_b": decides(&found.decides[1]),
        "granted_a": decides(&found.granted[0]),
        "granted_b": decides(&found.granted[1]),
        "not_run_a": decides(&found.not_run[0]),
        "not_run_b": decides(&found.not_run[1]),
        "sent_elsewhere_line_a": found.sent_elsewhere[0],
        "sent_elsewhere_line_b": found.sent_elsewhere[1],
        "ways_left_out": found.from_away,
        "rms_ends_mm": found.rms_mm,
        "largest_end": largest(&found.largest_end),
        "largest_way": largest(&found.largest_way),
        "largest_rapid": largest(&found.largest_rapid),
    })
}

/// What is to be said, a name and a value each.
fn facts(found: &PathDifference) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    let mut fact = |name: &str, value: String| facts.push((name.to_owned(), value));
    let [first, second] = found.moves;
    fact(
        "motions",
        format!("{first} and {second}, {} of the first found", found.matched),
    );
    let [first, second] = found.away;
    if first + second > 0 {
        fact(
            "left out",
            format!(
                "{first} and {second}: G28, G30 or G53, or an axis that these have sent away while the \
                 part leans"
            ),
        );
    }
    if found.from_away > 0 {
        let ways = count(found.from_away as u64, "motion");
        fact("ends only", format!("{ways}: behind what is left out"));
    }
    for (name, lines) in [
        ("not found", &found.missing),
        ("not in the first", &found.inserted),
        ("not compared", &found.not_compared[0]),
        ("not compared there", &found.not_compared[1]),
    ] {
        if !lines.is_empty() {
            let dots = if lines.len() > 10 { " …" } else { "" };
            let lines: Vec<String> = lines.iter().take(10).map(u32::to_string).collect();
            fact(name, format!("line {}{dots}", lines.join(", ")));
        }
    }
    if found.other_rate > 0 {
        let motions = count(found.other_rate as u64, "motion");
        fact("other rate", format!("{motions} cut in one program only"));
    }
    for ([first, second], what) in [
        (
            ["only the first has", "only the second has"],
            &found.decides,
        ),
        (
            [
                "only the first takes for granted",
                "only the second takes for granted",
            ],
            &found.granted,
        ),
        (
            ["not run in the first", "not run in the second"],
            &found.not_run,
        ),
    ] {
        for (name, what) in [(first, &what[0]), (second, &what[1])] {
            let what = what.iter().take(10);
            let what: Vec<String> = what
                .map(|of| format!("{} (line {})", of.what, of.line))
                .collect();
            if !what.is_empty() {
                fact(name, what.join(", "));
            }
        }
    }
    if found.left_over > 0 {
        fact("left over", count(found.left_over as u64, "motion"));
    }
    fact("ends, rms", format!("{:.6} mm", found.rms_mm));
    for (name, largest) in [
        ("ends, largest", &found.largest_end),
        ("cuts, largest", &found.largest_way),
        ("rapids, largest", &found.largest_rapid),
    ] {
        if let Some(Largest { mm, lines, at_mm }) = largest {
            let [a, b] = lines;
            let [x, y, z] = at_mm;
            fact(
                name,
                format!("{mm:.6} mm, lines {a} and {b}, at {x:.3}, {y:.3}, {z:.3}"),
            );
        }
    }
    fact("limit", format!("{} mm", found.limits.within_mm));
    facts
}

fn text(found: &PathDifference) -> Table {
    let mut table = Table::new("<<");
    for (name, value) in facts(found) {
        table.row([name, value]);
    }
    table
}
