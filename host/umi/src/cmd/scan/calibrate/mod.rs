//! `umi scan calibrate`

mod axis;
mod axis_page;
mod centres;
mod line_plan;
mod observe;
mod plan;
mod point;
mod residual_page;
mod sensor;
mod written;

use crate::failure::Failure;
use clap::{Args, Subcommand};

/// Where the sensor sits on the machine, and how a rotary axis lies
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi scan calibrate plan --machine m.toml --at 40,25,30 --radius-mm 12.7 --swing A=-30..30 \\
      --swing C=-180..180 -o poses.csv
  umi scan calibrate observe ball.gocator scan.csv --machine m.toml --on sphere --radius-mm 12.7 \\
      -o seen.csv --positions positions.csv
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere --radius-mm 12.7
  umi scan calibrate centres turned.gocator scan.csv --machine m.toml --axis C \\
      --radius-mm 12.7 -o centres.csv
  umi scan calibrate axis centres.csv --machine m.toml --axis C -o turned.toml
  umi scan calibrate point readings.csv --spheres ball.toml")]
pub(crate) struct Calibrate {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Observe(Box<observe::Observe>),
    Sensor(sensor::Sensor),
    Axis(axis::Axis),
    Centres(Box<centres::Centres>),
    Point(point::CalibratePoint),
    Plan(Box<plan::Plan>),
}

impl Calibrate {
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Observe(command) => command.run(),
            What::Sensor(command) => command.run(),
            What::Axis(command) => command.run(),
            What::Centres(command) => command.run(),
            What::Point(command) => command.run(),
            What::Plan(command) => command.run(),
        }
    }
}
