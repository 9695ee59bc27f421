//! `umi scan calibrate observe`

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use umi_scan::ScanError;
use umi_scan::calibrate::observations;
use umi_scan::calibrate::observe::{ObserveOptions, Observed, observe};
use umi_scan::calibrate::sensor::Artefact;
use umi_scan::format::machine;
use umi_scan::format::table::TableReader;

use super::super::answer::answer;
use super::super::profile::pair::{Latency, Streams};
use super::sensor::radius;
use crate::cmd::Format;
use crate::failure::Failure;
use crate::output::Force;

/// The ball or the plane in every profile of a scan, as `calibrate sensor` wants it
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Observe {
    #[command(flatten)]
    streams: Streams,
    /// The machine file; its table `sensor` tells balls apart, right within 6° and 20 mm
    #[arg(long, value_name = "MACHINE.toml")]
    machine: PathBuf,
    #[command(flatten)]
    latency: Latency,
    /// What was scanned
    #[arg(long, value_enum)]
    on: ObservedArtefact,
    /// The radius of the balls; without, arcs of any radius are taken
    #[arg(long, value_name = "R", value_parser = radius)]
    radius_mm: Option<f64>,
    /// feature,x_mm,y_mm,z_mm: centres that are known; an arc is of the nearest
    #[arg(long, value_name = "CENTRES.csv")]
    centres: Option<PathBuf>,
    /// A sample within this of the arc or line may be of it
    #[arg(long, value_name = "MM", default_value_t = 0.05, value_parser = radius)]
    within_mm: f64,
    /// Balls are further apart than this
    #[arg(long, value_name = "MM", default_value_t = 50.0, value_parser = radius)]
    apart_mm: f64,
    /// At most so many samples of a profile, evenly
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    samples: u32,
    /// Where the observations go
    #[arg(short, long, value_name = "OBSERVATIONS.csv")]
    output: PathBuf,
    /// Where the positions of the joints go
    #[arg(long, value_name = "POSITIONS.csv")]
    positions: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ObservedArtefact {
    /// A plane, one for all profiles
    Plane,
    /// Balls
    Sphere,
}

const HELP: &str = "\
In every profile that has a latch the arc (or line) with the most samples is looked for among
whatever else is seen. Samples within four standard deviations of it are kept, if the surface is
not steeper there than 65 degrees. What was used and what was dropped is counted.

Examples:
  umi scan calibrate observe ball.gocator scan.csv --machine m.toml --on sphere --radius-mm 12.7 \\
      -o seen.csv --positions positions.csv
  umi scan calibrate sensor seen.csv positions.csv --machine m.toml --on sphere --radius-mm 12.7

Refused (status 2): as `umi scan pair`, machine, missing_axis, motion_lost, too_few_points.";

impl Observe {
    pub fn run(self) -> Result<(), Failure> {
        let inputs = [
            &*self.machine,
            &*self.streams.profiles,
            &*self.streams.triggers,
        ];
        self.force.check(&self.output, &inputs)?;
        self.force.check(&self.positions, &inputs)?;
        if self.output == self.positions {
            return Err(Failure::trouble(
                "file",
                "observations and positions need a file each",
            ));
        }
        if self.on == ObservedArtefact::Plane
            && (self.radius_mm.is_some() || self.centres.is_some())
        {
            return Err(Failure::trouble(
                "usage",
                "--radius-mm and --centres are for --on sphere",
            ));
        }
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<Observed, ScanError> {
        let machine = machine::read(&self.machine)?;
        let triggers = self.streams.read_triggers()?;
        let centres = match &self.centres {
            Some(path) => Some(observations::read_centres(TableReader::open(path)?)?),
            None => None,
        };
        let options = ObserveOptions {
            pairing: self.streams.options(),
            latency_us: self.latency.latency_us,
            on: match self.on {
                ObservedArtefact::Plane => Artefact::Plane,
                ObservedArtefact::Sphere => Artefact::Sphere,
            },
            radius_mm: self.radius_mm,
            centres,
            within_mm: self.within_mm,
            apart_mm: self.apart_mm,
            samples: self.samples as usize,
        };
        let (seen, tables) = observe(&self.streams.profiles, &triggers, &machine, &options)?;
        for (path, text) in [
            (&self.output, &tables.observations),
            (&self.positions, &tables.positions),
        ] {
            std::fs::write(path, text).map_err(|error| ScanError::file("write", path, &error))?;
        }
        Ok(seen)
    }
}

fn text(seen: &Observed) -> String {
    let mut text = format!(
        "{} of {} profiles with a latch used: {} without the artefact, {} of no known ball\n\
         {} observations; left out: {} samples beside, {} steep, {} for the number wanted\n",
        seen.used,
        seen.paired,
        seen.nothing_found,
        seen.of_no_centre,
        seen.observations,
        seen.samples_beside,
        seen.samples_steep,
        seen.samples_thinned
    );
    for feature in &seen.features {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "feature {}: {} profiles",
            feature.feature, feature.profiles
        );
    }
    text
}
