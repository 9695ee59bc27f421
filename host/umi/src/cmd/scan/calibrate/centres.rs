//! `umi scan calibrate centres`

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use umi_scan::ScanError;
use umi_scan::calibrate::observe::centres::{CentresOptions, SeenCentres, centres};
use umi_scan::format::machine;

use super::super::answer::answer;
use super::super::profile::pair::{Latency, Streams};
use super::sensor::radius;
use crate::cmd::Format;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::Plain;

/// The balls at each angle of a rotary axis, straight from a scan, as `calibrate axis` wants them
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Centres {
    #[command(flatten)]
    streams: Streams,
    /// The machine file, with the sensor's mount calibrated
    #[arg(long, value_name = "MACHINE.toml")]
    machine: PathBuf,
    #[command(flatten)]
    latency: Latency,
    /// The rotary axis that carries the part, by its name in the machine file
    #[arg(long, value_name = "NAME")]
    axis: String,
    /// The radius of the balls
    #[arg(long, value_name = "R", value_parser = radius)]
    radius_mm: f64,
    /// A sample within this of the arc may be of it
    #[arg(long, value_name = "MM", default_value_t = 0.05, value_parser = radius)]
    within_mm: f64,
    /// Balls are further apart than this
    #[arg(long, value_name = "MM", default_value_t = 50.0, value_parser = radius)]
    apart_mm: f64,
    /// At most so many samples of a profile, evenly
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    samples: u32,
    /// The axis stands still where it turns by no more; some counts of its encoder
    #[arg(long, value_name = "DEG", default_value_t = 0.002, value_parser = radius)]
    still_deg: f64,
    /// Where the centres go
    #[arg(short, long, value_name = "CENTRES.csv")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Turn the axis to some angles all around, let it stand at each, and let the line go over the ball,
three profiles or more, over 0.3 of its radius at least. One scan holds all of it; what was seen
while the axis turned is counted and left out. Of each ball at each angle the best ball of the
given radius is told.

Centres stand in the frame of what carries the axis, with the joints before it taken back to 0 as
the machine file has them: there the axis lies as in the file. Joints that the axis carries must
stand still. The sensor's mount is taken as the file has it: where it is off by a shift, so is the
axis. Let the ball be at one place of the sensor's field at all angles: then a turn of the mount is
no more than a shift. The balls' radius is held against what they look like (`radius`).

Examples:
  umi scan calibrate centres ball.gocator scan.csv --machine m.toml --axis C \\
      --radius-mm 12.7 -o centres.csv
  umi scan calibrate axis centres.csv

Refused (status 2): as `umi scan pair`, machine, missing_axis, motion_lost, moved, too_few_points.";

impl Centres {
    pub fn run(self) -> Result<(), Failure> {
        let inputs = [
            &*self.machine,
            &*self.streams.profiles,
            &*self.streams.triggers,
        ];
        self.force.check(&self.output, &inputs)?;
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<SeenCentres, ScanError> {
        let machine = machine::read(&self.machine)?;
        let triggers = self.streams.read_triggers()?;
        let options = CentresOptions {
            pairing: self.streams.options(),
            latency_us: self.latency.latency_us,
            axis: self.axis.clone(),
            radius_mm: self.radius_mm,
            within_mm: self.within_mm,
            apart_mm: self.apart_mm,
            samples: self.samples as usize,
            still_deg: self.still_deg,
        };
        let seen = centres(&self.streams.profiles, &triggers, &machine, &options)?;
        std::fs::write(&self.output, seen.table())
            .map_err(|error| ScanError::file("write", &self.output, &error))?;
        Ok(seen)
    }
}

fn text(seen: &SeenCentres) -> String {
    let mut text = String::new();
    for c in &seen.centres {
        let [x, y, z] = c.centre_mm.map(Plain);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{} {:.4}: ball {} at {x:.4} {y:.4} {z:.4} mm, {} profiles, rms {:.4} mm, u {:.4} mm",
            seen.axis,
            Plain(c.angle_deg),
            c.ball,
            c.profiles,
            c.rms_mm,
            c.u_mm
        );
    }
    let used: u64 = seen.centres.iter().map(|c| c.profiles).sum();
    let _ = writeln!(
        text,
        "{} centres of {used} of {} profiles with a latch; left out: {} without an arc, {} while the axis turned or over too \
         little of a ball, {} of no ball",
        seen.centres.len(),
        seen.paired,
        seen.nothing_found,
        seen.too_narrow,
        seen.no_ball
    );
    for warning in &seen.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}
