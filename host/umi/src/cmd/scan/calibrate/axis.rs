//! `umi scan calibrate axis`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::Plain;
use clap::Args;
use umi_scan::ScanError;
use umi_scan::calibrate::axis::{AxisAnswer, axis, read};
use umi_scan::format::table::TableReader;

use super::super::super::Format;
use super::super::answer::answer;

/// The line of a rotary axis, from centres of balls that turn with it
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Axis {
    /// angle_deg,ball,x_mm,y_mm,z_mm: centres in the machine frame at angles of the axis, as `calibrate centres` finds
    /// them in a scan
    #[arg(value_name = "CENTRES.csv")]
    centres: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The direction is the one about which the angle turns right-handed; the point is the foot of
the machine's origin on the axis. Both go into [[joint]] of the machine file.

Where an angle has the centres of several balls, or one several times, the angles are held against
one another (`misfit`: an F test of a shift for each angle). Where they disagree, a warning names the
worst, and `cov_direction_poses`, `cov_point_poses` say how uncertain the axis is by their scatter.

Examples:
  umi scan calibrate axis centres.csv
  umi scan calibrate centres ball.gocator scan.csv --machine m.toml --axis C \\
      --radius-mm 12.7 -o centres.csv
  umi scan calibrate axis centres.csv --json | jq .point_mm

Refused (status 2): too_few_points, unidentifiable, not_finite, angle_unit, no_convergence.";

impl Axis {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<AxisAnswer, ScanError> {
        axis(&read(TableReader::open(&self.centres)?)?)
    }
}

fn text(found: &AxisAnswer) -> String {
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
    let sigma = found
        .sigma_mm
        .map_or_else(|| "unknown".into(), |sigma| format!("{sigma:.6} mm"));
    for warning in &found.warnings {
        text += &format!("\nwarning: {warning}\n");
    }
    text + &format!(
        "\n{} centres, {} degrees of freedom, standard deviation {sigma}\n",
        found.n, found.dof
    )
}
