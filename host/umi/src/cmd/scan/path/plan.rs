//! `umi scan plan`

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::failure::Failure;
use crate::output::{Force, SetAside, distinct, no_stream};
use clap::{Args, ValueEnum};
use umi_report::pages::path_plan;
use umi_scan::ScanError;
use umi_scan::plan::mesh::read::read_obstacle;
use umi_scan::plan::mesh::{PartMesh, read_part};
use umi_scan::plan::planner::result::{PlanFigures, csv};
use umi_scan::plan::planner::{PlanOptions, plan};
use umi_scan::plan::program::{PathDialect, ProgramMode, ProgramStyle, program, ready};
use umi_scan::plan::spec::ScanSpec;
use umi_scan::surface::Mesh;

use super::plan_page;
use crate::cmd::Format;
use crate::cmd::scan::answer::answer;

/// A path that scans a part's surface: passes, poses and axes, proved by a simulated scan
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Plan {
    /// The part's surface: STL, OBJ, PLY (in mm) or STEP
    #[arg(value_name = "MESH")]
    mesh: PathBuf,
    /// Part, sensor, plan and machine
    #[arg(long, value_name = "SPEC.toml")]
    spec: PathBuf,
    /// Where the path goes
    #[arg(short, long, value_name = "PATH.csv")]
    output: PathBuf,
    /// Writes a program for a control, too
    #[arg(long, value_name = "PATH.nc")]
    nc: Option<PathBuf>,
    /// The control's language
    #[arg(long, value_enum, default_value_t = Language::Fanuc, requires = "nc")]
    dialect: Language,
    /// Axis values, or the point on the part that the control carries through its rotary axes
    #[arg(long, value_enum, default_value_t = Mode::Rotary, requires = "nc")]
    nc_mode: Mode,
    /// The program's number [default: that of its file's name, such as O1234.nc; else 1000]
    #[arg(long, value_name = "N", requires = "nc",
          value_parser = clap::value_parser!(u16).range(1..=9999))]
    nc_number: Option<u16>,
    /// Writes a page and a picture of the plan into this folder: plan.html, plan.svg
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// A plan that sees less than min_coverage is a plan
    #[arg(long)]
    allow_partial: bool,
    /// Feed with the laser on, in mm/min on the part
    #[arg(long, value_name = "MM_PER_MIN", default_value_t = 600.0, value_parser = positive)]
    feed: f64,
    /// The longest that planning may take, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 300.0, value_parser = positive)]
    time_limit: f64,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Language {
    Fanuc,
    Siemens,
    Heidenhain,
    Linuxcnc,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Mode {
    Rotary,
    Rtcp,
}

impl Mode {
    pub(super) const fn of_program(self) -> ProgramMode {
        match self {
            Self::Rotary => ProgramMode::Rotary,
            Self::Rtcp => ProgramMode::Rtcp,
        }
    }
}

const HELP: &str = "\
Examples:
  umi scan plan part.stl --spec spec.toml -o path.csv
  umi scan plan part.stl --spec spec.toml -o path.csv --nc path.nc --dialect linuxcnc
  umi scan plan part.stl --spec spec.toml -o path.csv --report plan
  umi scan plan pocket.ply --spec spec.toml -o path.csv --allow-partial --json | jq .uncovered

The path is written only if a simulated scan of its rows confirms it: what is seen, from how far,
how steeply, and that the sensor's box with its clearance touches nothing, between rows and on
links too.

SPEC.toml: every key with its unit and default is in docs/scan-plan.md; examples/scan-plan has one.

`duration_s` is reckoned with --feed while the laser is on, and with 100 mm/s and 30 degrees/s for links
and turning axes (`duration_at` in --json): a machine with other rapids takes another time.
`overlap.tenth` is what is wanted: a tenth of the strips' length may overlap less, down to `overlap.min`.
`overlap` is null where no strip has a neighbour, as with a single pass. `turning_poses` are those of `poses`
to which the point on the part does not move: they add nothing to `scan_length_mm`.
A pass's comments LASER ON and LASER OFF in the program tell where it is scanned; no language has a word
for that. The program comes from the top of the machine's Z (`travel_mm`) and goes back there, straight up.
Where X and Y stood before is not known: what stands higher than that is the operator's.

With --force, older files go when the plan is written. Where there is none, they are kept as NAME.old.

Exit status: 0 planned, 1 usage or a file that cannot be read, 2 refused (no file is left):
mesh_format, mesh_unreadable, mesh_empty, mesh_not_finite, mesh_degenerate, mesh_not_manifold,
mesh_not_oriented, mesh_scale, bad_spec, sensor_spec, plan_spec, machine_spec, coverage_unreachable,
overlap_unreachable, axis_limit, time_limit, nc_mode, nc_approach, plan_unproved.";

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v <= 1e6 => Ok(v),
        _ => Err("a number above 0 and up to a million is needed".into()),
    }
}

impl Plan {
    pub fn run(self) -> Result<(), Failure> {
        let outputs = self.outputs();
        let mut inputs = vec![self.mesh.clone(), self.spec.clone()];
        // A specification that cannot be read is refused below, by its own name.
        inputs.extend(ScanSpec::open(&self.spec).map_or(Vec::new(), |spec| spec.obstacles));
        let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        for path in &outputs {
            no_stream(path)?;
            self.force.check(path, &inputs)?;
        }
        distinct(outputs.iter().map(PathBuf::as_path))?;
        answer(self.make(outputs), self.format.json, text)
    }

