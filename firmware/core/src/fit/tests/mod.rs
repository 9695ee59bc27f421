//! What the fits promise, beyond the reference cases of `tests/`.

mod motion;
mod refusals;
mod scatter;
mod shapes;
mod wild;

use std::vec::Vec;

use nalgebra::{Rotation3, Unit, Vector3};

use crate::units::Point;

/// SplitMix64 with normal numbers: the same on every machine.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Even in 0..1.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Even in a range.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Normal with standard deviation 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(core::f64::consts::TAU * self.unit())
    }

    /// Three independent normal numbers.
    pub(crate) fn normal3(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// A direction, even over the sphere.
    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        self.normal3().normalize()
    }

    /// A rotation about an even axis.
    pub(crate) fn rotation(&mut self) -> Rotation3<f64> {
        let axis = Unit::new_normalize(self.normal3());
        Rotation3::from_axis_angle(&axis, self.between(0.0, core::f64::consts::PI))
    }
}

/// The points turned about the origin and shifted.
pub(crate) fn moved(
    points: &[Point],
    rotation: &Rotation3<f64>,
    shift: &Vector3<f64>,
) -> Vec<Point> {
    points
        .iter()
        .map(|p| Point {
            mm: rotation * p.mm + shift,
        })
        .collect()
}

/// Points on a surface of revolution about z, from its profile (radius over
/// height), in columns around an arc.
pub(crate) fn revolved(
    profile: impl Fn(f64) -> f64,
    heights: &[f64],
    arc: f64,
    columns: u32,
    twist: f64,
) -> Vec<Point> {
    let mut points = Vec::new();
    for (row, z) in heights.iter().enumerate() {
        for column in 0..columns {
            let angle = arc * f64::from(column) / f64::from(columns) + twist * row as f64;
            let radius = profile(*z);
            points.push(Point::from_mm(
                radius * libm::cos(angle),
                radius * libm::sin(angle),
                *z,
            ));
        }
    }
    points
}

/// The points with noise on every coordinate.
pub(crate) fn noisy(points: &[Point], sigma: f64, random: &mut Random) -> Vec<Point> {
    points
        .iter()
        .map(|p| Point {
            mm: p.mm + random.normal3() * sigma,
        })
        .collect()
}

/// The five hits of the thesis' pattern on a ball: top and two opposite pairs.
pub(crate) fn five_hits(center: Point, radius: f64) -> Vec<Point> {
    [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
    ]
    .iter()
    .map(|[x, y, z]| Point {
        mm: center.mm + Vector3::new(*x, *y, *z) * radius,
    })
    .collect()
}
