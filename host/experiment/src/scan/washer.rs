//! S2's washer: scanned by steps along X, by steps of C, in two passes; measured as a person
//! would measure it: diameters at the edges of its top, its height over the table.

use nalgebra::Vector3;
use umi_core::fit::{circle2d, plane};
use umi_core::units::Point;
use umi_kinematics::AxisChain;
use umi_scan::ScanError;
use umi_virtual::scene::Scene;

use super::mount::MountError;
use super::station::{Placed, Stop, TableMachine, place};

/// S2's table 9: outer and inner diameter, height.
pub const TRUE_MM: [f64; 3] = [41.20, 19.75, 6.30];

/// What was measured, in the order of [`TRUE_MM`].
pub type WasherFigures = [f64; 3];

/// S2's tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WasherTest {
    /// One scan along X, 0.5 mm a step.
    AlongX,
    /// One turn of the table, 5 degrees a step.
    AboutC,
    /// Two scans along X, 1 mm a step, 15 mm apart along Y.
    TwoPasses,
}

impl WasherTest {
    /// All, in S2's order.
    pub const ALL: [Self; 3] = [Self::AlongX, Self::AboutC, Self::TwoPasses];

    /// What S2 prints in its tables 11, 13 and 15.
    #[must_use]
    pub const fn printed_mm(self) -> WasherFigures {
        match self {
            Self::AlongX => [40.85, 19.92, 6.32],
            Self::AboutC => [40.12, 20.03, 6.34],
            Self::TwoPasses => [40.60, 20.01, 6.31],
        }
    }

    /// What S2 prints in its tables 12, 14 and 16, of diameters, height and their mean: errors in mm, and in percent. The
    /// first of table 12 should be 0.35, and its percentages are 0.85, 0.86 and 0.32.
    #[must_use]
    pub const fn printed_errors(self) -> [[f64; 4]; 2] {
        match self {
            Self::AlongX => [[0.45, 0.17, 0.02, 0.21], [0.84, 0.31, 0.15, 0.43]],
            Self::AboutC => [[1.08, 0.28, 0.04, 0.47], [2.62, 1.41, 0.63, 1.53]],
            Self::TwoPasses => [[0.60, 0.26, 0.01, 0.29], [1.46, 1.32, 0.16, 0.98]],
        }
    }

    /// The numbers of its two tables in S2: results, errors.
    #[must_use]
    pub const fn tables(self) -> [u32; 2] {
        match self {
            Self::AlongX => [11, 12],
            Self::AboutC => [13, 14],
            Self::TwoPasses => [15, 16],
        }
    }

    /// What it is, in words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::AlongX => "X steps of 0.5 mm",
            Self::AboutC => "C steps of 5 degrees",
            Self::TwoPasses => "X steps of 1 mm in two passes",
        }
    }

    fn stops(self, station: &TableMachine) -> Vec<Stop> {
        // The middle of the washer's height in the middle of the range; C turns about its axis.
        let aim = |x: f64, y: f64, c: f64| {
            station.aim(&Vector3::new(x, y, 3.0), &Vector3::zeros(), 0.0, c)
        };
        let steps = |from: f64, to: f64, step: f64| {
            let count = ((to - from) / step).round() as u32;
            (0..=count).map(move |n| from + step * f64::from(n))
        };
        let q: Vec<[f64; 5]> = match self {
            Self::AlongX => steps(-24.0, 24.0, 0.5).map(|x| aim(x, 0.0, 0.0)).collect(),
            Self::AboutC => {
                let [x, y, z, a, _] = aim(0.0, 0.0, 0.0);
                steps(0.0, 355.0, 5.0).map(|c| [x, y, z, a, c]).collect()
            }
            Self::TwoPasses => [-7.5, 7.5]
                .into_iter()
                .flat_map(|y| steps(-24.0, 24.0, 1.0).map(move |x| (x, y)))
                .map(|(x, y)| aim(x, y, 0.0))
                .collect(),
        };
        q.into_iter()
            .zip(0_u32..)
            .map(|(q, number)| Stop {
                q,
                speed: [0.0; 5],
                // A signature at the beginning, then even.
                at_us: 1e6 + 2e5 * f64::from(number) + 1e3 * f64::from(number.min(9).pow(3)),
            })
            .collect()
    }
}

/// Where the washer stands beside the axis of C, as if it was put there by eye. Were it exactly
/// on the axis, every profile of a turn would see its edges between the same two columns, and no
/// mean would be nearer than half a column.
const ASIDE_MM: [f64; 2] = [0.43, -0.26];

/// The washer on the table.
fn scene() -> Result<Scene, MountError> {
    let [outer, inner, height] = TRUE_MM;
    let [x, y] = ASIDE_MM;
    Ok(Scene::parse(&format!(
        "[[body]]\nname = \"TABLE\"\nshape = \"half_space\"\n[[body]]\nname = \"WASHER\"\n\
         shape = {{ ring = {{ radius_mm = {:?}, outer_radius_mm = {:?}, height_mm = {height:?} }} \
         }}\nposition_mm = [{x:?}, {y:?}, {height:?}]\n",
        inner / 2.0,
        outer / 2.0
    ))?)
}

