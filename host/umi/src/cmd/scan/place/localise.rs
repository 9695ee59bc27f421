//! `umi scan localise`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args, ValueEnum};
use serde_json::{Map, Value, json};
use umi_scan::ScanError;
use umi_scan::format::clouds::read::read_bounded;
use umi_scan::localise::fiducials::{FiducialSeen, read_fiducials};
use umi_scan::localise::scans::{ScanAnswer, ScanQuestion, TakenScan};
use umi_scan::parallel::Threads;
use umi_scan::rigid::{Pose, Vec3, rows};
use umi_scan::solve::Kernel;
use umi_scan::surface::read_stl;

use super::placed::Placed;
use super::transform::{self, FromTo, ScanFrame};
use super::{report, scans};
use crate::cmd::Format;
use crate::cmd::scan::answer::failure;
use crate::cmd::scan::triple::at_least_0;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::Plain;

/// Where the part is in a scan, or the scanner by fiducials, without a first guess, and how sure that is
#[derive(Args)]
#[command(after_help = HELP, override_usage = USAGE, group = ArgGroup::new("points").required(true), group = ArgGroup::new("sought").required(true).multiple(true))]
pub(crate) struct Localise {
    /// The scan: PLY, PCD, LAS, STL or columns x,y,z
    #[arg(value_name = "SCAN", group = "points")]
    scan: Option<PathBuf>,
    /// Several scans, and by what the machine had moved the part in each: `[[scan]]` file, moved, carried
    #[arg(long, value_name = "S.toml", group = "points", requires = "fiducials")]
    scans: Option<PathBuf>,
    /// What stands at known places of the machine: `[[fiducial]]` name, shape, position_mm, rotation
    #[arg(long, value_name = "F.toml", group = "sought")]
    fiducials: Option<PathBuf>,
    /// The part, STL in mm
    #[arg(long, value_name = "MODEL.stl", group = "sought")]
    part: Option<PathBuf>,
    /// Where the part is about, or the scanner where there is no part. A part that fits better elsewhere
    /// is refused; of several poses that look alike --accept-symmetry takes the one that is led to
    #[arg(long, value_name = "T.json")]
    start: Option<PathBuf>,
    /// A stated problem over all points: none, huber:MM or tukey:MM.
    /// Without it, noise and outliers are estimated
    #[arg(long, value_name = "K")]
    kernel: Option<Kernel>,
    /// Any of several poses that look alike will do
    #[arg(long)]
    accept_symmetry: bool,
    /// The unit of the scan, mm without; an E57 file has its own, and so has a table whose columns
    /// say theirs (`X [mm]`, `y_m`, `Z (inch)`): another one than that is refused
    #[arg(long, value_enum)]
    unit: Option<Unit>,
    /// The largest standard uncertainty at a corner of the part, or of the scan without a part
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = at_least_0)]
    limit: Option<f64>,
    /// By how much the scale may be off
    #[arg(long, value_name = "PPM", default_value_t = 1000.0, allow_hyphen_values = true, value_parser = at_least_0)]
    scale_limit_ppm: f64,
    /// Also carry this point (of the part, or of the scan without one) over and say its uncertainty (repeatable)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = transform::point)]
    at: Vec<[f64; 3]>,
    /// Begin the search with other points; each seed gives its own bits, always the same
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Threads; the result has the same bits for any number
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// The memory that may be used. Scans with more points than it holds are thinned evenly while they
    /// are read (PLY; other formats must fit); no file is made for it
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u64).range(64..=1_000_000))]
    memory_mb: u64,
    /// Write the transform for `umi correction` and `umi nc rewrite`; by one that is NG, or not known to
    /// their --limit as far out as part or program reach, they move nothing
    #[arg(short, long, value_name = "T.json")]
    output: Option<PathBuf>,
    #[command(flatten)]
    frame: ScanFrame,
    /// Write a page with the deviations, the fiducials, and how sure the pose is at the corners
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const USAGE: &str = "\
umi scan localise [OPTIONS] <SCAN> <--fiducials F.toml|--part MODEL.stl>
       umi scan localise [OPTIONS] --scans S.toml --fiducials F.toml [--part MODEL.stl]";

const HELP: &str = "\
Finds rotation R and translation t with q = R p + t. With --part, p is in part
coordinates and q in the machine's (the scan's, without --fiducials); with --fiducials
alone, p is in the scanner's coordinates. Other things in the scan, missing sides and
stray points are allowed. Where the scan does not decide, no pose is given, and the
reason is named.

