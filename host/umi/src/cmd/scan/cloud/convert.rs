//! `umi scan convert`

use clap::Args;

use super::thin::Clouds;
use crate::failure::Failure;

/// A cloud in another format, by the extension
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Convert {
    #[command(flatten)]
    clouds: Clouds,
}

const HELP: &str = "\
Points go through one by one: the memory does not grow with the cloud. Points that are
no finite numbers are left out and counted. E57 has metres, because its standard says so;
all others have mm, but for tables whose columns name a unit (X [inch], y_m): that is followed.
LAS and LAZ state no unit, and most programs take metres there: this one says so when it writes
them. They hold steps of 0.1 µm, and of the columns beside the coordinates time, intensity
and the mark of interpolated points (their synthetic flag). E57 holds all columns but the uncertainty by
the mount (`mount_u_mm`) and that mark (`interpolated`). A file appears only when it is complete.

Examples:
  umi scan convert cloud.csv -o cloud.ply --double
  umi scan convert cloud.ply -o cloud.laz
  umi scan convert cloud.ply -o cloud.parquet --json
  umi scan convert cloud.csv -o view.stl --longest-mm 0.5

An STL is made of the grid of one view (columns profile and index), which is held in memory. Where a
point or a profile is missing, and where neighbours lie too far apart, the mesh has a hole. Its
triangles look up by most of the surface.

Refused (status 2): no_grid, for an STL of points without profiles, or of several views;
nothing_left, for a cloud without points.

Exit status: 1 for a cloud that cannot be understood: bad_file, corrupt, truncated,
missing_column, format.";

impl Convert {
    pub fn run(&self) -> Result<(), Failure> {
        self.clouds.run(
            "convert",
            None,
            |_| Ok(()),
            false,
            &|points, _| Ok(points),
            &[],
        )
    }
}
