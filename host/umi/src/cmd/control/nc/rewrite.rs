//! `umi nc rewrite`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::{GOOD, Table, count, paint, print, print_error, print_json};
use clap::Args;
use serde_json::{Value, json};
use umi_client::files::points::name;
use umi_client::files::tool_path::{self, PartProgram};
use umi_client::problem::Problem;
use umi_core::correction::RunCheck;
use umi_core::rewrite::{ProgramIdentity, RewriteSettings, Summary};

use super::how::{How, told};
use crate::cmd::Format;
use crate::cmd::control::basis::{MovedBy, WHICH};
use crate::output::Force;

/// Rewrite a tool path: every motion carried by a transform, all else as it was
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Rewrite {
    /// The part program
    #[arg(value_name = "PROGRAM")]
    program: PathBuf,
    /// Where the rewritten program goes; `-` is standard output
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    moved_by: MovedBy,
    #[command(flatten)]
    how: How,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The transform q = R p + t holds in the coordinates of one work offset: that in which the part was
probed (`correction.probed_in` of the verdict's job, without one G54; --probed-in), with a
--transform the one in force at the program's first motion. A program that runs in another one is
refused where the part is turned, unless --origin says where both are.
A transform of points that disagree is refused beyond --limit, as `umi correction` does.
A transform into machine coordinates (umi scan localise --fiducials) is reckoned from the origin
that --origin gives of the offset in --probed-in.
What cannot be transformed truly is refused by line
and reason, and then nothing is written: the file appears whole or not at all.
A header says check value, source and transform. The identity changes no byte.
A program that was rewritten before needs --again: its comparison of the run stays, unless the
verdict brings another.
By a verdict of a job that counts runs (`guards.run_variable`), of a board or a journal, the
program begins with an alarm for every run but the one that was measured. What `umi replay --json`
printed of such a job is refused: it does not say how the control compares runs.
M, S and T words are copied. An M code by which your control calls a macro or mirrors an axis is
not known here: write the macro's path out, and mirror before.
A program that is called and is not in the file is refused: --load brings it into the
file that is written, --allow-call says that nothing in it is to be carried.

Examples:
  umi nc rewrite part.nc -o here.nc --verdict today.umij
  umi nc rewrite part.nc -o here.nc --transform moved.json --increment-mm 0.0001
  umi nc rewrite part.nc -o here.nc --verdict board --port /dev/ttyACM0 --force
  umi nc rewrite part.nc -o here.nc --verdict today.umij --load pocket.nc
  umi nc rewrite part.ngc -o - --transform moved.json --dialect linuxcnc --json
  umi nc rewrite part.ngc -o here.ngc --transform moved.json --start G90,G21

Exit status: 0 written, 1 file or usage, 2 refused: nothing is written.";

impl Rewrite {
    pub fn run(self) -> Result<(), Failure> {
        let Some(basis) = self.moved_by.read_in(self.how.stated())? else {
            return Err(Failure::trouble("usage", WHICH));
        };
        self.how.holds(&basis, None)?;
        let source = basis.source()?;
        let mut inputs = vec![self.program.as_path()];
        inputs.extend(self.how.inputs().chain(self.moved_by.inputs()));
        self.force.check(&self.output, &inputs)?;
        let program = self.how.program(&self.program)?;
        let settings = RewriteSettings {
            run: source.run,
            ..self.how.settings(source.transform, source.measured_in)?
        };
        let is_stdout = self.output.as_os_str() == "-";
        // What has gone out cannot be taken back; and how far a program reaches it says at its end.
        if is_stdout || basis.is_known_everywhere() {
            let summary = self.examined(&program, &settings)?;
            self.how.holds(&basis, summary.nominal_mm)?;
        }
        let identity = tool_path::identity(&self.program)?;
        let with_header = RewriteSettings {
            original: Some(identity),
            source: source.name.chars().take(96).collect(),
            ..settings.clone()
        };
        let summary = match tool_path::rewrite(&program, &self.output, &with_header) {
            Ok(summary) => summary,
            Err(problem) => {
                // All the reasons, if it is not the file that cannot be written.
                self.examined(&program, &settings)?;
                return Err(problem.into());
            }
        };
        if self.format.json {
            let mut value = machine(&identity, &summary);
            value["run"] = json!(source.run.map(RunCheck::run));
            value["run_variable"] = json!(source.run.map(RunCheck::variable));
            value["earlier_run"] = json!(summary.earlier_run);
            if is_stdout {
                print_error(&format!("{value}\n"));
                Ok(())
            } else {
                print_json(&value)
            }
        } else if is_stdout {
            Ok(())
        } else {
            let mut table = table(&identity, &summary);
            if self.moved_by.is_verdict() || summary.earlier_run.is_some() {
                table.row(["run".to_owned(), compared(source.run, summary.earlier_run)]);
            }
            print(&format!(
                "{} {}\n\n{table}",
                paint(GOOD, "rewritten"),
                name(&self.output),
            ))
        }
    }

    /// Refuses a program that cannot be rewritten, by its first reason and their number.
    fn examined(
        &self,
        program: &PartProgram,
        settings: &RewriteSettings,
    ) -> Result<Summary, Failure> {
        let examined = tool_path::examine(program, settings)?;
        let Some(first) = examined.refusals.first() else {
            return Ok(examined.summary);
        };
        let all = examined.refusals.len() as u64 + examined.more;
        let others = match all - 1 {
            0 => String::new(),
            n => format!(" ({} more: umi nc check lists them)", n),
        };
        let why = format_args!(
            "{}{others}; nothing is written",
            told(program, first, settings)
        );
        let (_, first) = program.place(first);
        Err(Problem::refused("cannot_rewrite", why)
            .with("line", first.line)
            .with("column", first.column)
            .with("refusals", all)
            .into())
    }
}

/// Whether the program compares the run that was measured with the control's own.
fn compared(check: Option<RunCheck>, earlier: Option<u32>) -> String {
    match (check, earlier) {
        (Some(check), None) => format!("alarm unless #{} is {}", check.variable(), check.run()),
        (Some(check), Some(earlier)) => format!(
            "alarm unless #{} is {}; the comparison with run {earlier} is taken out",
            check.variable(),
            check.run()
        ),
        (None, Some(earlier)) => format!(
            "the program's own comparison stays: alarm unless this is run {earlier}, which was \
             measured before it was rewritten first"
        ),
        (None, None) => {
            "not compared with the control's: a late text moves the path, too (the job's \
                 `guards.run_variable`, and a journal or board as --verdict)"
                .into()
        }
    }
}

/// What was done, for machines.
pub fn machine(identity: &ProgramIdentity, summary: &Summary) -> Value {
    json!({
        "crc32": format!("{:08X}", identity.crc32),
        "bytes": identity.bytes,
        "lines": summary.lines,
        "blocks": summary.blocks,
        "rapids": summary.rapids,
        "feeds": summary.feeds,
        "arcs_kept": summary.arcs,
        "arcs_as_chords": summary.chorded,
        "chords": summary.chords,
        "holes": summary.holes,
        "holes_written_out": summary.written_out,
        "nominal_min_mm": summary.nominal_mm.map(|[low, _]| low),
        "nominal_max_mm": summary.nominal_mm.map(|[_, high]| high),
        "written_min_mm": summary.written_mm.map(|[low, _]| low),
        "written_max_mm": summary.written_mm.map(|[_, high]| high),
    })
}

/// What was done, for people.
pub fn table(identity: &ProgramIdentity, summary: &Summary) -> Table {
    let mut table = Table::new("<<");
    table.row([
        "original".to_owned(),
        format!(
            "{}, CRC-32 {:08X}",
            count(identity.bytes, "byte"),
            identity.crc32
        ),
    ]);
    table.row([
        "motions".to_owned(),
        format!(
            "{}, {}, {}, {}",
            count(summary.rapids, "rapid"),
            count(summary.feeds, "line"),
            count(summary.arcs, "arc"),
            count(summary.holes, "hole"),
        ),
    ]);
    if summary.chorded + summary.written_out > 0 {
        table.row([
            "written out".to_owned(),
            format!(
                "{} as {}, {}",
                count(summary.chorded, "arc"),
                count(summary.chords, "chord"),
                count(summary.written_out, "hole"),
            ),
        ]);
    }
    for (title, extent) in [
        ("nominal (mm)", summary.nominal_mm),
        ("written (mm)", summary.written_mm),
    ] {
        let Some([low, high]) = extent else { continue };
        let axis = |letter: char, axis: usize| match (low.get(axis), high.get(axis)) {
            (Some(low), Some(high)) if low <= high => format!("{letter} {low:.3} to {high:.3}"),
            _ => format!("{letter} -"),
        };
        table.row([
            title.to_owned(),
            [axis('X', 0), axis('Y', 1), axis('Z', 2)].join(", "),
        ]);
    }
    table
}
