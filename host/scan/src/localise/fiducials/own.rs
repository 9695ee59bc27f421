//! One fiducial fitted by itself.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector6};

use super::super::fit::{self, INLIER, row};
use super::{FiducialShape, Sought};
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, rotation_vector, stepped};
use crate::solve::{Measured, eigen, measure_within};
use crate::surface::Mesh;

/// A fiducial where its own points put it.
#[derive(Clone, Debug)]
pub(super) struct Own {
    /// Scan from the fiducial's own frame. What its points do not hold is as it was at the start.
    pub motion: Pose,
    /// The noise along the normals in mm.
    pub sigma_mm: f64,
    /// The points on it, with what they measure.
    pub on: Vec<(Vec3, Measured)>,
    /// How many lie a little off it.
    pub beside: usize,
}

/// How much larger or steeper than it should be something is, and what that may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct SizeOff {
    pub off: f64,
    /// What may be, either way.
    pub most: f64,
}

/// Points that a fiducial needs.
const LEAST: usize = 12;
/// Steps at the end of a fit at most.
const LAST: usize = 30;
/// A motion is held if the points hold it by this share of the best one, in squares.
const HELD: f64 = 1e-3;
/// An edge is sharp if the normals beside it differ by more than 30 degrees (their cosine).
const SHARP: f64 = 0.866;

