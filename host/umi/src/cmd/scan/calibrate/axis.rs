//! `umi scan calibrate axis`

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::show::terminal::Plain;
use clap::Args;
use serde::Serialize;
use umi_scan::ScanError;
use umi_scan::calibrate::axis::{AxisAnswer, AxisMove, TurnedCentres, axis, read};
use umi_scan::format::machine;
use umi_scan::format::table::TableReader;

use super::super::super::Format;
use super::super::answer::answer;
use super::axis_page::{csv, page, said, sigma, table};
use super::written::{Written, text_of};

/// The line of a rotary axis, from centres of balls that turn with it
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Axis {
    /// angle_deg,ball,x_mm,y_mm,z_mm: centres in the machine frame at angles of the axis, as `calibrate centres` finds
    /// them in a scan
    #[arg(value_name = "CENTRES.csv")]
    centres: PathBuf,
    /// The machine file that the axis is of: how it lies beside it, and what -o begins from
    #[arg(long, value_name = "MACHINE.toml", requires = "axis")]
    machine: Option<PathBuf>,
    /// The rotary axis, by its name there
    #[arg(long, value_name = "NAME", requires = "machine")]
    axis: Option<String>,
    #[command(flatten)]
    written: Written,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The direction is the one about which the angle turns right-handed; the point is the foot of
the machine's origin on the axis. Both go into [[joint]] of the machine file.

Where an angle has the centres of several balls, or one several times, the angles are held against
one another (`misfit`: an F test of a shift for each angle). Where they disagree, a warning names the
worst, and `cov_direction_poses`, `cov_point_poses` say how uncertain the axis is by their scatter.

With --machine and --axis the answer says how the axis lies beside the file's, and -o writes the file
with `direction` and `point_mm` of that joint as they were found, all else as it is. An axis that lies
10 degrees or more from the file's, turns the other way, or lies at another joint is another one: refused;
one more than 5 mm off is warned of. What is uncertain by more than 1 mrad or 1 mm is not written, nor what one centre
contradicts (`outlier`: it lies off all others; where its angle alone may be wrong, theirs is told). A mount that was
calibrated while the axis lay elsewhere has that error in it: calibrate the sensor again with the new file.

Examples:
  umi scan calibrate axis centres.csv
  umi scan calibrate centres ball.gocator scan.csv --machine m.toml --axis C \\
      --radius-mm 12.7 -o centres.csv
  umi scan calibrate axis centres.csv --machine m.toml --axis C -o turned.toml --report axis.html
  umi scan calibrate axis centres.csv --residuals residuals.csv
  umi scan calibrate axis centres.csv --json | jq .point_mm

Refused (status 2): too_few_points, unidentifiable, degenerate, not_finite, angle_unit, no_convergence,
machine, missing_axis, other_axis, outlier, uncertain.";

/// The axis, how it lies beside the machine file's, and what it came from.
#[derive(Serialize)]
struct Shown {
    #[serde(flatten)]
    found: AxisAnswer,
    #[serde(skip_serializing_if = "Option::is_none")]
    beside_file: Option<AxisMove>,
    #[serde(skip)]
    all: TurnedCentres,
}

impl Axis {
    pub fn run(self) -> Result<(), Failure> {
        if self.written.output.is_some() && self.machine.is_none() {
            return Err(Failure::trouble(
                "usage",
                "-o writes a machine file with the axis in it: say which file and which joint, --machine FILE --axis NAME",
            ));
        }
        let inputs = [Some(&self.centres), self.machine.as_ref()];
        let inputs: Vec<&Path> = inputs.into_iter().flatten().map(PathBuf::as_path).collect();
        self.written.check(&inputs)?;
        answer(self.make(), self.format.json, text)
    }

    fn make(&self) -> Result<Shown, ScanError> {
        let all = read(TableReader::open(&self.centres)?)?;
        let of = self.machine.as_deref().zip(self.axis.as_deref());
        let chain = of.map(|(path, _)| machine::read(path)).transpose()?;
        let joint = of.zip(chain.as_ref());
        let joint = joint
            .map(|((_, name), chain)| Ok::<_, ScanError>((machine::rotary(chain, name)?, chain)));
        let joint = joint.transpose()?;
        let mut found = axis(&all.centres)?;
        let beside_file = joint.map(|(joint, chain)| found.beside(joint, &chain.joints));
        let beside_file = beside_file.transpose()?;
        let far = beside_file.as_ref().and_then(|beside| found.far(beside));
        found.warnings.extend(far);
        if self.written.output.is_some() {
            found.refuse_doubtful()?;
        }
        self.written.write(
            || csv(&found, &all),
            || page(&found, &all, beside_file.as_ref()),
            || match of {
                Some((path, name)) => {
                    machine::with_axis(&text_of(path)?, name, found.direction, found.point_mm)
                }
                None => Err(ScanError::refused(
                    "missing_axis",
                    "no machine file was given",
                )),
            },
        )?;
        Ok(Shown {
            found,
            beside_file,
            all,
        })
    }
}

fn text(shown: &Shown) -> String {
    let found = &shown.found;
    let u = |covariance: &Option<[[f64; 3]; 3]>, i: usize| {
        covariance.map_or_else(|| "unknown".into(), |c| format!("{:.2e}", c[i][i].sqrt()))
    };
    let mut text = String::from("axis of rotation, with standard uncertainties\n\n");
    for (i, axis) in ["X", "Y", "Z"].iter().enumerate() {
        text += &format!(
            "direction {axis} {:+.9} ± {}\n",
            Plain(found.direction[i]),
            u(&found.cov_direction_poses.or(found.cov_direction), i)
        );
    }
    for (i, axis) in ["X", "Y", "Z"].iter().enumerate() {
        text += &format!(
            "point     {axis} {:+.6} ± {} mm\n",
            Plain(found.point_mm[i]),
            u(&found.cov_point_poses.or(found.cov_point), i)
        );
    }
    if let Some(moved) = &shown.beside_file {
        text += &format!("\nbeside the machine file: {}\n", said(moved));
    }
    text += &format!("\n{}", table(found, &shown.all));
    for warning in &found.warnings {
        text += &format!("\nwarning: {warning}\n");
    }
    text + &format!(
        "\n{} centres, {} degrees of freedom, standard deviation {}\n",
        found.n,
        found.dof,
        sigma(found)
    )
}
