//! `umi scan drive`

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde::Serialize;
use umi_client::timeline::Follower;
use umi_experiment::scan::drive::rig::machine_text;
use umi_experiment::scan::drive::{ControlLanguage, DriveOptions, Driven, drive};
use umi_report::pages::deviation::html;
use umi_scan::ScanError;
use umi_scan::cloud::tree::PointTree;
use umi_scan::cloud::{CloudColumns, CloudPoint};
use umi_scan::compare::{Deviations, Nominal, nearest, summary};
use umi_scan::format::clouds::{CloudStyle, write, write_cloud};
use umi_scan::format::points::PointSink;
use umi_scan::format::table::TableReader;
use umi_scan::format::triggers::{self, LatchSignal};
use umi_scan::merge::{MergeOptions, Merged, merge};
use umi_scan::parallel::Threads;
use umi_scan::plan::mesh::PartMesh;
use umi_scan::plan::program::{PathDialect, ProgramStyle, program};
use umi_scan::plan::proof::samples::{sample_count, samples};
use umi_scan::plan::spec::ScanSpec;
use umi_scan::plan::verify::{read_path, same_place};
use umi_scan::rigid::Vec3;
use umi_scan::surface::{CompositeSurface, Mesh};

use super::super::cloud::deviation_page::{Compared, page};
use super::super::cloud::merged::MergeLosses;
use super::plan::{Mode, inputs, positive};
use crate::cmd::Format;
use crate::cmd::record::events::Sink;
use crate::cmd::scan::answer::{answer, failure};
use crate::failure::Failure;
use crate::output::{Force, SetAside, distinct, no_stream};

/// Drives a path on the virtual machine: its cloud, and how far that is from the mesh
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Drive {
    /// The part's surface: STL, OBJ, PLY (in mm) or STEP
    #[arg(value_name = "MESH")]
    mesh: PathBuf,
    /// Part, sensor, plan and machine
    #[arg(long, value_name = "SPEC.toml")]
    spec: PathBuf,
    /// What is driven: a path as `umi scan plan` writes it, or a program
    #[arg(value_name = "PATH.csv|PATH.nc")]
    path: PathBuf,
    /// Where the points go, by the extension: .csv, .ply, .pcd, .las, .laz, .e57, .parquet
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,
    /// Writes a page on the deviations, as `umi scan report` does
    #[arg(long, value_name = "PAGE.html")]
    report: Option<PathBuf>,
    /// Keeps the recording: profiles.gocator, triggers.csv, machine.toml, program.nc, scene.toml
    #[arg(long, value_name = "FOLDER")]
    recording: Option<PathBuf>,
    /// The program's language
    #[arg(long, value_enum, default_value_t = Language::Fanuc)]
    dialect: Language,
    /// How a path is said to the control: axis values, or the point on the part that it carries (G43.4)
    #[arg(long, value_enum, default_value_t = Mode::Rotary)]
    nc_mode: Mode,
    /// Feed of a path's passes, in mm/min on the part; a program has its own
    #[arg(long, value_name = "MM_PER_MIN", default_value_t = 600.0, value_parser = positive)]
    feed: f64,
    /// From pulse to pulse, in ms
    #[arg(long, value_name = "MS", default_value_t = 25.0, value_parser = interval)]
    every_ms: f64,
    /// Samples of a profile, spread over the line
    #[arg(long, value_name = "N", default_value_t = 160,
          value_parser = clap::value_parser!(u32).range(2..=10_000))]
    columns: u32,
    /// Standard deviation of a sample at normal incidence; it grows with the incidence; 0: no noise
    #[arg(long, value_name = "UM", default_value_t = 5.0, value_parser = noise)]
    noise_um: f64,
    /// The noise grows with this power of 1/cos of the incidence. It lies along the beam: with 1, the distances from the
    /// surface do not grow; with 2, they grow with 1/cos
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = power)]
    noise_power: f64,
    /// Of the noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Coordinates of a PLY or PCD file as doubles instead of floats
    #[arg(long)]
    double: bool,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Language {
    Fanuc,
    Linuxcnc,
}

const HELP: &str = "\
The machine of the specification runs the program. The board between sensor and control sends
pulses in time and latches all axes; the sensor takes a profile of the mesh at each pulse, and
sends none but empty ones where the laser is off (the comments LASER ON and LASER OFF of
`umi scan plan`; without them it is on all the time). Profiles are paired and merged as
`umi scan merge` does. Points are in the part's frame; nothing is aligned. The mesh may be open.

