//! `umi scan calibrate sensor`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::Plain;
use clap::{ArgGroup, Args, ValueEnum};
use umi_scan::ScanError;
use umi_scan::calibrate::bar::BallBar;
use umi_scan::calibrate::misfit::Misfit;
use umi_scan::calibrate::observations::{self, Observations};
use umi_scan::calibrate::sensor::{Artefact, SensorAnswer, SensorOptions, sensor};
use umi_scan::format::machine;
use umi_scan::format::table::TableReader;

use super::super::super::Format;
use super::super::answer::answer;
use super::residual_page::page;
use super::written::{Written, text_of};

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
    /// Two features that are the balls of a bar, its certified length, and how far the length that
    /// is found may be off; may be given again for another bar
    #[arg(long, value_name = "A,B,MM,WITHIN", value_parser = BallBar::parse)]
    bar: Vec<BallBar>,
    /// Answer also where the poses disagree so much that the mount is wrong by more than its uncertainty
    #[arg(long)]
    allow_misfit: bool,
    /// Leave out samples that lie off all others, 19 at most, and say which
    #[arg(long)]
    drop_outliers: bool,
    #[command(flatten)]
    written: Written,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
What can be seen: on 3 axes with an artefact of unknown place the turn only, and a plane
does not show the turn about its normal; one rotary axis shows all but the shift along it;
two rotary axes that moved, and a ball or an inclined plane, show all; balls whose centres
are known show all, too. What the data leave open is refused by name, however small the
residuals are.

A profile of a plane is a line and shows two numbers; unknown are the six of the mount and three of each
plane. Where profiles show no more than that, or where two mounts fit alike, none is answered (`uncertain`):
take more profiles, each with the rotary axes at other angles.

The zero of the axis next to the sensor cannot be seen: turned or shifted by as much, the mount gives the same
points. A wrong one goes into the mount, which is right with just that zero: calibrate again when it changes.

Examples:
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on plane
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere --radius-free
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere \\
      --radius-mm 12.7 --centres probed.csv
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere \\
      --radius-mm 12.7 --hold tx,ty,tz
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere \\
      --radius-mm 12.7 -o calibrated.toml --report residuals.html
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere \\
      --radius-mm 10 --bar 0,1,249.532,0.005

`covariance` reckons with residuals that are alike, as `sigma_mm` says; `covariance_scatter` takes
each for itself, and holds also where noise grows with the distance. The machine file gets the
latter; `umi scan merge` tells then what the mount makes of a point's uncertainty.

Small residuals do not make a mount right: a zero of an axis that is wrong by 0.05 degrees moves it
by 0.1 mm and leaves some micrometres. `misfit` holds the poses against one another (F test of a mean
for each; one false alarm in 1000), names the worst, and what must be added to which zero, place,
direction or scale of an axis to bring them together, if one does. Where they disagree, the machine
file gets `covariance_poses`, by the scatter of whole poses; it knows nothing of what is wrong in all
of them alike. What is off at one place of the line in every profile is told where its mean is larger than
single samples scatter. Refused are poses that scatter ten times as much as the samples within them, one that
lies off so far, and a slip of an axis that moves the mount by more than five of its standard uncertainties.
Samples that lie off all others are named (`outliers`): beyond six times what nine of ten residuals stay below,
some ten standard deviations. Such a mount goes into no file (-o) unless they are left out by --drop-outliers, nor does
one that the covariance of the file has more uncertain than 1 mrad or 1 mm.
Samples must err each for itself. Of speckle, neighbours share their error: take every tenth or so of a profile
(`observe` takes 60 spread over it), or poses seem to disagree.

