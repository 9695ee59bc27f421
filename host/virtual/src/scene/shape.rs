//! Solids and their distance functions.
//!
//! A ball of radius r touches a solid where the solid's distance from its centre is r.
//! Every distance here is exact, inside (where it is negative) and outside, and changes
//! by no more than the way: so a motion can be followed up to the first contact without
//! passing one over ([`super::Body::first_within`]).

use nalgebra::Vector3;
use serde::Deserialize;

use super::mesh::{BeamEnd, SceneMesh};
use super::trace;

/// A solid in its own frame.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SceneShape {
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
    /// A cone about Z with its apex at the origin, opening to −Z.
    Cone {
        /// Half of the angle at the apex, degrees.
        half_angle_deg: f64,
        /// From the apex to the base.
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
    /// Triangles that enclose a solid, from an STL file.
    Mesh(SceneMesh),
}

/// A beam that ends on a distance traced to this is on the surface, mm.
const ON_SURFACE_MM: f64 = 1e-10;

impl SceneShape {
    /// Where a beam first meets it within a way; `direction` is a unit vector.
    #[must_use]
    pub fn beam(
        &self,
        from: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd> {
        if let Self::Mesh(mesh) = self {
            return mesh.beam(from, direction, far_mm);
        }
        let to = from + direction * far_mm;
        let way_mm = trace::first_closed(from, &to, |p| self.distance_mm(p) - ON_SURFACE_MM)?;
        Some(BeamEnd {
            way_mm,
            normal: self.normal(&(from + direction * way_mm)),
        })
    }

    /// Distance of a point from the surface; negative inside.
    #[must_use]
    pub fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        let from_axis = libm::hypot(p.x, p.y);
        match *self {
            Self::Mesh(ref mesh) => mesh.distance_mm(p),
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
            Self::Cone {
                half_angle_deg,
                height_mm,
            } => in_cone(from_axis, p.z, half_angle_deg.to_radians(), height_mm),
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
                let section = under_arc(p.y.abs(), p.z, radius_mm, width_mm / 2.0, height_mm);
                outside([section, p.x.abs() - length_mm / 2.0])
            }
        }
    }

    /// Outward normal of the surface that is nearest to a point, by differences of the
    /// distance: good to 1e-8, for directions only.
    #[must_use]
    pub fn normal(&self, p: &Vector3<f64>) -> Vector3<f64> {
        const STEP_MM: f64 = 1e-5;
        if let Self::Mesh(mesh) = self {
            return mesh.normal(p);
        }
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

/// Distance in the section of [`SceneShape::Arc`], for y >= 0: within `width` of the middle,
/// above `-height`, under an arc of radius r with its crown at the origin.
fn under_arc(y: f64, z: f64, r: f64, width: f64, height: f64) -> f64 {
    let width = width.min(r);
    // Height of the edge between arc and flank, from the axis and from the crown.
    let rise = libm::sqrt((r - width) * (r + width));
    let edge = rise - r;
    let up = z + r;
    let from_axis = libm::hypot(y, up);
    // The nearest point of the arc is on the ray from the axis, if that meets it.
    let to_arc = if up > 0.0 && y * rise <= width * up {
        (from_axis - r).abs()
    } else {
        libm::hypot(y - width, z - edge)
    };
    let to_flank = libm::hypot(y - width, (z - edge).max(-height - z).max(0.0));
    let to_bottom = libm::hypot((y - width).max(0.0), z + height);
    let distance = to_arc.min(to_flank).min(to_bottom);
    let inside = y <= width && z >= -height && (z <= edge || from_axis <= r);
    if inside { -distance } else { distance }
}

/// Distance in the section of [`SceneShape::Cone`], for r >= 0: a triangle with its apex at the origin.
fn in_cone(r: f64, z: f64, half_angle: f64, height: f64) -> f64 {
    let (s, c) = (libm::sin(half_angle), libm::cos(half_angle));
    let slant = height / c;
    // Along the slant line from the apex, and across it.
    let along = (r * s - z * c).clamp(0.0, slant);
    let to_slant = libm::hypot(r - along * s, z + along * c);
    let to_base = libm::hypot((r - slant * s).max(0.0), z + height);
    let inside = r * c + z * s <= 0.0 && z >= -height;
    let distance = to_slant.min(to_base);
    if inside { -distance } else { distance }
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