    fn outputs(&self) -> Vec<PathBuf> {
        let files = std::iter::once(&self.output).chain(&self.nc).cloned();
        files.chain(self.pages()).collect()
    }

    fn make(&self, outputs: Vec<PathBuf>) -> Result<PlanFigures, ScanError> {
        let older = SetAside::new(outputs);
        let mut made = self.plan();
        let kept = older.end(made.is_ok());
        if let (Err(error), Some(kept)) = (&mut made, kept) {
            error.message = format!("{} {kept}", error.message);
        }
        made
    }

    fn plan(&self) -> Result<PlanFigures, ScanError> {
        let (spec, part, obstacles) = inputs(&self.spec, &self.mesh)?;
        let options = PlanOptions {
            allow_partial: self.allow_partial,
            time_limit: Duration::from_secs_f64(self.time_limit),
            feed_mm_per_min: self.feed,
        };
        let dialect = match self.dialect {
            Language::Fanuc => PathDialect::Fanuc,
            Language::Siemens => PathDialect::Siemens,
            Language::Heidenhain => PathDialect::Heidenhain,
            Language::Linuxcnc => PathDialect::LinuxCnc,
        };
        let mode = self.nc_mode.of_program();
        if self.nc.is_some() {
            ready(&spec, dialect, mode)?;
        }
        let mut plan = plan(&part, &obstacles, &spec, options)?;
        if let Some(path) = &self.nc {
            let meshes = std::iter::once(&part.surface).chain(&obstacles).collect();
            let style = ProgramStyle {
                dialect,
                mode,
                feed_mm_per_min: self.feed,
                number: self.nc_number.unwrap_or_else(|| number_of(path)),
            };
            let program = program(&spec, meshes, &plan.rows, style)?;
            plan.figures.warnings.extend(program.warnings);
            write(path, &program.text)?;
        }
        write(&self.output, &csv(&spec.machine, &plan.rows))?;
        if let (Some(folder), [html, svg]) = (&self.report, &self.pages()[..]) {
            fs::create_dir_all(folder)
                .map_err(|error| ScanError::file("create", folder, &error))?;
            let page = plan_page::page(&self.mesh, &spec, &plan);
            write(html, &path_plan::html(&page))?;
            write(svg, &path_plan::picture(&page))?;
        }
        Ok(plan.figures)
    }

    /// The files of the report, if there is to be one.
    fn pages(&self) -> Vec<PathBuf> {
        let folder = self.report.iter();
        folder
            .flat_map(|folder| ["plan.html", "plan.svg"].map(|name| folder.join(name)))
            .collect()
    }
}

/// The number in a program's name, as `O1234.nc` or `1234.nc`; 1000 where there is none that a control takes.
fn number_of(path: &Path) -> u16 {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let digits = name.trim_start_matches(['O', 'o']);
    match digits.parse() {
        Ok(number @ 1..=9999) if digits.bytes().all(|b| b.is_ascii_digit()) => number,
        _ => 1000,
    }
}

/// The specification, the part, and what stands beside it.
pub fn inputs(spec: &Path, mesh: &Path) -> Result<(ScanSpec, PartMesh, Vec<Mesh>), ScanError> {
    let spec = ScanSpec::open(spec)?;
    let part = read_part(mesh)?;
    let obstacles = spec.obstacles.iter().map(|path| {
        read_obstacle(path).map_err(|mut error| {
            error.message = format!("[part] obstacles: {}", error.message);
            error
        })
    });
    let obstacles = obstacles.collect::<Result<_, _>>()?;
    Ok((spec, part, obstacles))
}

fn write(path: &Path, text: &str) -> Result<(), ScanError> {
    fs::write(path, text).map_err(|error| ScanError::file("write", path, &error))
}

fn text(f: &PlanFigures) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{} passes, {} poses ({} turn on the spot), {:.1} % of the area seen",
        f.passes,
        f.poses,
        f.turning_poses,
        f.coverage * 100.0
    );
    let _ = writeln!(
        text,
        "way with the laser on {:.1} mm, in all {:.1} mm; {:.0} s with rapids of {} mm/s and {} degrees/s",
        f.scan_length_mm,
        f.path_length_mm,
        f.duration_s,
        f.duration_at.rapid_mm_per_s,
        f.duration_at.turn_deg_per_s
    );
    let _ = writeln!(
        text,
        "stand-off within {:.3} mm, tilt up to {:.1} degrees, clearance {:.1} mm",
        f.stand_off_max_mm, f.tilt_max_deg, f.clearance_mm
    );
    if let Some(o) = f.overlap {
        let _ = writeln!(
            text,
            "overlap {:.2} of the line at least, {:.2} in the middle",
            o.min, o.median
        );
    }
    for u in &f.uncovered {
        let _ = writeln!(text, "not seen: {:.1} mm2, {}", u.area_mm2, u.reason);
    }
    for w in &f.warnings {
        let _ = writeln!(text, "note: {w}");
    }
    text
}
