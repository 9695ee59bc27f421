//! Solids and their distance functions.
//!
//! A ball of radius r touches a solid where the solid's distance from its centre is r.
//! Every distance here is exact outside the solid (the arc surface: outside its end
//! faces a lower bound), and changes by no more than the way: so a motion can be
//! followed up to the first contact without passing one over (sphere tracing: J. Hart,
//! The Visual Computer 12, 1996).

use nalgebra::Vector3;
use serde::Deserialize;

/// A solid in its own frame.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A ball about the origin.
    Sphere {
        /// Its radius.
        radius_mm: f64,
    },
    /// Everything below Z 0.
    HalfSpace,
    /// A block: X and Y about the origin, its top at Z 0.
    Block {
        /// Length, width, height.
        size_mm: [f64; 3],
    },
    /// A round boss about Z, its top at Z 0.
    Cylinder {
        /// Its radius.
        radius_mm: f64,
        /// Its height.
        height_mm: f64,
    },
    /// A ring about Z, its top at Z 0: a ring gauge, a bore in a plate.
    Ring {
        /// Radius of the bore.
        radius_mm: f64,
        /// Radius of the outside.
        outer_radius_mm: f64,
        /// Its height.
        height_mm: f64,
    },
    /// A block whose top is an arc: a cylinder about X, its crown at Z 0.
    Arc {
        /// Radius of the cylinder.
        radius_mm: f64,
        /// Length along X.
        length_mm: f64,
        /// Width along Y.
        width_mm: f64,
        /// Height of the crown over the bottom.
        height_mm: f64,
    },
}

impl Shape {
    /// Distance of a point from the surface; negative inside.
    #[must_use]
    pub fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        let from_axis = libm::hypot(p.x, p.y);
        match *self {
            Self::Sphere { radius_mm } => p.norm() - radius_mm,
            Self::HalfSpace => p.z,
            Self::Block { size_mm: [x, y, z] } => {
                let half = [x / 2.0, y / 2.0, z / 2.0];
                outside([
                    p.x.abs() - half[0],
                    p.y.abs() - half[1],
                    (p.z + half[2]).abs() - half[2],
                ])
            }
            Self::Cylinder {
                radius_mm,
                height_mm,
            } => outside([from_axis - radius_mm, beyond(p.z, height_mm)]),
            Self::Ring {
                radius_mm,
                outer_radius_mm,
                height_mm,
            } => {
                let middle = (radius_mm + outer_radius_mm) / 2.0;
                let half = (outer_radius_mm - radius_mm) / 2.0;
                outside([(from_axis - middle).abs() - half, beyond(p.z, height_mm)])
            }
            Self::Arc {
                radius_mm,
                length_mm,
                width_mm,
                height_mm,
            } => {
                let block = outside([
                    p.x.abs() - length_mm / 2.0,
                    p.y.abs() - width_mm / 2.0,
                    beyond(p.z, height_mm),
                ]);
                let cylinder = libm::hypot(p.y, p.z + radius_mm) - radius_mm;
                block.max(cylinder)
            }
        }
    }

    /// Outward normal of the surface that is nearest to a point, by differences of the
    /// distance: good to 1e-8, for directions only.
    #[must_use]
    pub fn normal(&self, p: &Vector3<f64>) -> Vector3<f64> {
        const STEP_MM: f64 = 1e-5;
        let mut normal = Vector3::zeros();
        for (axis, component) in normal.iter_mut().enumerate() {
            let mut step = Vector3::zeros();
            if let Some(length) = step.get_mut(axis) {
                *length = STEP_MM;
            }
            *component = self.distance_mm(&(p + step)) - self.distance_mm(&(p - step));
        }
        normal.try_normalize(0.0).unwrap_or_else(Vector3::z)
    }
}

/// How far z lies beyond the slab from `-height` to 0; negative inside.
fn beyond(z: f64, height: f64) -> f64 {
    (z + height / 2.0).abs() - height / 2.0
}

/// Distance from a box, of the distances beyond its faces per axis.
fn outside<const N: usize>(beyond: [f64; N]) -> f64 {
    let out = beyond.iter().map(|b| b.max(0.0).powi(2)).sum::<f64>();
    let inside = beyond
        .iter()
        .fold(f64::NEG_INFINITY, |most, b| most.max(*b));
    libm::sqrt(out) + inside.min(0.0)
}
