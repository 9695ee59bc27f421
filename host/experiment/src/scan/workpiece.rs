//! The five-clamping workpiece of the thesis, scanned as in its sections 5.1 and 6.5: tables 5.1,
//! 6.2 and 6.3 beside ours, once with its software loop and once with the board.
//!
//! What is scanned is the surface that [`crate::thesis::run`] has cut, as triangles: its part stands turned
//! by 90 degrees about Z, so that its axis lies along the sensor's line. The mount is calibrated on a ball
//! first.
//!
//! # What the loop is here
//! The thesis reads the counters, sends a software trigger, and takes the next profile for it, in
//! a form's timer. Such a timer ticks 18.2 times a second: a position is up to 55 ms older than
//! its profile. Here its age is even between 0 and that, at random. The thesis itself reckons
//! with 5 ms at most, 12.5 µm at its 2.5 mm/s.

use nalgebra::Vector3;
use umi_client::problem::Problem;
use umi_kinematics::AxisChain;
use umi_protocol::job::Dialect;
use umi_scan::ScanError;
use umi_scan::parallel::Threads;
use umi_scan::surface::Mesh;
use umi_virtual::cutting::{SurfaceDeviations, laid_on};
use umi_virtual::scanner::LaserTarget;
use umi_virtual::scene::{BeamEnd, LineScannerSpec};

use super::mount::{MountError, calibrate};
use super::station::{Placed, Recording, Stop, TableMachine, place};
use crate::thesis::cases::stated;
use crate::thesis::outcome::{Method, Setting};
use crate::thesis::part::{NOMINAL, border_y_mm};
use crate::thesis::path::Passes;
use crate::thesis::run::run;

/// Speed of the scan (section 6.4).
const SPEED_MM_PER_S: f64 = 2.5;
/// From profile to profile with the laser head (section 6.5).
const STEP_MM: f64 = 0.127;
/// The tick of a form's timer.
const TIMER_US: f64 = 55_000.0;
/// The thesis' path of the finishing tool: distance of two passes.
const STEPOVER_MM: f64 = 0.541;
/// Pitch of the cut surface's nodes along its axis and across.
const PITCH_MM: [f64; 2] = [1.0, 0.06];
/// From profile to profile where one error is alone.
const ALONE_STEP_MM: f64 = 8.0 * STEP_MM;
/// Points nearer than this to the part's rim say nothing of its surface.
const RIM_MM: f64 = 0.2;
/// Below the arc's top, in the middle of the sensor's range.
const AIM_MM: f64 = 3.5;

/// Which scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartScanner {
    /// As the Roland of section 5.1: a millimetre's pitch, right within 0.05 mm.
    Roland,
    /// As the Gocator of section 6.5, positions taken by the board at each pulse.
    Board,
    /// The same, positions read by the thesis' loop.
    Loop,
}

impl PartScanner {
    /// All, in the order of the thesis.
    pub const ALL: [Self; 3] = [Self::Roland, Self::Loop, Self::Board];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Roland => "Roland, table 5.1",
            Self::Loop => "Gocator, software loop",
            Self::Board => "Gocator, board",
        }
    }

    /// What the thesis prints of it: mean above, mean below, standard deviation of cases 1 to 4;
    /// standard deviation of the reference. None where it has no such scan.
    #[must_use]
    pub const fn printed_mm(self) -> Option<([f64; 3], Option<f64>)> {
        match self {
            Self::Roland => Some(([0.011, -0.021, 0.021], None)),
            // With its loop; table 6.3 and section 6.5.
            Self::Loop => Some(([0.010, -0.022, 0.019], Some(0.013))),
            Self::Board => None,
        }
    }
}

/// What table 6.2 reckons with, each alone in a scan of its own: the mount as it is, and nothing else wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorSource {
    /// Steps of the scales, a micrometre each, and those of the sensor's message: nothing is without them.
    Scales,
    /// Positions that are older than their profiles, as the loop has them.
    Delay,
    /// The sensor's noise.
    Sensor,
}

impl ErrorSource {
    /// All, in the order of table 6.2.
    pub const ALL: [Self; 3] = [Self::Scales, Self::Delay, Self::Sensor];
}