A scan as a table has columns x, y, z, parted by commas, semicolons, tabs or blanks; where no
comma parts them, numbers may have decimal commas, all alike. A unit in their names (X [mm],
y_m, Z (inch)) is followed.

Examples:
  umi scan localise scan.ply --part part.stl
  umi scan localise scan.ply --part part.stl --limit 0.02 -o moved.json --scan-in offset
  umi scan localise scan.ply --part part.stl --at 0,0,0 --at 120,70,60 --json
  umi scan localise scan.csv --unit inch --part part.stl
  umi scan localise scan.ply --part part.stl --start about.json --kernel huber:0.05
  umi scan localise scan.ply --fiducials table.toml --part part.stl
  umi scan localise --scans turned.toml --fiducials table.toml --part part.stl

The pose is that of the faces that were scanned. A face that is worn or has stock all over
puts the part off by as much where no other face holds that direction, with verdict OK;
where others do, it can look as another scale (NG scale). Nothing in the scan tells them
apart: scan the opposite faces, too. The scale is estimated and not applied.

Scan three sides that are not parallel: where the points of two end is no measurement, and
what nothing else holds is free (degenerate). Crop the scan to one part: a second one of its
kind makes it ambiguous. Three faces that meet in one corner fit any part with such a corner:
they are taken where nothing of them is missing, and say nothing of the size. A plate that
is too thick lies as well on its top as on its bottom: ambiguous, with how far the face is
off, up to 4 % of the part's diagonal. So is one of which the top alone stands high, where the
floors of its pockets say so. Crop the scan to the faces that are as the model has them.

Fiducials are balls, cones (apex at the origin, opening to -Z) and reference surfaces of
any shape; where they stand, and how sure, is in their file:
  [[fiducial]]
  name = \"B1\"
  shape = { sphere = { radius_mm = 12.7 } }
                       # or { cone = { half_angle_deg = 30, height_mm = 40 } }
                       # or { mesh = \"corner.stl\" }
  position_mm = [210, 20, 35]
  rotation_deg = [0, 0, 90]      # about X, then Y, then Z; or rotation = 3 rows
  u_position_mm = 0.005          # standard uncertainties; 0 without
  u_rotation_rad = 0.0001
Take four balls or more, not in one plane: of three, one that has moved out of their
plane is not seen. Scan three sides of each corner: along the edge between two of them a
corner that has moved is not seen either, and u_position_mm alone says how far it may have.
What the balls' radii seem to be off by is in the uncertainty; spray makes them larger.

Scans of a part that the machine had turned in between:
  [[scan]]
  file = \"at90.ply\"
  moved = { rotation = [[1,0,0],[0,0,-1],[0,1,0]], translation_mm = [0, 0, 0] }
  carried = true                 # the fiducials were moved with the part

Exit status: 0 verdict OK; 2 verdict NG (uncertain, scale, wrong_radius of a ball,
one_fiducial (one corner alone holds the pose), no_fit of a stated problem that is not on
the scan; the pose is printed) or
refused: ambiguous, degenerate, too_little_overlap, no_fit, mirrored, wrong_scale,
no_fiducial, fiducials_disagree, scans_disagree (is moved right?), too_few_points,
too_many_points (--kernel and --memory-mb), empty_model, not_finite (or beyond 1e9 mm);
1 a file (bad_file, too_large) or usage.";

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Unit {
    Mm,
    M,
    Inch,
}

impl Unit {
    /// How many mm.
    const fn mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::M => 1000.0,
            Self::Inch => 25.4,
        }
    }
}

/// The memory that a point takes at the most, with all that is found of it.
const BYTES_A_POINT: u64 = 300;

/// What was read and found.
struct Found {
    answer: ScanAnswer,
    /// The points of the files, also those that are not finite.
    n: usize,
    /// Finite points that were kept, and the edge of the cubes of which one point each was, in mm.
    kept: usize,
    cell_mm: Option<f64>,
    /// The corners of the part, or of the scan without one.
    corners: [Vec3; 8],
}