impl Sought<'_> {
    /// The fiducial `k` by its own points, from a start that is right to about `reach` mm. What its points do not hold is
    /// as it was at the start.
    pub fn own(&self, k: usize, start: &Pose, reach: f64) -> Option<Own> {
        self.own_by(&self.fine, k, start, reach)
    }

    /// The same by these points of the scan.
    pub fn own_by(&self, points: &[Vec3], k: usize, start: &Pose, reach: f64) -> Option<Own> {
        let mut found = self.settled_at(points, k, start, reach, LAST)?;
        if !self.rims[k].is_empty() {
            // Once more from there: which points lie beside a rim is known better now.
            let again = (4.0 * INLIER * found.sigma_mm).min(reach);
            found = self.settled_at(points, k, &found.held_from(start), again, LAST)?;
            found = self.seen_at(points, k, &found.held_from(start), found.sigma_mm);
        }
        let size = self.task.fiducials[k].shape.size_mm();
        // A wrong place has as many points a little off the surface as on it, and is rougher than the scan.
        let stands = found.on.len() >= LEAST
            && found.beside <= found.on.len()
            && found.sigma_mm < 4.0 * self.noise_mm + 0.02 * size;
        stands.then_some(found)
    }

    /// The fit of the points near to where `start` puts the fiducial, without those beside a rim: what lies beyond a rim
    /// is not known, and a ledge there would draw the body along a side that the scan does not show. `last`: its last
    /// steps at most.
    pub fn settled_at(
        &self,
        points: &[Vec3],
        k: usize,
        start: &Pose,
        reach: f64,
        last: usize,
    ) -> Option<Own> {
        let one = Threads::new(1);
        let surface = &self.surfaces[k];
        let floor = self.floor_mm();
        let settled = if self.rims[k].is_empty() {
            fit::settle(surface, points, start, reach, floor, last, one)?
        } else {
            let inside = fit::boxed(surface, start, 3.0 * reach);
            let near: Vec<Vec3> = points.iter().filter(|q| inside(q)).copied().collect();
            // What is farther is left out by the fit, too.
            let far = 3.0 * reach;
            let measured = measure_within(surface, &near, start, &[], far, one);
            let within: Vec<Vec3> = near
                .iter()
                .zip(&measured)
                .filter(|(q, m)| m.distance_mm.abs() < far && self.is_within(k, start, q, m))
                .map(|(q, _)| *q)
                .collect();
            fit::settle(surface, &within, start, reach, floor, last, one)?
        };
        let found = self.seen_at(points, k, &settled.motion, settled.sigma_mm);
        (found.on.len() >= LEAST).then_some(found)
    }

    /// What the points say where the fiducial is.
    fn seen_at(&self, points: &[Vec3], k: usize, motion: &Pose, sigma_mm: f64) -> Own {
        let surface = &self.surfaces[k];
        let inside = fit::boxed(surface, motion, 3.0 * INLIER * sigma_mm);
        let near: Vec<Vec3> = points.iter().filter(|q| inside(q)).copied().collect();
        let reach = 3.0 * INLIER * sigma_mm;
        let measured = measure_within(surface, &near, motion, &[], reach, Threads::new(1));
        let mut own = Own {
            motion: *motion,
            sigma_mm,
            on: Vec::new(),
            beside: 0,
        };
        for (q, m) in near.into_iter().zip(measured) {
            if m.distance_mm.abs() >= reach || !self.is_within(k, motion, &q, &m) {
                continue;
            }
            let far = m.distance_mm.abs() / sigma_mm;
            if far < INLIER {
                own.on.push((q, m));
            } else if far < 3.0 * INLIER {
                own.beside += 1;
            }
        }
        own
    }

    /// Whether the foot of a point lies within the surface of the fiducial `k`, away from its rims.
    fn is_within(&self, k: usize, motion: &Pose, q: &Vec3, m: &Measured) -> bool {
        let surface = &self.surfaces[k];
        let triangles = surface.mesh.as_ref().map_or(&[][..], Mesh::triangles);
        let Some(t) = triangles.get(m.face) else {
            return true;
        };
        if (motion.rotation * t.normal).dot(&m.direction).abs() < 0.9 {
            return false;
        }
        let foot = motion.undo(&(q - m.direction * m.distance_mm));
        let size = self.task.fiducials[k].shape.size_mm();
        is_apart(&foot, &self.rims[k], margin(self.noise_mm, size))
    }

    /// Whether what was found is as large (a ball) or as steep (a cone) as it should be.
    pub fn is_this_size(&self, k: usize, own: &Own) -> bool {
        self.size_off(k, own)
            .is_none_or(|SizeOff { off, most }| off.abs() < most)
    }

    /// How much larger (a ball, in mm) or steeper (a cone, in rad) what was found is than it should be. None: it is a body, or
    /// too little of it is seen to tell.
    pub fn size_off(&self, k: usize, own: &Own) -> Option<SizeOff> {
        let shape = &self.task.fiducials[k].shape;
        // How a distance changes with the size, and how far the size may be off.
        let grow = |p: &Vec3| match shape {
            FiducialShape::Cone { half_angle_rad, .. } => {
                let (s, c) = half_angle_rad.sin_cos();
                p.z * c - p.x.hypot(p.y) * s
            }
            _ => -1.0,
        };
        let tolerance = match shape {
            FiducialShape::Mesh(_) => return None,
            FiducialShape::Ball { radius_mm } => 0.01 * radius_mm,
            FiducialShape::Cone { .. } => 1f64.to_radians(),
        };
        let about = own.middle();
        let arm = own.arm(&about);
        let mut matrix = SMatrix::<f64, 7, 7>::zeros();
        let mut right = SVector::<f64, 7>::zeros();
        let mut rms_grow = 0.0;
        for (q, m) in &own.on {
            let r = row(q, m, &about, arm);
            let g = grow(&own.motion.undo(q));
            rms_grow += g * g;
            let full = SVector::<f64, 7>::from([r[0], r[1], r[2], r[3], r[4], r[5], g]);
            matrix += full * full.transpose();
            right -= full * m.distance_mm;
        }
        let n = own.on.len() as f64;
        // The seventh alone, with all that the pose can do taken out.
        let six: Matrix6<f64> = matrix.fixed_view::<6, 6>(0, 0).into_owned();
        let cross: Vector6<f64> = matrix.fixed_view::<6, 1>(0, 6).into_owned();
        let by_pose = crate::solve::pseudo_solve(&six, &cross, 1e-9);
        let left = matrix[(6, 6)] - cross.dot(&by_pose);
        if left < 1e-4 * rms_grow.max(1e-12) {
            return None;
        }
        let first: Vector6<f64> = right.fixed_view::<6, 1>(0, 0).into_owned();
        let off = (right[6] - by_pose.dot(&first)) / left;
        let u = own.sigma_mm / left.sqrt();
        let rough = 0.5 * own.sigma_mm / (rms_grow / n).sqrt();
        Some(SizeOff {
            off,
            most: tolerance + rough + 5.0 * u,
        })
    }
}

/// How many motions this information holds by this share of the best one, in squares.
pub(super) fn rank(information: &Matrix6<f64>, held: f64) -> usize {
    let (values, _) = eigen(information);
    values.iter().filter(|v| **v > held * values[5]).count()
}

/// From where to where; and the same by its bits, of either direction.
type Edge = [Vec3; 2];
type Ends = [[u64; 3]; 2];

/// Every edge with the triangles beside it.
fn edges(mesh: &Mesh) -> impl Iterator<Item = (Edge, Vec<usize>)> {
    // Zero has two signs.
    let key = |v: &Vec3| [v.x, v.y, v.z].map(|x| (x + 0.0).to_bits());
    let mut all: BTreeMap<Ends, (Edge, Vec<usize>)> = BTreeMap::new();
    for (k, t) in mesh.triangles().iter().enumerate() {
        for i in 0..3 {
            let edge = [t.corners[i], t.corners[(i + 1) % 3]];
            let mut ends = edge.map(|v| key(&v));
            ends.sort_unstable();
            all.entry(ends).or_insert((edge, Vec::new())).1.push(k);
        }
    }
    all.into_values()
}

