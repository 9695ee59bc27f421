//! One fiducial fitted by itself.

use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector6};

use super::super::fit::{self, INLIER, row};
use super::{FiducialShape, Sought};
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, rotation_vector};
use crate::solve::{Measured, eigen, measure};
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

/// Points that a fiducial needs.
const LEAST: usize = 12;

impl Sought<'_> {
    /// The fiducial `k` by its own points, from a start that is right to about `reach` mm.
    pub fn own(&self, k: usize, start: &Pose, reach: f64) -> Option<Own> {
        let one = Threads::new(1);
        let surface = &self.surfaces[k];
        let settled = fit::settle(surface, &self.fine, start, reach, self.floor_mm(), 30, one)?;
        let sigma = settled.sigma_mm;
        let inside = fit::boxed(surface, &settled.motion, 3.0 * INLIER * sigma);
        let near: Vec<Vec3> = self.fine.iter().filter(|q| inside(q)).copied().collect();
        let measured = measure(surface, &near, &settled.motion, &[], one);
        let mut on = Vec::new();
        let mut beside = 0;
        let triangles = surface.mesh.as_ref().map_or(&[][..], Mesh::triangles);
        for (q, m) in near.into_iter().zip(measured) {
            // A foot on a rim says nothing: what lies beyond it is not known.
            let normal = triangles
                .get(m.face)
                .map(|t| settled.motion.rotation * t.normal);
            if normal.is_some_and(|n| n.dot(&m.direction).abs() < 0.9) {
                continue;
            }
            let far = m.distance_mm.abs() / sigma;
            if far < INLIER {
                on.push((q, m));
            } else if far < 3.0 * INLIER {
                beside += 1;
            }
        }
        let size = self.task.fiducials[k].shape.size_mm();
        // A wrong place has as many points a little off the surface as on it, and is rougher than the scan.
        let stands =
            on.len() >= LEAST && beside <= on.len() && sigma < 4.0 * self.noise_mm + 0.02 * size;
        stands.then_some(Own {
            motion: settled.motion,
            sigma_mm: sigma,
            on,
            beside,
        })
    }

    /// Whether what was found is as large (a ball) or as steep (a cone) as it should be.
    pub fn is_this_size(&self, k: usize, own: &Own) -> bool {
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
            FiducialShape::Mesh(_) => return true,
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
            return true;
        }
        let first: Vector6<f64> = right.fixed_view::<6, 1>(0, 0).into_owned();
        let off = (right[6] - by_pose.dot(&first)) / left;
        let u = own.sigma_mm / left.sqrt();
        let rough = 0.5 * own.sigma_mm / (rms_grow / n).sqrt();
        off.abs() < tolerance + rough + 5.0 * u
    }
}

impl Own {
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
        let (values, _) = eigen(&self.information(&about, self.arm(&about)));
        values.iter().filter(|v| **v > 1e-3 * values[5]).count()
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