impl Localise {
    pub fn run(self) -> Result<(), Failure> {
        let files = [
            &self.scan,
            &self.scans,
            &self.part,
            &self.fiducials,
            &self.start,
        ];
        let inputs: Vec<&Path> = files
            .into_iter()
            .filter_map(|file| file.as_deref())
            .collect();
        if self.frame.is_said() && self.fiducials.is_some() {
            return Err(Failure::trouble(
                "usage",
                "--scan-in is for a scan without fiducials: by these the pose is in machine coordinates",
            ));
        }
        let outputs = self.output.iter().chain(&self.report);
        self.force.check_each(outputs, &inputs)?;
        let found = self.find().map_err(failure)?;
        let located = &found.answer.located;
        if let Some(path) = &self.report {
            std::fs::write(
                path,
                report::html(self.what(), &found.answer, &found.corners, Vec::new()),
            )
            .map_err(|error| failure(ScanError::file("write", path, &error)))?;
        }
        let placed = Placed {
            motion: &located.motion,
            frames: self.frames(),
            certainty: Some(&located.certainty),
            reasons: &located.reasons,
        };
        placed.answer(
            self.output.as_deref(),
            self.format.json,
            || self.machine(&placed, &found),
            || self.text(&placed, &found),
        )
    }

    fn find(&self) -> Result<Found, ScanError> {
        let part = self.part.as_deref().map(read_stl).transpose()?;
        let fiducials = match &self.fiducials {
            Some(path) => read_fiducials(path)?,
            None => Vec::new(),
        };
        let listed = match (&self.scans, &self.scan) {
            (Some(list), _) => scans::read(list)?,
            (None, Some(scan)) => vec![scans::Listed::still(scan)],
            (None, None) => Vec::new(),
        };
        let (mut n, mut kept, mut cell_mm) = (0, 0, None);
        let most = (self.memory_mb * 1_000_000 / BYTES_A_POINT) as usize / listed.len().max(1);
        let mut taken = Vec::new();
        for scan in listed {
            let bounded = read_bounded(&scan.file, most, self.memory_mb * 1_000_000 / 3)?;
            if self.kernel.is_some() && bounded.cell.is_some() {
                return Err(ScanError::refused(
                    "too_many_points",
                    format_args!(
                        "{}: {} points do not fit in {} MB, and --kernel is about all of them; give more by --memory-mb",
                        scan.file.display(),
                        bounded.read,
                        self.memory_mb
                    ),
                ));
            }
            let mut cloud = bounded.cloud;
            if let (Some(unit), Some(own_mm)) = (self.unit, cloud.unit_mm)
                && unit.mm() != own_mm
            {
                return Err(ScanError::unreadable(
                    "usage",
                    format_args!(
                        "{}: the names of its columns say another unit ({own_mm} mm) than --unit ({} mm): leave --unit out, or \
                         name the columns x, y and z",
                        scan.file.display(),
                        unit.mm()
                    ),
                ));
            }
            let unit_mm = match self.unit {
                Some(unit) if !cloud.states_unit => unit.mm(),
                _ => 1.0,
            };
            let cell = bounded.cell.map(|cell| cell * unit_mm);
            cell_mm = cell.into_iter().chain(cell_mm).reduce(f64::max);
            cloud.scale(unit_mm);
            if cloud.points.is_empty() && cloud.not_finite > 0 {
                return Err(ScanError::refused(
                    "not_finite",
                    format_args!(
                        "{}: none of its {} points has three finite coordinates: export the scan again",
                        scan.file.display(),
                        cloud.not_finite
                    ),
                ));
            }
            n += bounded.read + cloud.not_finite;
            kept += cloud.points.len();
            taken.push(TakenScan {
                name: name(&scan.file),
                points: cloud.points,
                moved: scan.moved,
                carried: scan.carried,
            });
        }
        let question = ScanQuestion {
            scans: &taken,
            fiducials: &fiducials,
            part: part.as_ref(),
            start: self.start.as_deref().map(transform::read).transpose()?,
            kernel: self.kernel,
            accept_symmetry: self.accept_symmetry,
            limit_mm: self.limit,
            scale_limit_ppm: self.scale_limit_ppm,
            seed: self.seed,
            threads: self.threads.map_or_else(Threads::all, Threads::new),
        };
        let corners = match (&part, taken.first()) {
            (Some(part), _) => part.corners(),
            (None, Some(scan)) => scan.corners(),
            (None, None) => [Vec3::zeros(); 8],
        };
        Ok(Found {
            answer: question.answer()?,
            n,
            kept,
            cell_mm,
            corners,
        })
    }

    /// Whose coordinates the pose carries into whose.
    fn frames(&self) -> FromTo {
        if self.part.is_none() {
            FromTo::SCANNER
        } else if self.fiducials.is_some() {
            FromTo::PART_ON_MACHINE
        } else {
            self.frame.of_part()
        }
    }