A program with G43.4 has the part's place in G54 and the length from the spindle to the point on the
part in H1: this command sets both.

A path whose poses are not those of its axes is refused (bad_path): it was planned for another
specification.

The machine is ideal: what is off is the sensor's noise, the encoders' steps (0.0001 mm and
degrees), the words' three decimals and the profiles' own steps. It stops at each block's end.

A recording holds what a scan of a real machine would (profiles, triggers, machine.toml), and what
was driven: program.nc and the machine as scene.toml, for `umi machine run` and `check`.

With --json: `kind` \"scan_drive\", `machine_s`, `pulses`, `lit`, `profiles`, `paired`, `points`,
`lost_frames`, `missed_latches`, `coverage` (share of the area with a point within
`coverage_within_mm`), `noise_um`, `noise_power`, `seed`, `deviations` as `umi scan compare`.

Examples:
  umi scan drive part.stl --spec spec.toml path.csv -o cloud.ply
  umi scan drive part.stl --spec spec.toml path.nc --dialect linuxcnc -o cloud.laz --json
  umi scan drive part.stl --spec spec.toml path.csv -o cloud.ply --report page.html --recording scan
  umi machine run scan/program.nc --scene scan/scene.toml

Exit status: 0 driven, 1 usage or a file that cannot be read, 2 refused (no file is left): the codes of
`umi scan plan` and `umi scan merge`, bad_path, alarm, collision, nc_mode.";

fn interval(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(ms) if (2.0..=10_000.0).contains(&ms) => Ok(ms),
        _ => Err("2 to 10000 ms are needed: the sensor is busy for one".into()),
    }
}

fn noise(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(um) if (0.0..=1000.0).contains(&um) => Ok(um),
        _ => Err("0 to 1000 um are needed".into()),
    }
}

fn power(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(power) if (0.0..=4.0).contains(&power) => Ok(power),
        _ => Err("0 to 4 are needed".into()),
    }
}

/// What came of it.
#[derive(Serialize)]
struct Answer {
    kind: &'static str,
    machine_s: f64,
    pulses: u64,
    lit: u64,
    profiles: u64,
    paired: u64,
    lost_frames: u64,
    missed_latches: u64,
    points: u64,
    coverage: f64,
    coverage_within_mm: f64,
    noise_um: f64,
    noise_power: f64,
    seed: u64,
    deviations: Deviations,
    warnings: Vec<String>,
}

/// Keeps the points.
#[derive(Default)]
struct Gather(Vec<CloudPoint>);

impl PointSink for Gather {
    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        self.0.extend(points.iter().map(|&(index, at)| CloudPoint {
            at,
            profile,
            index,
            ..CloudPoint::default()
        }));
        Ok(())
    }

    fn finish(&mut self, _: u64) -> Result<(), ScanError> {
        Ok(())
    }
}

/// A folder that goes with this value, unless it is to stay.
struct RecordingFolder {
    path: PathBuf,
    stays: bool,
}

