//! `umi scan kinematics`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::Plain;
use clap::Args;
use serde::Serialize;
use umi_scan::ScanError;
use umi_scan::format::table::TableReader;
use umi_scan::plan::poses::{ForwardPose, InversePose, forward, inverse};
use umi_scan::plan::spec::ScanSpec;

use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// Axis values for poses of the sensor on the part, with all branches, or poses for axis values
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Kinematics {
    /// Part, sensor, plan and machine, as `umi scan plan` takes them
    #[arg(long, value_name = "SPEC.toml")]
    spec: PathBuf,
    #[command(flatten)]
    way: Way,
    #[command(flatten)]
    pub format: Format,
}

#[derive(Args)]
#[group(required = true, multiple = false)]
struct Way {
    /// Poses in the part's frame: ox_mm,oy_mm,oz_mm,bx,by,bz and, where the line matters, lx,ly,lz
    #[arg(long, value_name = "POSES.csv")]
    inverse: Option<PathBuf>,
    /// Axis values: a column for each axis by its name (S: the spindle), in mm and degrees
    #[arg(long, value_name = "AXES.csv")]
    forward: Option<PathBuf>,
}

const HELP: &str = "\
Examples:
  umi scan kinematics --spec spec.toml --forward axes.csv
  umi scan kinematics --spec spec.toml --inverse poses.csv --json | jq '.poses[0].solutions'

Beam and line are unit vectors at a right angle, by six decimals; others are refused (bad_pose).

--forward: `status` of each pose is ok, or axis_limit where an axis is beyond its limits; the pose is told all the same.

--inverse: for each pose there is one set of axis values for every branch within the limits, angles nearest to
zero. At a pole, where an axis is free, there is one set with that axis at zero, and `singular` says so.

Exit status: 0 answered, 1 usage or a file that cannot be read, 2 refused: bad_spec, sensor_spec,
plan_spec, machine_spec, bad_pose, not_finite.";

#[derive(Serialize)]
struct Answer {
    kind: &'static str,
    poses: Poses,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Poses {
    Forward(Vec<ForwardPose>),
    Inverse(Vec<InversePose>),
}

impl Kinematics {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<Answer, ScanError> {
        let machine = ScanSpec::open(&self.spec)?.machine;
        let poses = match (&self.way.inverse, &self.way.forward) {
            (Some(poses), _) => Poses::Inverse(inverse(&machine, TableReader::open(poses)?)?),
            (None, Some(axes)) => Poses::Forward(forward(&machine, TableReader::open(axes)?)?),
            // The group above lets neither through.
            (None, None) => Poses::Forward(Vec::new()),
        };
        Ok(Answer {
            kind: "kinematics",
            poses,
        })
    }
}

fn text(found: &Answer) -> String {
    let mut text = String::new();
    let three = |v: &[f64; 3]| {
        format!(
            "{:13.6} {:13.6} {:13.6}",
            Plain(v[0]),
            Plain(v[1]),
            Plain(v[2])
        )
    };
    // Writing to a string cannot fail.
    match &found.poses {
        Poses::Forward(poses) => {
            for (number, p) in poses.iter().enumerate() {
                let _ = writeln!(
                    text,
                    "{number}: {}, origin {} mm\n   beam   {}\n   line   {}",
                    p.status,
                    three(&p.origin_mm),
                    three(&p.beam),
                    three(&p.line)
                );
            }
        }
        Poses::Inverse(poses) => {
            for (number, p) in poses.iter().enumerate() {
                let pole = if p.singular {
                    " (a pole: an axis is free)"
                } else {
                    ""
                };
                let _ = writeln!(text, "{number}: {}{pole}", p.status);
                for solution in &p.solutions {
                    text.push_str("  ");
                    for (name, value) in solution {
                        let _ = write!(
                            text,
                            " {name} {:.6}",
                            Plain(value.as_f64().unwrap_or(f64::NAN))
                        );
                    }
                    text.push('\n');
                }
            }
        }
    }
    text
}
