//! `umi scan`

pub(in crate::cmd) mod answer;
mod calibrate;
mod cloud;
mod demo;
mod machine;
mod path;
mod place;
mod point;
mod profile;
mod triple;

pub(super) use answer::failure;
pub(super) use place::{report::html as placed_page, stock_page::page as stock_page};

use crate::failure::Failure;
use crate::interrupt;
use clap::{Args, Subcommand};

/// A scanner on the machine: profiles and positions to points, calibration, comparison, scan paths
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi scan record --sensor tcp:192.168.1.10 -o scan --trigger-every-mm 0.1 --axis y
  umi scan pair part.gocator scan.csv
  umi scan merge part.gocator scan.csv --machine machine.toml -o cloud.ply
  umi scan calibrate sensor seen.csv positions.csv --machine machine.toml --on plane
  umi scan compare cloud.ply --nominal part.stl
  umi scan report cloud.ply --nominal part.stl --limits -0.05,0.05 -o page.html
  umi scan filter cloud.csv --spike 0.5 -o clean.ply
  umi scan crop cloud.ply --box -10,-10,0,60,40,25 -o part.ply
  umi scan sample cloud.ply --voxel 0.5 -o even.ply
  umi scan convert cloud.ply -o cloud.laz
  umi scan machine new c800u -o machine.toml
  umi scan pose machine.toml positions.csv
  umi scan calibrate point readings.csv --spheres ball.toml --json > sensor.json
  umi scan localise scan.ply --fiducials table.toml --part part.stl -o moved.json
  umi scan digitize --scene scene.toml --calibration sensor.json --strategy adaptive \\
    --at -8,-8,223.5 --size 16,16 --step 2,2 -o cloud.csv
  umi scan points readings.csv --calibration sensor.json -o cloud.csv
  umi scan serve --sensor sensor.toml --calibration sensor.json -o cloud.csv
  umi scan stock part.stl raw.ply --require 0.5
  umi scan simulate cell.toml -o scan.ply
  umi scan plan part.stl --spec spec.toml -o path.csv
  umi scan drive part.stl --spec spec.toml path.csv -o cloud.ply

A cloud is NAME.part until it is complete. An interrupt takes that away; what a killed run left, the next one
to the same name takes the place of. Nothing reads it.

Exit status: 0 answered, 1 usage or a file that cannot be understood, 2 refused.")]
pub(crate) struct Scan {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Record(Box<profile::record::Record>),
    Demo(demo::Demo),
    Pair(profile::pair::Pair),
    Merge(profile::merge::Merge),
    Calibrate(calibrate::Calibrate),
    Compare(cloud::compare::Compare),
    Report(Box<cloud::report::Report>),
    Digitize(Box<point::digitize::Digitize>),
    Filter(cloud::filter::Filter),
    Crop(cloud::crop::Crop),
    Sample(cloud::sample::Sample),
    Convert(cloud::convert::Convert),
    Kinematics(path::kinematics::Kinematics),
    Points(point::points::Points),
    Serve(Box<point::serve::Serve>),
    Pose(profile::pose::Pose),
    Machine(machine::Machine),
    Localise(Box<place::localise::Localise>),
    Simulate(place::simulate::Simulate),
    Stock(Box<place::stock::Stock>),
    Plan(Box<path::plan::Plan>),
    Verify(path::verify::Verify),
    Drive(Box<path::drive::Drive>),
}

impl Scan {
    pub fn run(self) -> Result<(), Failure> {
        interrupt::leave_nothing_unfinished();
        match self.what {
            What::Record(command) => command.run(),
            What::Demo(command) => command.run(),
            What::Pair(command) => command.run(),
            What::Merge(command) => command.run(),
            What::Calibrate(command) => command.run(),
            What::Compare(command) => command.run(),
            What::Report(command) => command.run(),
            What::Digitize(command) => command.run(),
            What::Filter(command) => command.run(),
            What::Crop(command) => command.run(),
            What::Sample(command) => command.run(),
            What::Convert(command) => command.run(),
            What::Kinematics(command) => command.run(),
            What::Points(command) => command.run(),
            What::Serve(command) => command.run(),
            What::Pose(command) => command.run(),
            What::Machine(command) => command.run(),
            What::Localise(command) => command.run(),
            What::Simulate(command) => command.run(),
            What::Stock(command) => command.run(),
            What::Plan(command) => command.run(),
            What::Verify(command) => command.run(),
            What::Drive(command) => command.run(),
        }
    }
}