impl Drop for RecordingFolder {
    fn drop(&mut self) {
        if !self.stays {
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}

const FILES: [&str; 5] = [
    "profiles.gocator",
    "triggers.csv",
    "machine.toml",
    "program.nc",
    "scene.toml",
];

impl Drive {
    pub fn run(self) -> Result<(), Failure> {
        let inputs = [
            self.mesh.as_path(),
            self.spec.as_path(),
            self.path.as_path(),
        ];
        for path in self.outputs() {
            no_stream(&path)?;
            self.force.check(&path, &inputs)?;
        }
        write::check_extension(&self.output).map_err(failure)?;
        let outputs = self.outputs();
        distinct(outputs.iter().map(PathBuf::as_path))?;
        let older = SetAside::new(outputs);
        let mut made = self.make();
        let kept = older.end(matches!(made, Ok(Ok(_))));
        match (kept, &mut made) {
            (Some(kept), Ok(Err(error))) => error.message = format!("{} {kept}", error.message),
            (Some(kept), Err(Failure::Told(problem))) => {
                problem.message = format!("{} {kept}", problem.message);
            }
            _ => {}
        }
        answer(made?, self.format.json, text)
    }

    fn outputs(&self) -> Vec<PathBuf> {
        let kept = self.recording.iter();
        let kept = kept.flat_map(|folder| FILES.map(|name| folder.join(name)));
        let alone = std::iter::once(&self.output).chain(&self.report).cloned();
        alone.chain(kept).collect()
    }

    fn make(&self) -> Result<Result<Answer, ScanError>, Failure> {
        let folder = match &self.recording {
            Some(path) => RecordingFolder {
                path: path.clone(),
                stays: true,
            },
            None => RecordingFolder {
                path: std::env::temp_dir().join(format!("umi-drive-{}", std::process::id())),
                stays: false,
            },
        };
        let (spec, part, obstacles) = inputs(&self.spec, &self.mesh).map_err(failure)?;
        let (text, dialect) = self.program(&spec, &part, &obstacles).map_err(failure)?;
        let meshes = || std::iter::once(&part.surface).chain(&obstacles).collect();
        let options = DriveOptions {
            dialect,
            interval_us: (self.every_ms * 1e3).round() as u32,
            columns: self.columns,
            noise_um: self.noise_um,
            noise_power: self.noise_power,
            seed: self.seed,
        };
        let driven = drive(&spec, meshes(), &text, &options).map_err(failure)?;
        self.keep(&folder.path, &driven, &text)?;
        let mut gather = Gather::default();
        let triggers = triggers::read(&folder.path.join(FILES[1]), Some(LatchSignal::Output));
        let merged = triggers
            .and_then(|triggers| {
                merge(
                    &folder.path.join(FILES[0]),
                    &triggers,
                    &driven.machine,
                    &MergeOptions::default(),
                    &mut gather,
                )
            })
            .map_err(failure)?;
        Ok(self.judge(&spec, &part, &driven, &merged, gather.0))
    }

    /// The program of the path, and its language.
    fn program(
        &self,
        spec: &ScanSpec,
        part: &PartMesh,
        obstacles: &[Mesh],
    ) -> Result<(String, ControlLanguage), ScanError> {
        let (dialect, path_dialect) = match self.dialect {
            Language::Fanuc => (ControlLanguage::Fanuc, PathDialect::Fanuc),
            Language::Linuxcnc => (ControlLanguage::LinuxCnc, PathDialect::LinuxCnc),
        };
        let is_path = self
            .path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        if !is_path {
            let text = fs::read_to_string(&self.path)
                .map_err(|error| ScanError::file("read", &self.path, &error))?;
            return Ok((text, dialect));
        }
        let rows = read_path(spec, TableReader::open(&self.path)?)?;
        // The axes are driven; the poses say what they were planned for.
        same_place(spec, &rows)?;
        let meshes = std::iter::once(&part.surface).chain(obstacles).collect();
        let style = ProgramStyle {
            dialect: path_dialect,
            mode: self.nc_mode.of_program(),
            feed_mm_per_min: self.feed,
            number: 1000,
        };
        Ok((program(spec, meshes, &rows, style)?.text, dialect))
    }

    /// Writes the recording.
    fn keep(&self, folder: &Path, driven: &Driven, program: &str) -> Result<(), Failure> {
        let file = |name: &str| folder.join(name);
        fs::create_dir_all(folder).map_err(|error| Failure::file("write", folder, &error))?;
        let save = |name: &str, bytes: &[u8]| {
            fs::write(file(name), bytes)
                .map_err(|error| Failure::file("write", &file(name), &error))
        };
        save(FILES[0], &driven.channel)?;
        save(FILES[2], machine_text(&driven.machine).as_bytes())?;
        save(FILES[3], program.as_bytes())?;
        save(FILES[4], driven.scene.as_bytes())?;
        // The table is never written over what is there; this program's own may be.
        let _ = fs::remove_file(file(FILES[1]));
        let mut sink = Sink::table(&file(FILES[1]))?;
        let mut follower = Follower::default();
        for event in &driven.record.events {
            sink.take(|tell| follower.event(event.clone(), tell))?;
        }
        let [before, after] = &driven.record.status;
        let [from, to] = &driven.record.positions;
        sink.take(|mut tell| {
            follower.settle(before, after, &mut tell);
            follower.moved(from, to, to.t_ns, tell);
        })?;
        sink.close()
    }

    fn judge(
        &self,
        spec: &ScanSpec,
        part: &PartMesh,
        driven: &Driven,
        merged: &Merged,
        points: Vec<CloudPoint>,
    ) -> Result<Answer, ScanError> {
        let cloud: Vec<Vec3> = points.iter().map(|point| Vec3::from(point.at)).collect();
        let surface = Nominal::Mesh(Box::new(CompositeSurface::from(part.surface.clone())));
        let near = nearest(&cloud, &surface, Threads::all())?;
        let deviations: Vec<f64> = near.iter().map(|near| near.distance_mm).collect();
        let found = summary(&deviations).map_err(|mut error| {
            error.message = "The sensor saw nothing of the part: is this its path?".into();
            error
        })?;
        let across = spec.sensor.line_mm / f64::from(self.columns - 1);
        let along = self.feed / 60.0 * self.every_ms * 1e-3;
        // A cell of the cloud is so long and so wide; a slope makes it up to twice as long.
        let within = 2.0 * across.max(along);
        let tree = PointTree::new(&cloud);
        let places = samples(
            part,
            sample_count(part.surface.area_mm2(), spec.sensor.line_mm),
        );
        let mut close = Vec::new();
        let covered = places.iter().filter(|place| {
            close.clear();
            tree.within(&place.at, within, 1, &mut close);
            !close.is_empty()
        });
        let coverage = covered.count() as f64 / places.len() as f64;
        if let Some(path) = &self.report {
            let losses = MergeLosses::of(merged)?;
            let page = page(&Compared {
                cloud: &self.output,
                nominal: &self.mesh,
                surface: &surface,
                points: &cloud,
                near: &near,
                found: &found,
                limits: None,
                sections: &[],
                losses: Some(&losses),
                remarks: vec![format!(
                    "The points are simulated: a virtual machine without errors drove the path; {}.",
                    noise_in_words(self.noise_um, self.seed)
                )],
            });
            fs::write(path, html(&page)).map_err(|error| ScanError::file("write", path, &error))?;
        }
        let style = CloudStyle {
            columns: CloudColumns {
                profile: true,
                index: true,
                ..CloudColumns::default()
            },
            double: self.double,
            longest_mm: None,
        };
        let written = write_cloud(&self.output, style, Box::new(points.into_iter().map(Ok)))?;
        Ok(Answer {
            kind: "scan_drive",
            machine_s: driven.machine_s,
            pulses: driven.tally.taken,
            lit: driven.lit,
            profiles: merged.profiles,
            paired: merged.paired,
            lost_frames: merged.pairing.lost_frames,
            missed_latches: merged.pairing.missed_latches,
            points: written.points,
            coverage,
            coverage_within_mm: within,
            noise_um: self.noise_um,
            noise_power: self.noise_power,
            seed: self.seed,
            deviations: found,
            warnings: merged
                .pairing
                .warnings
                .iter()
                .cloned()
                .chain(write::notes(&self.output, self.double, written.farthest_mm))
                .collect(),
        })
    }
}

fn noise_in_words(noise_um: f64, seed: u64) -> String {
    if noise_um > 0.0 {
        format!("with noise of {noise_um} um at normal incidence, seed {seed}")
    } else {
        "WITHOUT noise: what is left are steps of encoders, words and profiles".into()
    }
}

fn text(a: &Answer) -> String {
    let d = &a.deviations;
    let noise = noise_in_words(a.noise_um, a.seed);
    let mut text = format!(
        "{:.0} s of machine time, {} pulses, {} of them with the laser on\n\
         {} of {} profiles paired with their latches, {} points\n\
         {:.1} % of the area has a point within {:.2} mm\n\n\
         deviations from the mesh, positive outside, {noise}\n\
         mean     {:+.6} mm\nstd      {:.6} mm\nrms      {:.6} mm\nleast    {:+.6} mm\ngreatest {:+.6} mm\n",
        a.machine_s,
        a.pulses,
        a.lit,
        a.paired,
        a.profiles,
        a.points,
        a.coverage * 100.0,
        a.coverage_within_mm,
        d.mean_mm,
        d.std_mm.unwrap_or(0.0),
        d.rms_mm,
        d.min_mm,
        d.max_mm,
    );
    for warning in &a.warnings {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "note: {warning}");
    }
    text
}
