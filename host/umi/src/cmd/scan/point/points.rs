//! `umi scan points`

use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::Force;
use clap::Args;
use serde::Serialize;
use umi_scan::ScanError;
use umi_scan::point_sensor::{calibration, cloud, readings};

use super::warned;
use crate::cmd::Format;
use crate::cmd::scan::answer::{answer, failure};
use crate::cmd::scan::triple::finite;

/// Readings of a calibrated point distance sensor to points
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Points {
    /// Readings in mm, a line each: x,y,z,gamma and, where there is more, snr, total
    #[arg(value_name = "READINGS.csv")]
    readings: PathBuf,
    /// What umi scan calibrate point --json has printed
    #[arg(long, value_name = "CAL.json")]
    calibration: PathBuf,
    /// Where the points go: CSV, or PLY by the file's ending
    #[arg(short, long, value_name = "CLOUD.csv")]
    output: PathBuf,
    /// Leave out readings whose snr is below this
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = finite)]
    min_snr: Option<f64>,
    /// Uncertainties with what the balls of the calibration add (covariance_total)
    #[arg(long)]
    total: bool,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi scan points readings.csv --calibration sensor.json -o cloud.csv
  umi scan points readings.csv --calibration sensor.json -o cloud.ply

The columns u_x_mm, u_y_mm, u_z_mm are standard uncertainties. Where the calibration warned `weak: few readings`, its
warning comes again and says how many times them 95 % of errors are within.

Refused (status 2): bad_calibration, missing_column, not_a_number, not_finite, other_lens (a reading more than a quarter
beside those of the calibration).";

/// What was written.
#[derive(Serialize)]
struct Written {
    kind: &'static str,
    points: usize,
    left_out: usize,
    uncertainty: bool,
    /// What the calibration had warned of: it holds for the points as well.
    warnings: Vec<String>,
}

impl Points {
    pub fn run(self) -> Result<(), Failure> {
        cloud::check_ending(&self.output, &["csv", "ply"]).map_err(failure)?;
        self.force
            .check(&self.output, &[&self.readings, &self.calibration])?;
        answer(self.make(), self.format.json, |written| {
            let points = format!("{} points\n", written.points);
            points + &warned(&written.warnings)
        })
    }

    fn make(&self) -> Result<Written, ScanError> {
        let known = calibration::read(&self.calibration)?;
        let readings = readings::read(&self.readings, self.min_snr)?;
        known.check_readings(&readings)?;
        let covariance = if self.total {
            known.covariance_total.as_ref()
        } else {
            known.covariance.as_ref()
        };
        let made = cloud::points(&readings, &known, covariance);
        cloud::write(&self.output, &made)?;
        Ok(Written {
            kind: "points",
            points: made.points.len(),
            left_out: readings.lines - readings.used.len(),
            uncertainty: made.u_mm.is_some(),
            warnings: known.warnings,
        })
    }
}
