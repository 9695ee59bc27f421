//! `umi scan calibrate sensor`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use clap::{ArgGroup, Args, ValueEnum};
use umi_scan::ScanError;
use umi_scan::calibrate::observations;
use umi_scan::calibrate::sensor::{Artefact, SensorAnswer, SensorOptions, sensor};
use umi_scan::format::machine;
use umi_scan::format::table::TableReader;

use super::super::super::Format;
use super::super::answer::answer;

/// Where the sensor sits on the machine, from planes or balls that it saw
#[derive(Args)]
#[command(after_help = HELP, group = ArgGroup::new("radius").multiple(false))]
pub(crate) struct Sensor {
    /// profile,feature,x_mm,z_mm: points of profiles that lie on a feature
    #[arg(value_name = "OBSERVATIONS.csv")]
    observations: PathBuf,
    /// profile and a column for each joint, in mm and degrees
    #[arg(value_name = "POSITIONS.csv")]
    positions: PathBuf,
    /// The machine file; its [sensor] is where to start from, right within 6° and 20 mm
    #[arg(long, value_name = "MACHINE.toml")]
    machine: PathBuf,
    /// What the features are
    #[arg(long, value_enum)]
    on: On,
    /// The radius of the balls
    #[arg(long, value_name = "R", group = "radius", value_parser = radius)]
    radius_mm: Option<f64>,
    /// The radius of the balls is unknown: find it, too
    #[arg(long, group = "radius")]
    radius_free: bool,
    /// feature,x_mm,y_mm,z_mm: centres that are known, as the touch probe found them
    #[arg(long, value_name = "CENTRES.csv")]
    centres: Option<PathBuf>,
    /// Components of the shift that stay as the machine file has them
    #[arg(long, value_name = "tx,ty,tz", value_delimiter = ',', value_enum)]
    hold: Vec<Component>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
What can be seen: on 3 axes with an artefact of unknown place the turn only, and a plane
does not show the turn about its normal; one rotary axis shows all but the shift along it;
two rotary axes that moved, and a ball or an inclined plane, show all; balls whose centres
are known show all, too. What the data leave open is refused by name, however small the
residuals are.

Examples:
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on plane
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere --radius-free
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere \\
      --radius-mm 12.7 --centres probed.csv
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere \\
      --radius-mm 12.7 --hold tx,ty,tz

Refused (status 2): unidentifiable, uncertain, too_few_points, not_finite, machine,
missing_axis, missing_position, missing_centre, no_convergence.";

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum On {
    /// Planes
    Plane,
    /// Balls
    Sphere,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Component {
    /// Along X of the flange
    Tx,
    /// Along Y
    Ty,
    /// Along Z
    Tz,
}

fn radius(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|radius: &f64| radius.is_finite() && *radius > 0.0)
        .ok_or_else(|| format!("`{text}` is no radius above 0"))
}

impl Sensor {
    pub fn run(self) -> Result<(), Failure> {
        let sphere = self.on == On::Sphere;
        if sphere && self.radius_mm.is_none() && !self.radius_free {
            return Err(Failure::trouble(
                "usage",
                "--on sphere needs --radius-mm R, or --radius-free",
            ));
        }
        if !sphere && (self.radius_mm.is_some() || self.radius_free || self.centres.is_some()) {
            return Err(Failure::trouble(
                "usage",
                "--radius-mm, --radius-free and --centres are for --on sphere",
            ));
        }
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<SensorAnswer, ScanError> {
        let machine = machine::read(&self.machine)?;
        let all = observations::read(
            &machine,
            TableReader::open(&self.observations)?,
            TableReader::open(&self.positions)?,
        )?;
        let centres = match &self.centres {
            Some(path) => Some(observations::read_centres(TableReader::open(path)?)?),
            None => None,
        };
        let held = |component| self.hold.contains(&component);
        let options = SensorOptions {
            on: match self.on {
                On::Plane => Artefact::Plane,
                On::Sphere => Artefact::Sphere,
            },
            radius_mm: self.radius_mm,
            centres,
            hold: [Component::Tx, Component::Ty, Component::Tz].map(held),
        };
        sensor(&all, &machine.sensor, &options)
    }
}

fn text(found: &SensorAnswer) -> String {
    let u = |i: usize| {
        found
            .covariance
            .map_or_else(|| "unknown".into(), |c| format!("{:.2e}", c[i][i].sqrt()))
    };
    let mut text = String::from("[sensor]\nrotation = [");
    for (i, [x, y, z]) in found.rotation.iter().enumerate() {
        let separator = if i > 0 { ", " } else { "" };
        // Writing to a string cannot fail.
        let _ = write!(text, "{separator}[{x}, {y}, {z}]");
    }
    let [x, y, z] = found.translation_mm;
    let _ = writeln!(text, "]\ntranslation_mm = [{x}, {y}, {z}]\n");
    let _ = writeln!(
        text,
        "standard uncertainty: turns {} {} {} rad, shifts {} {} {} mm",
        u(0),
        u(1),
        u(2),
        u(3),
        u(4),
        u(5)
    );
    if let Some(radius) = found.radius_mm {
        let _ = writeln!(text, "radius {radius:.6} mm");
    }
    for feature in &found.features {
        let _ = writeln!(
            text,
            "feature {}: {} points, rms {:.6} mm, largest {:+.6} mm",
            feature.feature, feature.n, feature.rms_mm, feature.max_mm
        );
    }
    let sigma = found
        .sigma_mm
        .map_or_else(|| "unknown".into(), |sigma| format!("{sigma:.6} mm"));
    let _ = writeln!(
        text,
        "{} observations, {} degrees of freedom, standard deviation {sigma}",
        found.n, found.dof
    );
    text
}