/// What an error adds to a scan, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorShare {
    /// Where it comes from.
    pub source: ErrorSource,
    /// Along the motion, at most; 0 where it is none along it.
    pub along_mm: f64,
    /// Square to the surface: root mean square.
    pub rms_mm: f64,
    /// The largest.
    pub max_mm: f64,
}

/// The workpiece of a seed.
#[derive(Clone, Debug)]
pub struct PartScans {
    /// Each scan, in the order of the thesis.
    pub scans: Vec<(PartScanner, PartFigures)>,
    /// What table 6.2 reckons with.
    pub shares: Vec<ErrorShare>,
    /// The board's scan: points in the part's frame and their deviations from the arc as it lies best on case 0.
    pub board: Vec<DeviationAt>,
}

/// The figures of a scan, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartFigures {
    /// Points on the surface.
    pub points: usize,
    /// Of cases 1 to 4 against the arc as it lies best on case 0: mean of the deviations above 0.
    pub mean_above_mm: f64,
    /// Of those below.
    pub mean_below_mm: f64,
    /// Standard deviation about their mean.
    pub std_mm: f64,
    /// Of case 0 about the arc that was laid on it.
    pub reference_std_mm: f64,
    /// Root mean square of what the scan adds: a point's distance from the surface that was cut.
    pub scan_rms_mm: f64,
    /// The largest of these.
    pub scan_max_mm: f64,
    /// From sample to sample along the line: the median.
    pub pitch_mm: f64,
    /// From profile to profile.
    pub step_mm: f64,
}

/// The surface as the scan sees it.
struct CutSurface {
    mesh: Mesh,
}

