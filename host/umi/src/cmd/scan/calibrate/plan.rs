//! `umi scan calibrate plan`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::Force;
use clap::Args;
use umi_scan::ScanError;
use umi_scan::point_sensor::plan::{PlanQuestion, SensorPlan, plan};
use umi_scan::point_sensor::program::{ProgramLanguage, program};

use super::super::super::Format;
use super::super::super::machine::check::Language;
use super::super::answer::answer;
use super::super::point::warned;
use super::super::triple::{Triple, finite};
use super::line_plan::{self, LinePlan};

/// Places from which a calibration is well determined, and the uncertainty to expect
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Plan {
    /// For a point distance sensor
    #[arg(long, required_unless_present = "machine")]
    point_sensor: bool,
    /// Centre of the ball in machine coordinates, mm, from the touch probe
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        required_unless_present = "machine"
    )]
    ball: Option<Triple>,
    /// Radius of the ball
    #[arg(long, value_name = "MM", required_unless_present = "machine", value_parser = finite)]
    radius_mm: Option<f64>,
    /// Standard uncertainty of the centre along each axis
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = finite)]
    u_center_mm: f64,
    /// Rough offset from the position of the axes to the zero of the readings, mm
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        required_unless_present = "machine"
    )]
    offset: Option<Triple>,
    /// Rough direction of the beam
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "0,0,-1",
        allow_hyphen_values = true
    )]
    direction: Triple,
    /// Middle of the depth of field
    #[arg(long, value_name = "MM", default_value_t = 44.0, value_parser = finite)]
    stand_off_mm: f64,
    /// Depth of field
    #[arg(long, value_name = "MM", default_value_t = 8.0, value_parser = finite)]
    range_mm: f64,
    /// Half the angle that the sensor sees, degrees
    #[arg(long, value_name = "DEG", default_value_t = 85.0, value_parser = finite)]
    angle_deg: f64,
    /// Different stand-offs
    #[arg(long, value_name = "N", default_value_t = 3)]
    stand_offs: usize,
    /// Places altogether
    #[arg(long, value_name = "N", default_value_t = 25)]
    places: usize,
    /// Expected standard deviation of a distance from the ball
    #[arg(long, value_name = "MM", default_value_t = 0.001, value_parser = finite)]
    sigma_mm: f64,
    /// Least step of the axes
    #[arg(long, value_name = "MM", default_value_t = 0.001, value_parser = finite)]
    increment_mm: f64,
    /// Height to approach from, machine coordinates
    #[arg(
        long,
        value_name = "MM",
        allow_hyphen_values = true,
        required_unless_present = "machine",
        value_parser = finite
    )]
    safe_z: Option<f64>,
    /// The control that reads a point sensor's program
    #[arg(long, value_enum, default_value = "fanuc")]
    control: Language,
    #[command(flatten)]
    line: LinePlan,
    /// Where the program goes, or a line scanner's positions (profile and the joints)
    #[arg(short, long, value_name = "PROGRAM.nc|POSITIONS.csv")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi scan calibrate plan --point-sensor --ball 210,-98.6,-614.5 --radius-mm 10 \\
    --offset 3,-54,-138 --safe-z -300 -o calibrate.nc
  umi scan calibrate plan --point-sensor --ball 210,-98.6,-614.5 --radius-mm 10 \\
    --offset 3,-54,-138 --safe-z -300 --control linuxcnc -o calibrate.ngc
  umi scan calibrate plan --machine m.toml --at 40,25,30 --radius-mm 12.7 --swing A=-30..30 \\
    --swing C=-180..180 --noise-mm 0.005 -o poses.csv
  umi scan calibrate plan --machine m.toml --on plane --at 0,0,0 --normal 0.3,-0.2,1 \\
    --swing A=-30..30 --swing C=-180..180 -o poses.csv

A point sensor's program halts at each place for half a second and says where the axes stand: on Fanuc, Haas,
Mitsubishi and Mazak by DPRNT, on LinuxCNC in the file umi-calibration.csv beside the interpreter. GRBL says
nothing: there the program stops at each place (M0; go on by ~), and the place stands in a comment. Write the
sensor's mean reading of each halt beside the place, in mm: x,y,z,gamma, a line each, under a header.
That is the READINGS.csv of umi scan calibrate point.

For a line scanner the poses go through the calibration itself: what they leave open is refused by
name, with the number of free motions, and so is what would be uncertain at this noise.

Refused (status 2): bad_input, and what umi scan calibrate point would refuse; for a line scanner
machine, missing_axis, unreachable, unidentifiable, uncertain, too_few_points.";

impl Plan {
    pub fn run(self) -> Result<(), Failure> {
        if let Some(machine) = &self.line.machine {
            self.force.check(&self.output, &[machine])?;
            let made = self.line.make(machine, self.radius_mm, &self.output);
            return answer(made, self.format.json, line_plan::text);
        }
        self.force.check(&self.output, &[])?;
        answer(self.make(), self.format.json, text)
    }

    fn make(&self) -> Result<SensorPlan, ScanError> {
        // Clap has made sure that all four are there.
        let (Some(ball), Some(radius_mm), Some(offset), Some(safe_z_mm)) =
            (self.ball, self.radius_mm, self.offset, self.safe_z)
        else {
            return Err(ScanError::unreadable(
                "usage",
                "--point-sensor needs --ball, --radius-mm, --offset and --safe-z",
            ));
        };
        let question = PlanQuestion {
            center_mm: ball.0,
            radius_mm,
            u_center_mm: self.u_center_mm,
            offset_mm: offset.0,
            direction: self.direction.0,
            stand_off_mm: self.stand_off_mm,
            range_mm: self.range_mm,
            angle_deg: self.angle_deg,
            stand_offs: self.stand_offs,
            places: self.places,
            sigma_mm: self.sigma_mm,
            increment_mm: self.increment_mm,
            safe_z_mm,
        };
        let plan = plan(&question)?;
        let language = match self.control {
            Language::Fanuc | Language::Mitsubishi => ProgramLanguage::MacroB,
            Language::Haas => ProgramLanguage::Haas,
            Language::Linuxcnc => ProgramLanguage::LinuxCnc,
            Language::Grbl => ProgramLanguage::Grbl,
        };
        std::fs::write(&self.output, program(&question, &plan, language))
            .map_err(|error| ScanError::file("write", &self.output, &error))?;
        Ok(plan)
    }
}

fn text(plan: &SensorPlan) -> String {
    let mut text = format!("{} places\n", plan.places.len());
    let mut line = |label: &str, [x, y, z]: [f64; 3], unit: &str| {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "expected u of {label:<12}{x:.3}  {y:.3}  {z:.3} {unit}"
        );
    };
    line("the offset", plan.u_offset_mm.map(|u| u * 1e3), "um");
    line("the beam", plan.u_direction.map(|u| u * 1e6), "urad");
    line("a point", plan.u_point_mm.map(|u| u * 1e3), "um");
    text + &warned(&plan.warnings)
}
