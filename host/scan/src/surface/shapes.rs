//! Balls and cones beside a mesh: what fiducials are made of.

use super::mesh::Mesh;
use super::nearest::Near;
use super::triangle::bounds;
use crate::rigid::{Pose, Vec3};

/// A ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallShape {
    /// Its centre in mm.
    pub centre_mm: Vec3,
    /// Its radius in mm.
    pub radius_mm: f64,
}

/// A cone: its apex at the origin of `pose`, opening to −Z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Where it stands.
    pub pose: Pose,
    /// Half of its angle in rad.
    pub half_angle_rad: f64,
    /// From the apex to the rim, along the axis, in mm.
    pub height_mm: f64,
}

/// A surface of triangles, balls and cones. The nearest of them counts.
#[derive(Clone, Debug, Default)]
pub struct CompositeSurface {
    /// The triangles.
    pub mesh: Option<Mesh>,
    /// The balls.
    pub balls: Vec<BallShape>,
    /// The cones.
    pub cones: Vec<Cone>,
}

impl From<Mesh> for CompositeSurface {
    fn from(mesh: Mesh) -> Self {
        Self {
            mesh: Some(mesh),
            ..Self::default()
        }
    }
}

impl CompositeSurface {
    /// The surface nearest to `q`; none if there is no surface. `hint`: the face that was nearest a moment ago, or 0.
    #[must_use]
    pub fn near(&self, q: &Vec3, hint: usize) -> Option<Near> {
        self.near_within(q, hint, f64::INFINITY)
    }

    /// The same; none, or one that is farther, if no surface is within `limit` mm.
    #[must_use]
    pub fn near_within(&self, q: &Vec3, hint: usize, limit: f64) -> Option<Near> {
        let mut best = self
            .mesh
            .as_ref()
            .and_then(|mesh| mesh.near_within(q, hint, limit));
        let first = self.mesh.as_ref().map_or(0, |mesh| mesh.triangles().len());
        let others = self
            .balls
            .iter()
            .map(|ball| Some(ball.near(q)))
            .chain(self.cones.iter().map(|cone| cone.near(q)));
        for (i, other) in others.enumerate() {
            let Some((distance_mm, direction)) = other else {
                continue;
            };
            if best.is_none_or(|b| distance_mm.abs() < b.distance_mm.abs()) {
                best = Some(Near {
                    distance_mm,
                    direction,
                    face: first + i,
                });
            }
        }
        best
    }

    /// The normal of a triangle, by its number; none of a ball or a cone.
    #[must_use]
    pub(crate) fn facet_normal(&self, face: usize) -> Option<Vec3> {
        let mesh = self.mesh.as_ref()?;
        mesh.triangles().get(face).map(|triangle| triangle.normal)
    }

    /// The least and the largest coordinates in mm.
    #[must_use]
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let mut ends = Vec::new();
        if let Some(mesh) = &self.mesh {
            let (low, high) = mesh.bounds();
            ends.extend([low, high]);
        }
        for ball in &self.balls {
            let r = Vec3::repeat(ball.radius_mm);
            ends.extend([ball.centre_mm - r, ball.centre_mm + r]);
        }
        for cone in &self.cones {
            let r = cone.height_mm * cone.half_angle_rad.tan();
            for (x, y) in [(r, r), (r, -r), (-r, r), (-r, -r)] {
                ends.push(cone.pose.point(&Vec3::new(x, y, -cone.height_mm)));
            }
            ends.push(cone.pose.translation_mm);
        }
        bounds(ends.iter())
    }
}

impl BallShape {
    fn near(&self, q: &Vec3) -> (f64, Vec3) {
        let w = q - self.centre_mm;
        let length = w.norm();
        let direction = if length > 0.0 { w / length } else { Vec3::z() };
        (length - self.radius_mm, direction)
    }
}

/// How far beyond its apex and its rim a cone is still taken for unbounded, in mm.
const BEYOND_MM: f64 = 1.0;

impl Cone {
    /// The distance to the flank; none beyond apex and rim.
    fn near(&self, q: &Vec3) -> Option<(f64, Vec3)> {
        let w = self.pose.undo(q);
        if w.z >= BEYOND_MM || w.z <= -self.height_mm - BEYOND_MM {
            return None;
        }
        let (sine, cosine) = self.half_angle_rad.sin_cos();
        let r = w.x.hypot(w.y);
        let out = if r > 1e-12 {
            (w.x / r, w.y / r)
        } else {
            (0.0, 0.0)
        };
        let direction = self.pose.rotation * Vec3::new(out.0 * cosine, out.1 * cosine, sine);
        Some((r * cosine + w.z * sine, direction))
    }
}
