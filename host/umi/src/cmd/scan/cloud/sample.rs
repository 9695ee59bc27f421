//! `umi scan sample`

use clap::Args;
use umi_scan::thin::sample::{every, voxels};

use super::thin::{Clouds, above_zero};
use crate::failure::Failure;

/// A cloud with fewer points: each n-th, or one for each cell of a grid
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Sample {
    #[command(flatten)]
    clouds: Clouds,
    #[command(flatten)]
    how: How,
}

#[derive(Args)]
#[group(required = true, multiple = false)]
struct How {
    /// Each n-th point, the first among them
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    every: Option<u64>,
    /// The mean of the points in each cell of a grid of so many mm
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    voxel: Option<f64>,
}

const HELP: &str = "\
With --every points go through one by one. With --voxel the memory is that of the cells, and
the means are of no profile: the columns profile and index go.

Examples:
  umi scan sample cloud.ply --every 10 -o tenth.ply
  umi scan sample cloud.csv --voxel 0.5 -o even.ply --json

Refused (status 2): not_finite, for a point too far out for cells of this size; nothing_left.";

impl Sample {
    pub fn run(&self) -> Result<(), Failure> {
        let merged = self.how.voxel.is_some();
        self.clouds.run(
            "sample",
            None,
            |_| Ok(()),
            merged,
            &|points, drops| {
                if let Some(cell_mm) = self.how.voxel {
                    let all = voxels(points, cell_mm, drops)?;
                    return Ok(Box::new(all.into_iter().map(Ok)));
                }
                Ok(every(points, self.how.every.unwrap_or(1), drops))
            },
            &[],
        )
    }
}