    /// What the pose is of.
    fn what(&self) -> &'static str {
        if self.part.is_none() {
            "machine from scanner"
        } else if self.fiducials.is_some() {
            "machine from part"
        } else {
            "scan from part"
        }
    }

    fn machine(&self, placed: &Placed<'_>, found: &Found) -> Value {
        let ScanAnswer {
            located,
            fiducials,
            scans,
            ..
        } = &found.answer;
        let at: Vec<Value> = self
            .at
            .iter()
            .map(|p| {
                let p = Vec3::from(*p);
                let cov = located.certainty.at(&located.motion, &p);
                json!({"point_mm": p.as_slice(), "image_mm": located.motion.point(&p).as_slice(), "cov_mm2": rows(&cov)})
            })
            .collect();
        let symmetries: Vec<Value> = located
            .symmetries
            .iter()
            .map(|s| json!({"axis": s.axis.as_slice(), "point_mm": s.point_mm.as_slice(), "order": s.order}))
            .collect();
        let scans: Vec<Value> = scans
            .iter()
            .map(|scan| {
                let mut map = Map::new();
                map.insert("file".into(), json!(scan.name));
                map.extend(transform::fields(&scan.motion));
                map.insert("cov".into(), json!(rows(&scan.cov)));
                map.insert("fiducials".into(), seen(&scan.fiducials));
                Value::Object(map)
            })
            .collect();
        let c = &located.certainty;
        let fields = json!({
            "verdict": placed.verdict(),
            "reasons": placed.reasons(),
            "n": found.n, "kept": found.kept, "cell_mm": found.cell_mm, "n_used": located.n_used, "overlap": located.overlap,
            "rms_mm": located.rms_mm, "sigma_mm": located.sigma_mm,
            "scale": c.scale, "u_scale": c.u_scale.is_finite().then_some(c.u_scale),
            "cov": rows(&c.cov), "at": at,
            "fiducials": seen(fiducials), "scans": scans, "symmetries": symmetries,
        });
        placed.object("localise", fields)
    }

    fn text(&self, placed: &Placed<'_>, found: &Found) -> String {
        let (answer, n) = (&found.answer, found.n);
        let (kept, cell_mm) = (found.kept, found.cell_mm);
        let found = &answer.located;
        let mut text = placed.headline();
        text.push_str(&placed.pose(self.what()));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "points  {} of {n} on it; {:.0} % of its surface shown; noise {:.4} mm, rms {:.4} mm",
            found.n_used,
            found.overlap * 100.0,
            found.sigma_mm,
            found.rms_mm
        );
        if let Some(cell) = cell_mm {
            let _ = writeln!(
                text,
                "thinned to {kept} points, one of each {cell:.3} mm: all do not fit in --memory-mb"
            );
        }
        let c = &found.certainty;
        let _ = writeln!(
            text,
            "scale   {}   shared errors make the uncertainty {:.1} times as large",
            super::placed::scale(c),
            c.shared
        );
        for f in &answer.fiducials {
            let _ = if f.motion.is_some() {
                writeln!(
                    text,
                    "  {:<12} {:>7} points   rms {:.4} mm   {:.0} % of what holds the pose",
                    f.name,
                    f.n,
                    f.rms_mm,
                    f.share * 100.0
                )
            } else {
                writeln!(text, "  {:<12} not seen", f.name)
            };
        }
        for p in &self.at {
            let p = Vec3::from(*p);
            let q = found.motion.point(&p);
            let u = found
                .certainty
                .at(&found.motion, &p)
                .trace()
                .max(0.0)
                .sqrt();
            let _ = writeln!(
                text,
                "at {:.3}, {:.3}, {:.3}   is at {:.4}, {:.4}, {:.4} ± {u:.4} mm",
                Plain(p.x),
                Plain(p.y),
                Plain(p.z),
                Plain(q.x),
                Plain(q.y),
                Plain(q.z)
            );
        }
        text
    }
}

/// The name of a scan: that of its file, without folders.
fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

fn seen(fiducials: &[FiducialSeen]) -> Value {
    fiducials
        .iter()
        .map(|f| {
            let pose = |m: &Pose| transform::fields(m);
            let fields = f.motion.as_ref().map(pose).unwrap_or_default();
            let value = |name: &str| fields.get(name).cloned().unwrap_or(Value::Null);
            json!({
                "name": f.name, "found": f.motion.is_some(), "n": f.n, "rms_mm": f.rms_mm,
                "rotation": value("rotation"), "translation_mm": value("translation_mm"),
                "share": f.share,
            })
        })
        .collect()
}