impl LaserTarget for CutSurface {
    fn beam(
        &self,
        from_mm: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd> {
        let hit = self.mesh.first_hit(from_mm, direction, far_mm)?;
        Some(BeamEnd {
            way_mm: hit.at,
            normal: self.mesh.triangles().get(hit.face)?.normal,
        })
    }
}

/// From the part's frame to that of the machine's table: its axis along Y, its top at Z 0.
fn stands(p: [f64; 3]) -> Vector3<f64> {
    Vector3::new(p[1], -p[0], p[2] - top_mm())
}

fn lies(p: &Vector3<f64>) -> [f64; 3] {
    [-p.y, p.x, p.z + top_mm()]
}

const fn top_mm() -> f64 {
    NOMINAL.axis_z_mm + NOMINAL.radius_mm
}

/// The nodes' triangles, upside up.
fn triangles(surface: &SurfaceDeviations) -> Result<Mesh, ScanError> {
    let grid = surface.grid();
    let node = |column: usize, row: usize| {
        let (off, _) = surface.at(column, row)?;
        let y = grid.row_mm(row);
        let (radius, aside) = (NOMINAL.radius_mm + off, y - NOMINAL.axis_y_mm);
        let z = NOMINAL.axis_z_mm + (radius * radius - aside * aside).max(0.0).sqrt();
        Some(stands([grid.column_mm(column), y, z]))
    };
    let mut corners = Vec::new();
    for row in 1..grid.rows() {
        for column in 1..grid.columns() {
            let quad = [(1, 1), (0, 1), (0, 0), (1, 0)];
            let quad = quad.map(|(c, r)| node(column - c, row - r));
            if let [Some(a), Some(b), Some(c), Some(d)] = quad {
                corners.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    Mesh::new(&corners)
}

/// Away from the nominal arc at a point of the part's frame.
#[must_use]
pub fn outward(at_mm: &[f64; 3]) -> [f32; 3] {
    let [y, z] = [at_mm[1] - NOMINAL.axis_y_mm, at_mm[2] - NOMINAL.axis_z_mm];
    let length = y.hypot(z).max(1e-9);
    [0.0, (y / length) as f32, (z / length) as f32]
}

/// Cuts the workpiece in five clampings and scans it in each way.
///
/// # Errors
/// Those of the experiment, the calibration and the merge.
pub fn scan(seed: u64) -> Result<PartScans, MountError> {
    let setting = Setting {
        seed,
        ideal: false,
        stepover_mm: STEPOVER_MM,
        pitch_mm: PITCH_MM,
        remedy: Method::Program(Dialect::G10G68),
    };
    let cut = run(&setting, &stated(), |_| Ok::<(), Problem>(()));
    let (outcome, _) =
        cut.map_err(|problem| ScanError::unreadable("experiment", problem.message))?;
    let target = CutSurface {
        mesh: triangles(&outcome.corrected.deviations)?,
    };
    let mut scans = Vec::new();
    let mut board = Vec::new();
    for scanner in PartScanner::ALL {
        let (figures, points) = one(scanner, &target, &outcome.passes, seed)?;
        scans.push((scanner, figures));
        if scanner == PartScanner::Board {
            board = points;
        }
    }
    let shares = ErrorSource::ALL
        .into_iter()
        .map(|source| share(source, &target, seed));
    Ok(PartScans {
        scans,
        shares: shares.collect::<Result<_, _>>()?,
        board,
    })
}

/// A scan in which one thing is wrong alone. A coarser one than those of the tables: it is about points, not about a shape.
fn share(source: ErrorSource, target: &CutSurface, seed: u64) -> Result<ErrorShare, MountError> {
    let mut spec = preset("gocator")?;
    if source != ErrorSource::Sensor {
        spec.noise_um = [0.0; 2];
    }
    let mut station = TableMachine::new(spec, seed);
    let machine = station.truth.clone();
    let mut recording = station.record(target, &stops(&station, ALONE_STEP_MM));
    let along_mm = if source == ErrorSource::Delay {
        age(&mut recording, seed)
    } else {
        0.0
    };
    let placed = place(&recording, &machine)?;
    let points: Vec<Vector3<f64>> = on_part(&placed).collect();
    let (rms_mm, max_mm) = added(&points, target);
    Ok(ErrorShare {
        source,
        along_mm,
        rms_mm,
        max_mm,
    })
}

fn preset(name: &str) -> Result<LineScannerSpec, MountError> {
    let spec = LineScannerSpec::preset(name);
    Ok(spec.ok_or_else(|| ScanError::unreadable("scene", "a preset of the scanner is missing"))?)
}

/// The way across the part, a profile each step.
fn stops(station: &TableMachine, step_mm: f64) -> Vec<Stop> {
    let half = border_y_mm() + 1.0;
    let count = (2.0 * half / step_mm).floor() as u32;
    (0..=count)
        .map(|number| {
            let along = f64::from(number) * step_mm;
            let place = Vector3::new(along - half, 0.0, -AIM_MM);
            Stop {
                q: station.aim(&place, &Vector3::zeros(), 0.0, 0.0),
                speed: [SPEED_MM_PER_S, 0.0, 0.0, 0.0, 0.0],
                at_us: 1e6 + along / SPEED_MM_PER_S * 1e6,
            }
        })
        .collect()
}

/// A point, mm, and its deviation, mm.
pub type DeviationAt = ([f64; 3], f64);

fn one(
    scanner: PartScanner,
    target: &CutSurface,
    passes: &Passes,
    seed: u64,
) -> Result<(PartFigures, Vec<DeviationAt>), MountError> {
    let (name, step_mm) = match scanner {
        PartScanner::Roland => ("roland", 1.0),
        PartScanner::Board | PartScanner::Loop => ("gocator", STEP_MM),
    };
    let spec = preset(name)?;
    // The mount is that of the better sensor: the Roland's turntable has none to calibrate.
    let mut station = TableMachine::new(spec, seed);
    let machine = match scanner {
        PartScanner::Roland => station.truth.clone(),
        PartScanner::Board | PartScanner::Loop => calibrate(&mut station)?.machine,
    };
    let mut recording = station.record(target, &stops(&station, step_mm));
    if scanner == PartScanner::Loop {
        age(&mut recording, seed);
    }
    figures(&recording, &machine, target, passes, step_mm)
}

/// Positions that were read before their profiles were taken; by how much they are off at most, in mm.
fn age(recording: &mut Recording, seed: u64) -> f64 {
    let mut most = 0.0_f64;
    for (latch, number) in recording.triggers.latches.iter_mut().zip(seed % 1000..) {
        // Steps of the golden section are even, and follow no rhythm.
        let share = (number as f64 * 0.618_033_988_749_894_9).fract();
        // A micrometre a count.
        let counts = (SPEED_MM_PER_S * share * TIMER_US * 1e-3).round() as i64;
        if let Some(x) = latch.counts.first_mut().and_then(Option::as_mut) {
            *x -= counts;
            most = most.max(counts as f64 * 1e-3);
        }
    }
    most
}

/// Points of the part that are not next to its rim.
fn on_part(placed: &[Placed]) -> impl Iterator<Item = Vector3<f64>> + '_ {
    let [left, right] = crate::thesis::part::MEASURED_X_MM;
    let half = border_y_mm() - RIM_MM;
    let is_on = move |p: &Vector3<f64>| {
        let [x, y, _] = lies(p);
        (left + RIM_MM..=right - RIM_MM).contains(&x) && (y - NOMINAL.axis_y_mm).abs() < half
    };
    let points = placed.iter().flat_map(|profile| &profile.points);
    points.copied().filter(is_on)
}

/// How far points lie from the surface that was cut: root mean square, and at most.
fn added(points: &[Vector3<f64>], target: &CutSurface) -> (f64, f64) {
    let off = Threads::all().chunks(points.len(), 4096, |range| {
        let part = points.get(range).unwrap_or_default();
        let far = part.iter().map(|p| target.mesh.near(p).distance_mm.abs());
        far.fold((0.0, 0.0_f64), |(squares, most), mm| {
            (squares + mm * mm, most.max(mm))
        })
    });
    let squares: f64 = off.iter().map(|(squares, _)| squares).sum();
    let most = off.iter().fold(0.0_f64, |most, (_, mm)| most.max(*mm));
    ((squares / points.len().max(1) as f64).sqrt(), most)
}

/// The median of the ways between neighbouring samples of profiles; 0 without any.
fn pitch_mm(placed: &[Placed]) -> f64 {
    let mut ways: Vec<f64> = placed
        .iter()
        .flat_map(|profile| profile.points.windows(2))
        .map(|pair| (pair[1] - pair[0]).norm())
        .collect();
    ways.sort_by(f64::total_cmp);
    ways.get(ways.len() / 2).copied().unwrap_or(0.0)
}

fn figures(
    recording: &Recording,
    machine: &AxisChain,
    target: &CutSurface,
    passes: &Passes,
    step_mm: f64,
) -> Result<(PartFigures, Vec<DeviationAt>), MountError> {
    let [left, right] = crate::thesis::part::MEASURED_X_MM;
    let placed = place(recording, machine)?;
    let points: Vec<Vector3<f64>> = on_part(&placed).collect();
    let nodes: Vec<(f64, f64, f64)> = points
        .iter()
        .map(|p| {
            let [x, y, z] = lies(p);
            (x, y, NOMINAL.deviation_mm(y, z))
        })
        .collect();
    let [low, high] = passes.section_y_mm(0);
    let first = |y: f64| y > low && y <= high;
    let laid = laid_on(&NOMINAL, [left, right], &nodes, |_, y| first(y));
    let laid = laid.ok_or_else(|| {
        ScanError::refused(
            "too_few_points",
            "the first clamping's section has no points",
        )
    })?;
    let of = |wanted: bool| -> Vec<f64> {
        let all = nodes.iter().zip(&laid);
        all.filter(|((_, y, _), _)| first(*y) == wanted)
            .map(|(_, mm)| *mm)
            .collect()
    };
    let others = umi_scan::compare::summary(&of(false))?;
    let reference = umi_scan::compare::summary(&of(true))?;
    let (scan_rms_mm, scan_max_mm) = added(&points, target);
    let found = PartFigures {
        points: points.len(),
        mean_above_mm: others.mean_above_mm.unwrap_or(0.0),
        mean_below_mm: others.mean_below_mm.unwrap_or(0.0),
        std_mm: others.std_mm.unwrap_or(0.0),
        reference_std_mm: reference.std_mm.unwrap_or(0.0),
        scan_rms_mm,
        scan_max_mm,
        pitch_mm: pitch_mm(&placed),
        step_mm,
    };
    let shown = points.iter().map(lies).zip(laid).collect();
    Ok((found, shown))
}