Refused (status 2): unidentifiable, uncertain, too_few_points, not_finite, machine,
missing_axis, missing_position, missing_centre, no_convergence, angle_unit, far_from_start,
bar_length, misfit, outlier.";

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum On {
    /// Planes
    Plane,
    /// Balls
    Sphere,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Component {
    /// Along X of the flange
    Tx,
    /// Along Y
    Ty,
    /// Along Z
    Tz,
}

impl Component {
    /// Which of tx, ty, tz are held.
    pub fn held(hold: &[Self]) -> [bool; 3] {
        [Self::Tx, Self::Ty, Self::Tz].map(|component| hold.contains(&component))
    }
}

/// A length above 0.
pub(super) fn radius(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|radius: &f64| radius.is_finite() && *radius > 0.0)
        .ok_or_else(|| format!("`{text}` is no length above 0"))
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
        let of_balls = self.radius_mm.is_some()
            || self.radius_free
            || self.centres.is_some()
            || !self.bar.is_empty();
        if !sphere && of_balls {
            return Err(Failure::trouble(
                "usage",
                "--radius-mm, --radius-free, --centres and --bar are for --on sphere",
            ));
        }
        if self.centres.is_some() && !self.bar.is_empty() {
            return Err(Failure::trouble(
                "usage",
                "where the centres are known, they say how long a bar is: --bar is without --centres",
            ));
        }
        let inputs = [&*self.observations, &*self.positions, &*self.machine];
        self.written.check(&inputs)?;
        answer(self.make(), self.format.json, text)
    }

    fn make(&self) -> Result<SensorAnswer, ScanError> {
        let (found, all) = self.find()?;
        if self.written.output.is_some() {
            found.refuse_doubtful()?;
        }
        self.written.write(
            || residuals(&found, &all),
            || page(&found, &all),
            || {
                let text = text_of(&self.machine)?;
                machine::with_sensor(&text, &found.mount(), found.best_covariance())
            },
        )?;
        Ok(found)
    }

    fn find(&self) -> Result<(SensorAnswer, Observations), ScanError> {
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
        let options = SensorOptions {
            on: match self.on {
                On::Plane => Artefact::Plane,
                On::Sphere => Artefact::Sphere,
            },
            radius_mm: self.radius_mm,
            centres,
            hold: Component::held(&self.hold),
            bars: self.bar.clone(),
            allow_misfit: self.allow_misfit,
            drop_outliers: self.drop_outliers,
        };
        let found = sensor(&all, &machine.sensor, &options)?;
        Ok((found, all))
    }
}

/// A row for each observation, in their order.
fn residuals(found: &SensorAnswer, all: &Observations) -> String {
    let mut text = String::from("profile,feature,x_mm,z_mm,residual_mm\n");
    for (point, residual) in all.points.iter().zip(&found.residuals_mm) {
        let residual = if residual.is_nan() {
            String::new()
        } else {
            residual.to_string()
        };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{residual}",
            all.profiles[point.flange],
            all.features[point.feature],
            point.seen_mm.x,
            point.seen_mm.z
        );
    }
    text
}

fn text(found: &SensorAnswer) -> String {
    let u = |i: usize| {
        found
            .best_covariance()
            .map_or_else(|| "unknown".into(), |c| format!("{:.2e}", c[i][i].sqrt()))
    };
    let mut text = String::from("[sensor]\nrotation = [");
    for (i, row) in found.rotation.iter().enumerate() {
        let [x, y, z] = row.map(Plain);
        let separator = if i > 0 { ", " } else { "" };
        // Writing to a string cannot fail.
        let _ = write!(text, "{separator}[{x}, {y}, {z}]");
    }
    let [x, y, z] = found.translation_mm.map(Plain);
    let _ = writeln!(text, "]\ntranslation_mm = [{x}, {y}, {z}]\n");
    let _ = writeln!(
        text,
        "standard uncertainty: turns {} {} {} rad, shifts {} {} {} mm (by the scatter of the {})",
        u(0),
        u(1),
        u(2),
        u(3),
        u(4),
        u(5),
        if found.misfit.as_ref().is_some_and(Misfit::stands_out) {
            "poses"
        } else {
            "residuals"
        }
    );
    if let Some(radius) = found.radius_mm {
        let _ = writeln!(text, "radius {radius:.6} mm");
    }
    for warning in &found.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    for bar in &found.bars {
        let u = bar
            .u_mm
            .map_or_else(|| "unknown".into(), |u| format!("{u:.6} mm"));
        let _ = writeln!(
            text,
            "bar {}-{}: {:.6} mm, {:+.6} mm from its certificate, standard uncertainty {u}",
            bar.balls[0],
            bar.balls[1],
            bar.found_mm,
            Plain(bar.off_mm)
        );
    }
    for feature in &found.features {
        let _ = writeln!(
            text,
            "feature {}: {} points, rms {:.6} mm, largest {:+.6} mm",
            feature.feature,
            feature.n,
            feature.rms_mm,
            Plain(feature.max_mm)
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
