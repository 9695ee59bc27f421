//! `umi scan simulate`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};
use umi_scan::ScanError;
use umi_scan::cloud::{CloudColumns, CloudPoint};
use umi_scan::format::clouds::{CloudStyle, write, write_cloud};
use umi_scan::parallel::Threads;
use umi_scan::rigid::Pose;
use umi_virtual::scene::AreaScannerSpec;
use umi_virtual::sensor::area::{AreaScan, scan};

use super::transform;
use crate::cmd::Format;
use crate::cmd::machine::run::scene;
use crate::cmd::scan::answer::{answer, failure};
use crate::failure::Failure;
use crate::output::Force;

/// What an area scanner sees of a scene, as a cloud in the scanner's own frame
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Simulate {
    /// The scene: its bodies and its `[scanner]`
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Where the points go, by the extension: .csv, .ply, .pcd, .las, .laz, .e57, .parquet
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,
    /// Coordinates of a PLY or PCD file as doubles instead of floats
    #[arg(long)]
    double: bool,
    /// Also write where the scanner stands (machine from scanner): what localise should find
    #[arg(long, value_name = "T.json")]
    pose: Option<PathBuf>,
    /// Other noise and other lost points; each seed gives its own bits, always the same
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Threads; the result has the same bits for any number
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The scanner sees a field at once, from where it stands. Its frame: the origin where the
rays start, Z along the middle ray, X towards the second camera. In the scene:
  [scanner]
  position_mm = [0, -300, 400]
  look_at_mm = [0, 0, 20]        # or rotation_deg, about X, then Y, then Z
  field_deg = [40, 30]           # whole angles along X and Y
  distance_mm = 480              # where spacing_mm and shared_length_mm are meant
  spacing_mm = 0.4
  range_mm = [300, 700]          # along Z; what is nearer or further is not seen
  noise_mm = 0.02                # standard deviation along the ray, each point its own
  shared_noise_mm = 0.01         # that neighbours share,
  shared_length_mm = 15          # as far as this
  grazing_deg = 75               # steepest incidence against the normal
  drop_out = 0.01                # share of points lost
  spot_mm = 0.3                  # across an edge a point lies between both sides
  baseline_mm = 120              # the second camera, which must see a point too

Bodies can be sphere, block, cylinder, cone (apex at the origin, opening to -Z), ring,
arc, half_space and mesh (a closed STL).

Examples:
  umi scan simulate cell.toml -o scan.ply
  umi scan simulate cell.toml -o scan.ply --seed 7 --pose truth.json --json

Exit status: 1 usage or a file; 2 refused: scene, no_scanner, nothing_seen.";

impl Simulate {
    pub fn run(&self) -> Result<(), Failure> {
        let inputs: [&Path; 1] = [&self.scene];
        let outputs = std::iter::once(&self.output).chain(&self.pose);
        self.force.check_each(outputs, &inputs)?;
        write::check_extension(&self.output).map_err(failure)?;
        let scene = scene(&self.scene)?;
        let Some(scanner) = &scene.scanner else {
            return Err(failure(ScanError::refused(
                "no_scanner",
                "the scene has no [scanner]: say where it stands and what it sees, as umi scan simulate --help shows",
            )));
        };
        let threads = self.threads.map_or_else(Threads::all, Threads::new);
        let seen = scan(&scene, scanner, self.seed, threads);
        answer(self.written(scanner, &seen), self.format.json, |_| {
            text(&seen)
        })
    }

    fn written(&self, scanner: &AreaScannerSpec, seen: &AreaScan) -> Result<Value, ScanError> {
        if seen.points.is_empty() {
            return Err(ScanError::refused(
                "nothing_seen",
                format_args!(
                    "the scanner sees no point of the scene: {}; does it look at the bodies, and are they within range_mm?",
                    lost(seen)
                ),
            ));
        }
        let style = CloudStyle {
            columns: CloudColumns::default(),
            double: self.double,
            longest_mm: None,
        };
        let points = seen.points.iter().map(|p| {
            Ok(CloudPoint {
                at: (*p).into(),
                ..CloudPoint::default()
            })
        });
        write_cloud(&self.output, style, Box::new(points))?;
        let placed = scanner.placed();
        let pose = Pose {
            rotation: placed.rotation,
            translation_mm: placed.translation_mm,
        };
        if let Some(path) = &self.pose {
            transform::write(path, &pose, transform::FromTo::SCANNER, "OK", None)?;
        }
        let mut map = transform::fields(&pose);
        map.insert("kind".into(), "simulate".into());
        for (name, count) in [
            ("points", seen.points.len()),
            ("mixed", seen.mixed),
            ("rays", seen.rays),
            ("empty", seen.empty),
            ("grazing", seen.grazing),
            ("shadowed", seen.shadowed),
            ("dropped", seen.dropped),
        ] {
            map.insert(name.into(), json!(count));
        }
        Ok(Value::Object(map))
    }
}

fn text(seen: &AreaScan) -> String {
    let mut text = format!("{} points of {} rays", seen.points.len(), seen.rays);
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        ", {} of them mixed at edges\n{}",
        seen.mixed,
        lost(seen)
    );
    text
}

/// Why rays gave no point.
fn lost(seen: &AreaScan) -> String {
    format!(
        "{} rays met nothing in range, {} a surface too steeply, {} one that the second camera does not see; {} points were lost",
        seen.empty, seen.grazing, seen.shadowed, seen.dropped
    )
}
