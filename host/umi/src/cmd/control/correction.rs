//! `umi correction`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::{print, print_json};
use clap::Args;
use serde_json::json;
use umi_client::files::job_file;
use umi_client::job::correction::{Basis, make};
use umi_core::rewrite::MeasuredIn;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd, SendWhen, WorkOffset};

use super::basis::{MovedBy, WHICH};
use super::offsets::offset;
use crate::cmd::Format;

/// The correction program for a verdict or a transform, in any control's words
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Correction {
    /// The words; `umi dialects` lists them. Without it: those of the job
    #[arg(long, value_name = "NAME", value_parser = dialect)]
    dialect: Option<Dialect>,
    #[command(flatten)]
    moved_by: MovedBy,
    /// A job, for all that is not given below
    #[arg(long, value_name = "JOB.toml")]
    job: Option<PathBuf>,
    /// The work offset that was active while probing, as G54 or G54.1P7
    #[arg(long, value_name = "OFFSET", value_parser = offset)]
    probed_in: Option<WorkOffset>,
    /// Its values, machine coordinates, mm
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
    /// The work offset that is written
    #[arg(long, value_name = "OFFSET", value_parser = offset)]
    write_to: Option<WorkOffset>,
    /// Set of G54.4, row of the preset table, or first variable
    #[arg(long, value_name = "NUMBER")]
    set: Option<u16>,
    /// The part's corner with the smallest coordinates, mm
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    part_min: Option<[f64; 3]>,
    /// The part's corner with the largest coordinates, mm
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    part_max: Option<[f64; 3]>,
    /// What may be left at the part's corners
    #[arg(long, value_name = "MM", value_parser = above_0)]
    limit: Option<f64>,
    /// The number of the program: not 8811 to 8849, which are the macros'
    #[arg(long, value_name = "NUMBER", value_parser = program_number)]
    number: Option<u16>,
    /// A main program, ended by M30, instead of a subprogram
    #[arg(long)]
    main: bool,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
What the dialect cannot express, and the rounding of its numbers, is computed at
the part's corners, stated in the program's comments, and refused beyond the limit.
A program from a transform says that no board has made it; it is held by --limit, and not by the
limits of the job's rotation, tilt and shift, which are a verdict's. A transform into machine coordinates is
reckoned from --origin; one into a scan, of which nobody says whose coordinates it has, is refused.
What `umi replay --json` printed of a job that counts runs (`guards.run_variable`) is
refused: give the journal or the board.

Examples:
  umi correction --verdict today.umij
  umi correction --verdict board --port /dev/ttyACM0
  umi correction --verdict today.umij --dialect siemens --plate 3
  umi correction --transform moved.json --job job.toml --dialect fanuc-g54.4 --set 2
  umi correction --transform moved.json --dialect linuxcnc --job job.toml --limit 0.02

Exit status: 0 made, 1 file or usage, 2 refused: verdict NG, too much is left, or
the numbers do not fit.";

fn dialect(text: &str) -> Result<Dialect, String> {
    let found = Dialect::ALL.into_iter().find(|d| d.name() == text);
    found.ok_or_else(|| {
        let names = Dialect::ALL.iter().map(|dialect| dialect.name());
        let like: Vec<&str> = names.filter(|name| is_like(name, text)).collect();
        match like.as_slice() {
            [] => "`umi dialects` lists them".into(),
            some => format!(
                "did you mean {}? `umi dialects` lists all",
                some.join(" or ")
            ),
        }
    })
}

/// Whether a dialect may be meant: the maker is in the name of either, or the name is one of
/// the maker's controls.
fn is_like(name: &str, text: &str) -> bool {
    let text = text.to_lowercase();
    let is_fanuc = text.contains("fanuc") && ["g10-g68", "g68-3d", "fanuc-g54.4"].contains(&name);
    is_fanuc || (text.len() > 2 && (name.contains(&text) || text.contains(name)))
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|x| x.trim().parse()).collect();
    let point: Option<[f64; 3]> = numbers.ok().and_then(|list| list.try_into().ok());
    point
        .filter(|p| p.iter().all(|x| x.is_finite()))
        .ok_or_else(|| "give three numbers in mm, as -400,-250.5,-310".into())
}

fn program_number(text: &str) -> Result<u16, String> {
    let number: Option<u16> = text.parse().ok();
    number
        .filter(|n| (1..=9999).contains(n) && !(8811..=8849).contains(n))
        .ok_or_else(|| "give 1 to 9999, and not 8811 to 8849, which are the shipped macros'".into())
}

