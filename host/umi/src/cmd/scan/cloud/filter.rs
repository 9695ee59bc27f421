//! `umi scan filter`

use std::path::PathBuf;

use clap::Args;
use umi_scan::ScanError;
use umi_scan::thin::filter::{held, intensity, isolated, spikes, statistical};

use super::thin::{Clouds, above_zero, numbers};
use crate::failure::Failure;

/// A cloud without points that are no surface: dark ones, spikes, isolated ones, outliers
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Filter {
    #[command(flatten)]
    clouds: Clouds,
    /// The least and the greatest intensity
    #[arg(long, value_name = "LEAST,MOST", value_parser = numbers::<2>)]
    intensity: Option<[f64; 2]>,
    /// Leave out a point further than this from both its neighbours in the profile, where
    /// these are within it of each other
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    spike: Option<f64>,
    /// Leave out points with fewer than N others in their cell of MM and those about it
    #[arg(long, value_name = "MM,N", value_parser = cell)]
    isolated: Option<(f64, u64)>,
    /// Leave out points whose mean distance to the K nearest is more than SIGMAS standard
    /// deviations above the mean of all
    #[arg(long, value_name = "K,SIGMAS", value_parser = neighbours)]
    statistical: Option<(usize, f64)>,
    /// Write what is left out, too (.csv or .ply)
    #[arg(long, value_name = "CLOUD")]
    dropped: Option<PathBuf>,
}

const HELP: &str = "\
Filters follow each other in the order above; each point that is left out is counted by the
first one that says so. With --intensity and --spike points go through one by one;
--isolated and --statistical hold the cloud in memory.

Examples:
  umi scan filter cloud.csv --spike 0.5 -o clean.csv
  umi scan filter cloud.ply --isolated 1,3 --dropped lonely.ply -o clean.ply
  umi scan filter cloud.csv --intensity 20,250 --statistical 8,3 -o clean.laz --json

Refused (status 2): no_filter, no_profiles (for --spike), no_intensity, too_few_points.";

fn cell(text: &str) -> Result<(f64, u64), String> {
    numbers::<2>(text)
        .ok()
        .filter(|[mm, n]| *mm > 0.0 && *n >= 1.0 && n.fract() == 0.0 && *n < 1e9)
        .map(|[mm, n]| (mm, n as u64))
        .ok_or_else(|| "give the size of a cell in mm and a whole number of points, as 1,3".into())
}

fn neighbours(text: &str) -> Result<(usize, f64), String> {
    numbers::<2>(text)
        .ok()
        .filter(|[k, s]| (1.0..=1000.0).contains(k) && k.fract() == 0.0 && *s > 0.0)
        .map(|[k, s]| (k as usize, s))
        .ok_or_else(|| "give 1 to 1000 neighbours and standard deviations above 0, as 8,3".into())
}

impl Filter {
    pub fn run(&self) -> Result<(), Failure> {
        let any = self.intensity.is_some()
            || self.spike.is_some()
            || self.isolated.is_some()
            || self.statistical.is_some();
        self.clouds.run(
            "filter",
            self.dropped.as_deref(),
            |columns| {
                let refused = |code, what: &str| Err(ScanError::refused(code, what));
                if !any {
                    return refused(
                        "no_filter",
                        "Name what goes: --intensity, --spike, --isolated or --statistical.",
                    );
                }
                if self.spike.is_some() && !columns.profile {
                    return refused(
                        "no_profiles",
                        "The cloud does not say which profiles its points are of: it has no column `profile`.",
                    );
                }
                if self.intensity.is_some() && !columns.intensity {
                    return refused(
                        "no_intensity",
                        "The cloud does not say how bright its points are: it has no column `intensity`.",
                    );
                }
                Ok(())
            },
            false,
            &|mut points, drops| {
                if let Some([least, most]) = self.intensity {
                    points = intensity(points, least, most, drops);
                }
                if let Some(off_mm) = self.spike {
                    points = spikes(points, off_mm, drops);
                }
                if self.isolated.is_none() && self.statistical.is_none() {
                    return Ok(points);
                }
                let mut all = held(points)?;
                if let Some((cell_mm, least)) = self.isolated {
                    all = isolated(all, cell_mm, least, drops)?;
                }
                if let Some((k, sigmas)) = self.statistical {
                    all = statistical(all, k, sigmas, drops)?;
                }
                Ok(Box::new(all.into_iter().map(Ok)))
            },
        )
    }
}
