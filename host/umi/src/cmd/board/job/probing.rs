//! `umi job probing`

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;
use umi_client::files::points;
use umi_client::job::probing::{AXES, AxisScatter, lines, spec};
use umi_client::problem::Problem;

use crate::cmd::Format;
use crate::failure::Failure;
use crate::show::terminal::{TITLE, Table, paint, print, print_json};

/// Tell what a hit scatters along X, Y and Z, for `[guards.probing]` of a job
#[derive(Args)]
#[command(after_help = "\
Touch one place some 20 times along X, one along Y and one along Z, as the job's program touches:
the same stylus and feed, on a ball at its pole of that axis, or on faces that are square to it.
Write down what the control prints, of each axis in a file of its own: x y z in each line, as
`umi fit` reads it.

Examples:
  umi job probing --x x.csv --y y.csv --z z.csv
  umi job probing --x x.csv --y y.csv --z z.csv --json

What it prints goes into the job file. The sigma is the standard deviation of the coordinate along
the axis; what the control rounds is in it. `dof` is that of the axis with the fewest hits. Hits
that drift, as on a spindle that warms up, give a sigma that is too large, and a stated error
that is too wide. Axes that scatter alike may be stated by one number: `sigma_mm = 0.001`.

Exit status: 0 told, 1 file or usage, 2 refused: too few hits, not on one place, none differs, or those of another axis.")]
pub(crate) struct Probing {
    /// Hits along X on one place
    #[arg(long, value_name = "HITS.csv")]
    x: PathBuf,
    /// Hits along Y on one place
    #[arg(long, value_name = "HITS.csv")]
    y: PathBuf,
    /// Hits along Z on one place
    #[arg(long, value_name = "HITS.csv")]
    z: PathBuf,
    #[command(flatten)]
    format: Format,
}

impl Probing {
    pub fn run(self) -> Result<(), Failure> {
        let axes = [told(0, &self.x)?, told(1, &self.y)?, told(2, &self.z)?];
        let spec = spec(&axes);
        let lines = lines(&spec);
        if self.format.json {
            let axes = axes.iter().zip(AXES).map(|(axis, name)| {
                json!({
                    "axis": name,
                    "hits": axis.hits,
                    "dof": axis.dof,
                    "sigma_mm": axis.sigma_mm,
                    "known_to": axis.known_to(),
                })
            });
            return print_json(&json!({
                "status": "ok",
                "probing": spec,
                "axes": axes.collect::<Vec<_>>(),
                "toml": lines,
            }));
        }
        let mut table = Table::new("<>>>").titles(&["along", "hits", "sigma (mm)", "known to"]);
        for (axis, name) in axes.iter().zip(AXES) {
            table.row([
                name.to_owned(),
                axis.hits.to_string(),
                format!("{:.5}", axis.sigma_mm),
                format!("{:.0} %", 100.0 * axis.known_to()),
            ]);
        }
        let title = paint(TITLE, "what one hit scatters");
        print(&format!("{title}\n{table}\n{lines}"))
    }
}

fn told(axis: usize, file: &Path) -> Result<AxisScatter, Failure> {
    let hits = points::read(file)?;
    AxisScatter::of(axis, &hits).map_err(|refused| {
        let said = format!("{}: {}", points::name(file), refused.message);
        Problem::refused(refused.code, said).into()
    })
}