/// Whether the surface turns sharply between these triangles.
fn is_sharp(mesh: &Mesh, beside: &[usize]) -> bool {
    let normal = |k: usize| mesh.triangles()[k].normal;
    (beside.iter()).any(|&k| normal(k).dot(&normal(beside[0])) < SHARP)
}

/// The edges that one triangle alone has, and those over which the surface turns sharply. Nothing is said of what lies
/// beyond the former; a body that ends flush with another one shows none of the latter.
pub(super) fn rims(mesh: &Mesh) -> Vec<Edge> {
    edges(mesh)
        .filter(|(_, beside)| beside.len() == 1 || is_sharp(mesh, beside))
        .map(|(edge, _)| edge)
        .collect()
}

/// The edges over which the surface turns sharply, with the two triangles beside each.
pub(super) fn sharp(mesh: &Mesh) -> Vec<(Edge, Vec<usize>)> {
    edges(mesh)
        .filter(|(_, beside)| beside.len() == 2 && is_sharp(mesh, beside))
        .collect()
}

/// How far a foot stays from a rim to count, in mm, for this noise and size of a fiducial.
pub(super) fn margin(noise_mm: f64, size_mm: f64) -> f64 {
    (3.0 * noise_mm).clamp(0.02 * size_mm, 0.1 * size_mm)
}

/// Whether a place is further than `margin` mm from all rims.
pub(super) fn is_apart(foot: &Vec3, rims: &[[Vec3; 2]], margin: f64) -> bool {
    rims.iter().all(|[a, b]| {
        let along = b - a;
        let t = (foot - a).dot(&along) / along.norm_squared();
        (a + along * t.clamp(0.0, 1.0) - foot).norm() > margin
    })
}

impl Own {
    /// Where it is, with what its points do not hold as `start` has it.
    pub fn held_from(&self, start: &Pose) -> Pose {
        let about = self.middle();
        let arm = self.arm(&about);
        let (values, vectors) = eigen(&self.information(&about, arm));
        let whole = self.step_from(start, &about, arm);
        let mut step = Vector6::zeros();
        for k in (0..6).filter(|&k| values[k] > HELD * values[5]) {
            let v = vectors.column(k);
            step += v * v.dot(&whole);
        }
        for i in 0..3 {
            step[i] /= arm;
        }
        stepped(start, &step, &about)
    }

    pub fn middle(&self) -> Vec3 {
        let first = self.on[0].0;
        first + self.on.iter().map(|(q, _)| q - first).sum::<Vec3>() / self.on.len() as f64
    }

    fn arm(&self, about: &Vec3) -> f64 {
        let sum: f64 = self
            .on
            .iter()
            .map(|(q, _)| (q - about).norm_squared())
            .sum();
        (sum / self.on.len() as f64).sqrt().max(1e-6)
    }

    /// The information of its points about `about`, for a noise of 1 mm.
    pub fn information(&self, about: &Vec3, arm: f64) -> Matrix6<f64> {
        self.on
            .iter()
            .map(|(q, m)| {
                let r = row(q, m, about, arm);
                r * r.transpose()
            })
            .sum()
    }

    /// How many motions its points hold.
    pub fn rank(&self) -> usize {
        let about = self.middle();
        rank(&self.information(&about, self.arm(&about)), HELD)
    }

    /// How far the motion to `other` carries its points along their normals, root of the mean square, in mm: what its points
    /// do not hold counts for nothing.
    pub fn off_mm(&self, other: &Pose) -> f64 {
        let about = self.middle();
        let arm = self.arm(&about);
        let step = self.step_from(other, &about, arm);
        let squares = step.dot(&(self.information(&about, arm) * step));
        (squares / self.on.len() as f64).sqrt()
    }

    /// Whether the points surround it enough to be it and not something flat beside it.
    pub fn holds(&self, shape: &FiducialShape) -> bool {
        let spread: Matrix3<f64> = self
            .on
            .iter()
            .map(|(_, m)| m.direction * m.direction.transpose())
            .sum();
        let (values, _) = eigen(&spread);
        let n = self.on.len() as f64;
        match shape {
            FiducialShape::Mesh(_) => values[1] > 0.03 * n,
            FiducialShape::Ball { .. } => values[0] > 0.02 * n && 2 * self.beside <= self.on.len(),
            FiducialShape::Cone { .. } => values[0] > 0.01 * n && 2 * self.beside <= self.on.len(),
        }
    }

    /// The small motion (turn times `arm` about `about`, shift) from `from` to where it is.
    pub fn step_from(&self, from: &Pose, about: &Vec3, arm: f64) -> Vector6<f64> {
        let step = self.motion.after(&from.inverse());
        let w = rotation_vector(&step.rotation) * arm;
        let d = step.point(about) - about;
        Vector6::new(w.x, w.y, w.z, d.x, d.y, d.z)
    }
}
