//! `umi scan calibrate point`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use clap::{Args, ValueEnum};
use umi_core::point::{PointQuestion, ResidualNoise};
use umi_scan::ScanError;
use umi_scan::point_sensor::calibration::{self, CalibrationQuestion, PointSensorCalibration};
use umi_scan::point_sensor::{readings, spheres};

use super::super::super::Format;
use super::super::answer::answer;
use super::super::triple::{Triple, finite};
use crate::show::terminal::{coverage_95, dof};

/// Offset and beam direction of a point distance sensor, from its readings of balls
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct CalibratePoint {
    /// Readings in mm, a line each: x,y,z,gamma and, where there is more, sphere, snr, total
    #[arg(value_name = "READINGS.csv")]
    readings: PathBuf,
    /// The balls: `[[sphere]]` with id, center_mm, radius_mm and, where known, u_center_mm, u_radius_mm
    #[arg(long, value_name = "SPHERES.toml")]
    spheres: PathBuf,
    /// Find an error of the radius (one ball), or the gain of the readings, too
    #[arg(long, value_enum)]
    free: Vec<Free>,
    /// Rough direction of the beam
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "0,0,-1",
        allow_hyphen_values = true
    )]
    direction: Triple,
    /// Leave out readings whose snr is below this
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = finite)]
    min_snr: Option<f64>,
    /// Refuse an rms above this
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = length)]
    max_rms: Option<f64>,
    /// Where the scatter comes from: alike everywhere, or the sensor's own along its beam
    #[arg(long, value_enum, default_value = "everywhere")]
    noise: NoiseKind,
    #[command(flatten)]
    pub format: Format,
}

/// A limit that something can be above and below.
fn length(text: &str) -> Result<f64, String> {
    let length = text.trim().parse().ok();
    length
        .filter(|mm: &f64| mm.is_finite() && *mm > 0.0)
        .ok_or_else(|| "a length in mm above 0 is needed".to_owned())
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Free {
    Radius,
    Gain,
}

#[derive(Clone, Copy, ValueEnum)]
enum NoiseKind {
    Everywhere,
    AlongBeam,
}

const HELP: &str = "\
Examples:
  umi scan calibrate point readings.csv --spheres ball.toml
  umi scan calibrate point readings.csv --spheres ball.toml --json > sensor.json
  umi scan points more.csv --calibration sensor.json -o cloud.csv

Measure 13 places or more over a cone of 90 degrees of the ball, at two stand-offs or more. With fewer than 12
(two more for --free gain and --free radius) the scatter is hardly known, and `weak: few readings` says how far u reaches.
Refused (status 2): too_few_points, ambiguous, not_finite, not_a_number, missing_column,
bad_sphere, center_unknown, unknown_sphere, coincident_points, range_not_varied,
great_circle, one_circle, degenerate, residual_too_large, no_convergence.";

impl CalibratePoint {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<PointSensorCalibration, ScanError> {
        let balls = spheres::read(&self.spheres)?;
        let readings = readings::read(&self.readings, self.min_snr)?;
        let question = CalibrationQuestion {
            wanted: PointQuestion {
                direction: self.direction.0.into(),
                free_radius: self.free.contains(&Free::Radius),
                free_gain: self.free.contains(&Free::Gain),
                noise: match self.noise {
                    NoiseKind::Everywhere => ResidualNoise::Everywhere,
                    NoiseKind::AlongBeam => ResidualNoise::AlongBeam,
                },
            },
            max_rms_mm: self.max_rms,
        };
        calibration::find(&readings, &balls, &question)
    }
}

fn text(found: &PointSensorCalibration) -> String {
    let mut text = String::new();
    let mut line = |label: &str, numbers: &[f64], digits: usize, unit: &str| {
        let numbers: Vec<_> = numbers.iter().map(|x| format!("{x:.digits$}")).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{label:<18}{} {unit}", numbers.join("  "));
    };
    line("offset", &found.offset_mm, 6, "mm");
    line("direction", &found.direction, 9, "");
    line("gain", &[found.gain], 9, "");
    if let Some(radius) = found.radius_mm {
        line("radius", &[radius], 6, "mm");
    }
    line("rms", &[found.rms_mm * 1e3], 4, "um");
    if let Some(sigma) = found.sigma_mm {
        line("sigma", &[sigma * 1e3], 4, "um");
    }
    if let Some(total) = found.covariance_total {
        let u = [0, 1, 2].map(|k: usize| total[k][k].max(0.0).sqrt() * 1e3);
        line("u of the offset", &u, 3, "um");
    }
    if let Some(u) = found.u_point_mm {
        let label = format!("u at {:.2} mm", found.stand_off_mm);
        line(
            &label,
            &u.map(|u| u * 1e3),
            3,
            "um (a point at that reading)",
        );
    }
    if let (Some(_), Some(factor)) = (found.sigma_mm, coverage_95(found.dof as u64)) {
        let _ = writeln!(
            text,
            "95 % interval     {factor:.2} x u (Student's t, {})",
            dof(found.dof as u64)
        );
    }
    let _ = writeln!(text, "{} of {} readings used", found.used, found.n);
    for warning in &found.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}
