//! A near-net-shape part: what is to become of it, and what it is before.

use nalgebra::Vector3;
use umi_scan::ScanError;
use umi_scan::stock::{Demand, Rule};
use umi_scan::surface::Mesh;
use umi_virtual::cutting::{Grid, GridFault};

type Vec3 = Vector3<f64>;

/// Where it stands in plan, machine coordinates of the nominal clamping, mm.
const X_MM: [f64; 2] = [-76.0, -4.0];
const Y_MM: [f64; 2] = [-24.0, 24.0];
/// Its middle.
const MIDDLE_MM: [f64; 2] = [-40.0, 0.0];
/// Its underside.
const UNDER_MM: f64 = -10.0;
/// The boss: height, width of its flank in plan, half the extents of its flat top.
const HIGH_MM: f64 = 12.0;
const FLANK_MM: f64 = 20.0;
const TOP_MM: [f64; 2] = [14.0, 4.0];
/// The boss is a face of its own up to this distance from its top in plan: there the flank has all but run out.
pub const BOSS_MM: f64 = 17.0;
/// What the boss demands, and within what the base stays as it was printed, mm.
pub const LEAST_STOCK_MM: f64 = 0.1;
const BASE_PROFILE_MM: f64 = 1.2;
/// Edge of a triangle in plan, mm.
const FACET_MM: f64 = 0.5;

/// Distance in plan from the flat top, mm.
#[must_use]
pub fn from_top_mm(x_mm: f64, y_mm: f64) -> f64 {
    let beyond = |v: f64, middle: f64, half: f64| ((v - middle).abs() - half).max(0.0);
    beyond(x_mm, MIDDLE_MM[0], TOP_MM[0]).hypot(beyond(y_mm, MIDDLE_MM[1], TOP_MM[1]))
}

/// Height of the finished part, mm, and how steep it is (the slope's absolute value).
fn nominal(x_mm: f64, y_mm: f64) -> (f64, f64) {
    let t = (from_top_mm(x_mm, y_mm) / FLANK_MM).min(1.0);
    let height = HIGH_MM * (1.0 - t * t * (3.0 - 2.0 * t));
    (height, HIGH_MM * 6.0 * t * (1.0 - t) / FLANK_MM)
}

/// Height of the finished part, mm.
#[must_use]
pub fn finished_mm(x_mm: f64, y_mm: f64) -> f64 {
    nominal(x_mm, y_mm).0
}

/// How a raw part came out of the printer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Printed {
    /// What was added to the boss along its normals, mm.
    pub stock_mm: f64,
    /// By how much it warped, as a multiple of 0.25 mm at the ends, 0.15 mm of twist and a sink mark of 0.3 mm.
    pub warp: f64,
}

impl Printed {
    /// Height of the raw part in its own frame, mm.
    #[must_use]
    pub fn height_mm(&self, x_mm: f64, y_mm: f64) -> f64 {
        // The boss was printed beside its place and crooked.
        let (sin, cos) = 0.4_f64.to_radians().sin_cos();
        let (dx, dy) = (x_mm - MIDDLE_MM[0], y_mm - MIDDLE_MM[1]);
        let x = MIDDLE_MM[0] + cos * dx + sin * dy - 0.5;
        let y = MIDDLE_MM[1] - sin * dx + cos * dy + 0.3;
        let (height, slope) = nominal(x, y);
        // The base is as built: the stock ends with the flank.
        let run_out = ((FLANK_MM - 1.0 - from_top_mm(x, y)) / 5.0).clamp(0.0, 1.0);
        let stock = self.stock_mm * run_out * slope.hypot(1.0);
        let (u, v) = (dx / 36.0, dy / 24.0);
        let sink = (-((dx + 22.0).powi(2) + (dy - 8.0).powi(2)) / 50.0).exp();
        height + stock - self.warp * (0.25 * u * u + 0.15 * u * v + 0.3 * sink)
    }