/// Scans the washer and measures it, with a machine file.
///
/// # Errors
/// The scan cannot be paired, or the washer not be found.
pub fn run(
    station: &mut TableMachine,
    machine: &AxisChain,
    test: WasherTest,
) -> Result<WasherFigures, MountError> {
    let stops = test.stops(station);
    let recording = station.record(&scene()?, &stops);
    let placed = place(&recording, machine)?;
    Ok(measure(&placed, station.spec().field_mm[1])?)
}

/// A sample this near the top's height is of the top.
const TOP_MM: f64 = 0.1;
/// A run of fewer samples of the top is none: a reflex, or a mixed sample.
const SHORTEST_RUN: usize = 5;
/// Edges farther than this from their circle are none.
const OUTLIER_MM: f64 = 0.15;
/// The line must cross an edge more steeply than this: the cosine to its radius.
const LEAST_CROSSING: f64 = 0.5;

fn lost(what: &str) -> ScanError {
    ScanError::refused("no_washer", what)
}

/// Measures it in a cloud whose Z is about the table's normal.
fn measure(placed: &[Placed], field_mm: f64) -> Result<WasherFigures, ScanError> {
    let table: Vec<Point> = placed
        .iter()
        .flat_map(|profile| profile.points.iter().step_by(20))
        .filter(|p| p.z.abs() < 0.5)
        .map(|p| Point { mm: *p })
        .collect();
    let table = plane::fit(&table).map_err(|error| lost(&format!("no table: {error}")))?;
    let up = table.normal * table.normal.z.signum();
    let height = |p: &Vector3<f64>| (p - table.point.mm).dot(&up);
    let mut tops: Vec<f64> = placed
        .iter()
        .flat_map(|profile| profile.points.iter().map(height))
        .filter(|h| (h - TRUE_MM[2]).abs() < 1.0)
        .collect();
    if tops.is_empty() {
        return Err(lost("nothing is about as high as the washer"));
    }
    tops.sort_by(f64::total_cmp);
    let middle = tops[tops.len() / 2];
    tops.retain(|h| (h - middle).abs() < TOP_MM);
    let top = tops.iter().sum::<f64>() / tops.len() as f64;
    let edges: Vec<Vector3<f64>> = placed
        .iter()
        .flat_map(|profile| edges(profile, field_mm, |p| height(p) - top))
        .collect();
    let diameter = |outer: bool| {
        let wanted = |e: &&Vector3<f64>| (e.x.hypot(e.y) > 15.0) == outer;
        let mut kept: Vec<Point> = edges
            .iter()
            .filter(wanted)
            .map(|e| Point { mm: *e })
            .collect();
        let fit = |kept: &[Point]| {
            circle2d::fit(kept).map_err(|error| lost(&format!("no round edge: {error}")))
        };
        let first = fit(&kept)?;
        kept.retain(|p| first.residual(*p).0.abs() < OUTLIER_MM);
        Ok::<f64, ScanError>(2.0 * fit(&kept)?.radius.0)
    };
    Ok([diameter(true)?, diameter(false)?, top])
}

/// Where a profile leaves the top: between the last column on it and the next, or on a mixed
/// sample. (An edge lies anywhere between two columns: the mean of many is right.)
fn edges(
    profile: &Placed,
    field_mm: f64,
    over: impl Fn(&Vector3<f64>) -> f64,
) -> Vec<Vector3<f64>> {
    let mut found = Vec::new();
    let is_top = |place: usize| over(&profile.points[place]).abs() < TOP_MM;
    let next_to =
        |a: usize, b: usize| profile.samples[b].index.abs_diff(profile.samples[a].index) == 1;
    let count = profile.points.len();
    let mut begin = 0;
    while begin < count {
        let mut end = begin + 1;
        if is_top(begin) {
            while end < count && next_to(end - 1, end) && is_top(end) {
                end += 1;
            }
        }
        if is_top(begin) && end - begin >= SHORTEST_RUN {
            let along = profile.points[end - 1] - profile.points[begin];
            let step = along / (end - 1 - begin) as f64;
            let ends = [
                (begin, begin.checked_sub(1), -step),
                (end - 1, Some(end).filter(|end| *end < count), step),
            ];
            for (last, next, outward) in ends {
                if profile.samples[last].x_mm.abs() > field_mm / 2.0 - 1.0 {
                    continue;
                }
                let mixed = next.is_some_and(|next| {
                    let below = -over(&profile.points[next]);
                    next_to(next, last) && below > TOP_MM && below < TRUE_MM[2] - TOP_MM
                });
                let at = profile.points[last] + outward * if mixed { 1.0 } else { 0.5 };
                let radius = Vector3::new(at.x, at.y, 0.0);
                let crossing = radius.dot(&outward) / (radius.norm() * outward.norm());
                if crossing.abs() > LEAST_CROSSING {
                    found.push(at);
                }
            }
        }
        begin = end;
    }
    found
}
