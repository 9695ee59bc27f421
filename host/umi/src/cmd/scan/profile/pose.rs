//! `umi scan pose`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use crate::show::terminal::Plain;
use clap::Args;
use umi_scan::ScanError;
use umi_scan::format::machine;
use umi_scan::format::table::TableReader;
use umi_scan::pose::{Poses, poses};

use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// Where a machine holds the sensor over the workpiece, for a list of positions
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Pose {
    /// The machine file: its axes as chains, the sensor's mount
    #[arg(value_name = "MACHINE.toml")]
    machine: PathBuf,
    /// A column for each joint by its name, in mm and degrees
    #[arg(value_name = "POSITIONS.csv")]
    positions: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi scan pose machine.toml positions.csv
  umi scan pose machine.toml positions.csv --json | jq '.poses[0].translation_mm'

Refused (status 2): machine, missing_axis, no_positions, not_finite.";

impl Pose {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<Poses, ScanError> {
        let machine = machine::read(&self.machine)?;
        poses(&machine, TableReader::open(&self.positions)?)
    }
}

fn text(found: &Poses) -> String {
    let mut text = String::from("sensor in the workpiece frame, mm\n");
    for (number, pose) in found.poses.iter().enumerate() {
        let [x, y, z] = pose.translation_mm.map(Plain);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "\n{number}: X {x:.6}  Y {y:.6}  Z {z:.6}");
        for row in pose.rotation {
            let _ = writeln!(
                text,
                "   {:12.9} {:12.9} {:12.9}",
                Plain(row[0]),
                Plain(row[1]),
                Plain(row[2])
            );
        }
    }
    for warning in &found.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}