    /// The raw part as a closed block of triangles in its own frame.
    #[must_use]
    pub fn triangles(&self) -> Vec<[Vec3; 3]> {
        let at = |(x, y)| Vec3::new(x, y, self.height_mm(x, y));
        let mut all: Vec<[Vec3; 3]> = patches().flat_map(|p| two(p.map(at))).collect();
        let down = |p: Vec3| Vec3::new(p.x, p.y, UNDER_MM);
        let (xs, ys) = (steps(X_MM), steps(Y_MM));
        // Around the border, counter-clockwise from above.
        let mut border: Vec<(f64, f64)> = xs.iter().map(|&x| (x, Y_MM[0])).collect();
        border.extend(ys.iter().skip(1).map(|&y| (X_MM[1], y)));
        border.extend(xs.iter().rev().skip(1).map(|&x| (x, Y_MM[1])));
        border.extend(ys.iter().rev().skip(1).map(|&y| (X_MM[0], y)));
        for pair in border.windows(2) {
            let (a, b) = (at(pair[0]), at(pair[1]));
            all.extend(two([down(a), down(b), b, a]));
        }
        all.extend(
            patches()
                .flat_map(|[a, b, c, d]| two([a, d, c, b].map(|(x, y)| Vec3::new(x, y, UNDER_MM)))),
        );
        all
    }
}

/// The finished part's upper side, and what its faces demand.
///
/// # Errors
/// None for these figures.
pub fn model() -> Result<(Mesh, Vec<Demand>), ScanError> {
    let at = |(x, y)| Vec3::new(x, y, finished_mm(x, y));
    let (mut boss, mut base) = (Vec::new(), Vec::new());
    for patch in patches() {
        let (x, y) = (
            f64::midpoint(patch[0].0, patch[2].0),
            f64::midpoint(patch[0].1, patch[2].1),
        );
        let face = if from_top_mm(x, y) < BOSS_MM {
            &mut boss
        } else {
            &mut base
        };
        face.extend(two(patch.map(at)));
    }
    let all = [boss.clone(), base.clone()].concat();
    let demand = |name: &str, mesh, rule| Demand {
        name: name.to_owned(),
        mesh,
        rule,
    };
    Ok((
        Mesh::new(&all)?,
        vec![
            demand("boss", Mesh::new(&boss)?, Rule::Stock(LEAST_STOCK_MM)),
            demand("base", Mesh::new(&base)?, Rule::Profile(BASE_PROFILE_MM)),
        ],
    ))
}

/// A grid over it.
///
/// # Errors
/// None for a pitch below its width.
pub fn grid(pitch_mm: f64) -> Result<Grid, GridFault> {
    Grid::new(X_MM, Y_MM, [pitch_mm; 2])
}

/// Triangles as a binary STL file.
#[must_use]
pub fn stl(triangles: &[[Vec3; 3]]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        let normal = (t[1] - t[0])
            .cross(&(t[2] - t[0]))
            .try_normalize(0.0)
            .unwrap_or_else(Vec3::zeros);
        for v in std::iter::once(&normal).chain(t) {
            v.iter()
                .for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
        }
        bytes.extend([0, 0]);
    }
    bytes
}

fn steps([low, high]: [f64; 2]) -> Vec<f64> {
    let count = ((high - low) / FACET_MM).round() as u32;
    (0..=count)
        .map(|k| low + (high - low) * f64::from(k) / f64::from(count))
        .collect()
}

/// The squares in plan, corners counter-clockwise from above.
fn patches() -> impl Iterator<Item = [(f64, f64); 4]> {
    let (xs, ys) = (steps(X_MM), steps(Y_MM));
    let square = move |i: usize, j: usize| {
        [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| (xs[i], ys[j]))
    };
    let (columns, rows) = (steps(X_MM).len() - 1, steps(Y_MM).len() - 1);
    (0..rows).flat_map(move |j| {
        let square = square.clone();
        (0..columns).map(move |i| square(i, j))
    })
}

fn two([a, b, c, d]: [Vec3; 4]) -> [[Vec3; 3]; 2] {
    [[a, b, c], [a, c, d]]
}
