//! `umi scan calibrate`

mod axis;
mod plan;
mod point;
mod sensor;

use crate::failure::Failure;
use clap::{Args, Subcommand};

/// Where the sensor sits on the machine, and how a rotary axis lies
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere --radius-mm 12.7
  umi scan calibrate axis centres.csv
  umi scan calibrate point readings.csv --spheres ball.toml")]
pub(crate) struct Calibrate {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Sensor(sensor::Sensor),
    Axis(axis::Axis),
    Point(point::CalibratePoint),
    Plan(plan::Plan),
}

impl Calibrate {
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Sensor(command) => command.run(),
            What::Axis(command) => command.run(),
            What::Point(command) => command.run(),
            What::Plan(command) => command.run(),
        }
    }
}
