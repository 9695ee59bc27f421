//! `umi scan verify`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use clap::Args;
use umi_scan::ScanError;
use umi_scan::format::table::TableReader;
use umi_scan::plan::verify::{PathFindings, read_path, verify};

use super::plan::inputs;
use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// Scans a path in simulation: what it sees, and whether it keeps what the specification wants
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Verify {
    /// The part's surface: STL, OBJ, PLY (in mm) or STEP
    #[arg(value_name = "MESH")]
    mesh: PathBuf,
    /// Part, sensor, plan and machine
    #[arg(long, value_name = "SPEC.toml")]
    spec: PathBuf,
    /// A path as `umi scan plan` writes it, from whatever program
    #[arg(value_name = "PATH.csv")]
    path: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
With --json: `kind` \"scan_verify\", `holds`, `faults` [{`fault`: kinematics | axis_limit | max_step |
max_turn | stand_off | tilt | off_part | collision | coverage | overlap, `message`}], and the figures
that they are judged by. `overlap` {`wanted`, `min`, `tenth`, `median`, `resolution`}: strips that
lie side by side without any have 0. A tenth of their length may have a little less than wanted
(`tenth` is judged, less the `resolution` of the points): least widths are told by few points.
`warnings`: a path that holds by its tenth, and overlaps less somewhere.

Examples:
  umi scan verify part.stl --spec spec.toml path.csv
  umi scan verify part.stl --spec spec.toml path.csv --json | jq '.faults[].fault'

Exit status: 0 looked through (`holds` says whether the path keeps everything), 1 usage or a file
that cannot be read (file; a damaged table, as of every command: missing_column, corrupt, truncated),
2 refused: the codes of `umi scan plan` for mesh and specification, not_finite, and bad_path (no row;
beam and line no unit vectors at a right angle; laser other than 0 and 1; laser 1 with pass -1, or 0
with another).";

impl Verify {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<PathFindings, ScanError> {
        let (spec, part, obstacles) = inputs(&self.spec, &self.mesh)?;
        let rows = read_path(&spec, TableReader::open(&self.path)?)?;
        Ok(verify(&part, &obstacles, &spec, &rows))
    }
}

fn text(f: &PathFindings) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{} passes, {} poses, {:.1} % of the area seen",
        f.passes,
        f.poses,
        f.coverage * 100.0
    );
    let _ = writeln!(
        text,
        "way with the laser on {:.1} mm, in all {:.1} mm",
        f.scan_length_mm, f.path_length_mm
    );
    let _ = writeln!(
        text,
        "stand-off within {:.3} mm, tilt up to {:.1} degrees",
        f.stand_off_max_mm, f.tilt_max_deg
    );
    if let Some(overlap) = &f.overlap {
        let _ = writeln!(
            text,
            "overlap {:.3} at least, {:.3} in the middle, {} wanted",
            overlap.min, overlap.median, overlap.wanted
        );
    }
    if f.holds {
        text.push_str("the path keeps what the specification wants\n");
    }
    for fault in &f.faults {
        let _ = writeln!(text, "broken ({}): {}", fault.fault, fault.message);
    }
    for warning in &f.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}