fn above_0(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    number
        .filter(|x| x.is_finite() && *x > 0.0)
        .ok_or_else(|| "give millimetres above 0".into())
}

impl Correction {
    pub fn run(self) -> Result<(), Failure> {
        let Some(basis) = self.moved_by.read()? else {
            return Err(Failure::trouble("usage", WHICH));
        };
        let spec = self.spec(&basis)?;
        let basis = basis.in_offset(Some(MeasuredIn {
            offset: spec.probed_in,
            origin_mm: Some(spec.probed_origin_mm),
        }))?;
        let made = make(&basis, &spec)?;
        if self.format.json {
            print_json(&json!({
                "type": "correction",
                "dialect": spec.dialect.name(),
                "leftover_mm": made.leftover_mm,
                "limit_mm": spec.leftover_mm,
                "text": made.text,
            }))
        } else {
            print(&made.text)
        }
    }

    /// What is asked for: the options, else the job.
    fn spec(&self, basis: &Basis) -> Result<CorrectionSpec, Failure> {
        let job = match &self.job {
            Some(path) => job_file::load(path)?.correction,
            None => basis.spec(),
        };
        let given = |option: Option<[f64; 3]>, of: fn(&CorrectionSpec) -> [f64; 3], name| {
            option.or(job.as_ref().map(of)).ok_or_else(|| missing(name))
        };
        let dialect = self.dialect.or(job.map(|spec| spec.dialect));
        let dialect = dialect.ok_or_else(|| missing("dialect"))?;
        // A number means something else in another dialect.
        let set = job
            .filter(|spec| spec.dialect == dialect)
            .and_then(|s| s.set);
        let ends_with = job.map_or(ProgramEnd::M99, |spec| spec.ends_with);
        let spec = CorrectionSpec {
            dialect,
            probed_in: self
                .probed_in
                .or(job.map(|spec| spec.probed_in))
                .unwrap_or(WorkOffset::G54),
            probed_origin_mm: given(self.origin, |spec| spec.probed_origin_mm, "origin")?,
            write_to: self
                .write_to
                .or(job.map(|spec| spec.write_to))
                .unwrap_or(WorkOffset::G55),
            set: self.set.or(set),
            program_number: self
                .number
                .or(job.map(|spec| spec.program_number))
                .unwrap_or(9010),
            ends_with: if self.main {
                ProgramEnd::M30
            } else {
                ends_with
            },
            part_min_mm: given(self.part_min, |spec| spec.part_min_mm, "part-min")?,
            part_max_mm: given(self.part_max, |spec| spec.part_max_mm, "part-max")?,
            leftover_mm: self
                .limit
                .or(job.map(|spec| spec.leftover_mm))
                .ok_or_else(|| missing("limit"))?,
            send: SendWhen::Never,
        };
        if let Some(MeasuredIn {
            offset,
            origin_mm: Some(origin_mm),
        }) = basis.measured_in()
        {
            if offset != spec.probed_in {
                return Err(Failure::trouble(
                    "usage",
                    format_args!(
                        "the part of the verdict was probed in {offset}, and this correction would be \
                         reckoned in {}: leave --probed-in out, or give the job that was run",
                        spec.probed_in
                    ),
                ));
            }
            let ([x, y, z], [a, b, c]) = (origin_mm, spec.probed_origin_mm);
            if [x, y, z] != [a, b, c] {
                return Err(Failure::trouble(
                    "usage",
                    format_args!(
                        "the part of the verdict was probed where {offset} was at {x},{y},{z}, and this \
                         correction would be reckoned from {a},{b},{c}: leave --origin out, or give the \
                         job that was run; if the job was wrong, mend it and probe again"
                    ),
                ));
            }
        }
        if spec.probed_in == spec.write_to {
            return Err(Failure::trouble(
                "usage",
                "the offset that is written would be the one that was probed in: give --write-to",
            ));
        }
        if spec
            .part_min_mm
            .iter()
            .zip(spec.part_max_mm)
            .any(|(low, high)| *low > high)
        {
            return Err(Failure::trouble(
                "usage",
                "--part-min has a coordinate larger than that of --part-max",
            ));
        }
        Ok(spec)
    }
}

fn missing(option: &str) -> Failure {
    Failure::trouble(
        "usage",
        format_args!("--{option} is missing, and no job says it: give it, or --job"),
    )
}
