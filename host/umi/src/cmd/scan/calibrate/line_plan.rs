//! `umi scan calibrate plan --machine`: poses for a line scanner's mount.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use umi_scan::ScanError;
use umi_scan::calibrate::poses::{PlannedPoses, PosesQuestion, poses};
use umi_scan::calibrate::sensor::Artefact;
use umi_scan::format::machine;
use umi_scan::rigid::Vec3;

use super::super::triple::{Triple, finite};
use super::sensor::Component;

/// What a line scanner's plan needs.
#[derive(Args)]
#[command(next_help_heading = "For a line scanner")]
pub(super) struct LinePlan {
    /// The machine file; its table `sensor` is where the mount is about
    #[arg(long, value_name = "MACHINE.toml", conflicts_with = "point_sensor")]
    pub machine: Option<PathBuf>,
    /// What is scanned
    #[arg(long, value_enum, default_value = "sphere")]
    on: PlannedArtefact,
    /// The ball's centre, or the plane's middle, in the workpiece frame, mm
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        requires = "machine"
    )]
    at: Option<Triple>,
    /// The plane's normal in the workpiece frame
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "0,0,1",
        allow_hyphen_values = true
    )]
    normal: Triple,
    /// How far from its middle the plane is seen
    #[arg(long, value_name = "MM", default_value_t = 30.0, value_parser = finite)]
    reach_mm: f64,
    /// A rotary axis that moves, and between which angles; the others stay at 0
    #[arg(
        long,
        value_name = "NAME=FROM..TO",
        allow_hyphen_values = true,
        value_parser = swing
    )]
    swing: Vec<(String, f64, f64)>,
    /// How long the laser line is
    #[arg(long, value_name = "MM", default_value_t = 60.0, value_parser = finite)]
    field_mm: f64,
    /// How deep the sensor sees
    #[arg(long, value_name = "MM", default_value_t = 50.0, value_parser = finite)]
    depth_mm: f64,
    /// z of the middle of what it sees, in its frame
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        value_parser = finite
    )]
    middle_mm: f64,
    /// Profiles
    #[arg(long, value_name = "N", default_value_t = 30)]
    poses: usize,
    /// Samples of each that will be used
    #[arg(long, value_name = "N", default_value_t = 60)]
    samples: usize,
    /// Expected standard deviation of a sample's distance from the artefact
    #[arg(long, value_name = "MM", default_value_t = 0.005, value_parser = finite)]
    noise_mm: f64,
    /// The ball's centre will be known
    #[arg(long)]
    known: bool,
    /// Components of the shift that will be held
    #[arg(long, value_name = "tx,ty,tz", value_delimiter = ',', value_enum)]
    hold: Vec<Component>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PlannedArtefact {
    /// A plane
    Plane,
    /// A ball
    Sphere,
}

fn swing(text: &str) -> Result<(String, f64, f64), String> {
    let wrong = || format!("`{text}` is no swing: A=-30..30");
    let (name, range) = text.split_once('=').ok_or_else(wrong)?;
    let (from, to) = range.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| finite(text).map_err(|_| wrong());
    Ok((name.trim().to_owned(), number(from)?, number(to)?))
}

impl LinePlan {
    /// Plans, and writes the positions.
    pub fn make(
        &self,
        machine: &Path,
        radius_mm: Option<f64>,
        output: &Path,
    ) -> Result<PlannedPoses, ScanError> {
        let machine = machine::read(machine)?;
        let missing = |what: &str| ScanError::unreadable("usage", what);
        let at = self
            .at
            .ok_or_else(|| missing("--machine needs --at X,Y,Z"))?;
        let on = match self.on {
            PlannedArtefact::Plane => Artefact::Plane,
            PlannedArtefact::Sphere => Artefact::Sphere,
        };
        let radius_mm = match on {
            Artefact::Sphere => {
                radius_mm.ok_or_else(|| missing("--on sphere needs --radius-mm R"))?
            }
            Artefact::Plane => 0.0,
        };
        let question = PosesQuestion {
            on,
            at_mm: Vec3::from(at.0),
            radius_mm,
            normal: Vec3::from(self.normal.0),
            plane_reach_mm: self.reach_mm,
            swings: self.swing.clone(),
            field_mm: self.field_mm,
            range_mm: self.depth_mm,
            stand_off_mm: self.middle_mm,
            poses: self.poses,
            samples: self.samples,
            sigma_mm: self.noise_mm,
            hold: Component::held(&self.hold),
            known: self.known,
        };
        let plan = poses(&machine, &question)?;
        let mut table = format!("profile,{}\n", plan.joints.join(","));
        for (number, pose) in plan.poses.iter().enumerate() {
            let values: Vec<String> = pose.iter().map(f64::to_string).collect();
            // Writing to a string cannot fail.
            let _ = writeln!(table, "{number},{}", values.join(","));
        }
        std::fs::write(output, table).map_err(|error| ScanError::file("write", output, &error))?;
        Ok(plan)
    }
}

pub(super) fn text(plan: &PlannedPoses) -> String {
    let [wx, wy, wz] = plan.u_turn_rad.map(|u| u * 1e3);
    let [x, y, z] = plan.u_shift_mm.map(|u| u * 1e3);
    format!(
        "{} poses, {} samples on the artefact, conditioning {:.1e}\n\
         expected u of the turns   {wx:.4}  {wy:.4}  {wz:.4} mrad\n\
         expected u of the shifts  {x:.2}  {y:.2}  {z:.2} um\n",
        plan.poses.len(),
        plan.observations,
        plan.conditioning
    )
}
