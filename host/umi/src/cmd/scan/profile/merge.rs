//! `umi scan merge`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::Force;
use clap::Args;
use umi_scan::ScanError;
use umi_scan::format::machine;
use umi_scan::format::points::PointFile;
use umi_scan::merge::{Merged, merge};

use super::pair::{self, Streams};
use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// Profiles and positions become a cloud of points in the workpiece frame
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Merge {
    #[command(flatten)]
    streams: Streams,
    /// The machine file: its axes as chains, the sensor's mount
    #[arg(long, value_name = "MACHINE.toml")]
    machine: PathBuf,
    /// The sensor sees so many microseconds after the edge; before it, if negative
    #[arg(
        long,
        value_name = "US",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    latency_us: f64,
    /// Where the points go: .csv (with profile and index) or .ply (binary)
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,
    /// Coordinates of a PLY file as doubles instead of floats
    #[arg(long)]
    double: bool,
    /// If the board lost motion of an axis, take the profiles before
    #[arg(long)]
    until_loss: bool,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Profiles are paired as by `umi scan pair`; every valid sample of a paired profile becomes a
point. With a latency the counts are taken from the straight line between the latches on
either side of that moment. A file that is there already is replaced, but only by a whole
scan: where it is refused, no file is written.

Floats keep 24 bits: at 800 mm they are right within 0.03 µm; --double keeps all.

Examples:
  umi scan merge profiles.csv scan.csv --machine mill.toml -o cloud.ply
  umi scan merge part.gocator scan.csv --machine c800u.toml --latency-us 150 -o cloud.csv
  umi scan merge part.gocator scan.csv --machine c800u.toml --encoder x -o cloud.ply --double

Refused (status 2): as `umi scan pair`, machine, missing_axis, not_finite, motion_lost.";

impl Merge {
    pub fn run(self) -> Result<(), Failure> {
        self.force.check(
            &self.output,
            &[
                &self.machine,
                &self.streams.profiles,
                &self.streams.triggers,
            ],
        )?;
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<Merged, ScanError> {
        let machine = machine::read(&self.machine)?;
        let triggers = self.streams.read_triggers()?;
        let mut file = PointFile::create(&self.output, self.double)?;
        merge(
            &self.streams.profiles,
            &triggers,
            &machine,
            self.latency_us,
            &self.streams.options(),
            self.until_loss,
            &mut file,
        )
    }
}

fn text(merged: &Merged) -> String {
    let mut text = format!(
        "{} points of {} of {} profiles; {} samples without range\n",
        merged.points, merged.paired, merged.profiles, merged.invalid
    );
    if let Some(bounds) = &merged.bounds_mm {
        for (axis, (min, max)) in ["X", "Y", "Z"]
            .iter()
            .zip(bounds.min.iter().zip(&bounds.max))
        {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{axis} {min:.4} to {max:.4} mm");
        }
    }
    text + &pair::text(&merged.pairing)
}
