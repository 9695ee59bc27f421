//! Planes and balls as the solver sees them, and where they are looked for first.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use umi_kinematics::Pose;

use super::observations::{Observation, Observations};

/// A plane or a ball in the workpiece's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SampleSights {
    /// `normal · (p - anchor) - height`; the anchor stays where the points are.
    Plane {
        normal: Vector3<f64>,
        anchor_mm: Vector3<f64>,
        height_mm: f64,
    },
    /// `|p - centre| - radius`.
    Ball { centre_mm: Vector3<f64> },
}

/// The points of each feature in the workpiece's frame, with this mount.
pub(super) fn points_by_feature(all: &Observations, mount: &Pose) -> Vec<Vec<Vector3<f64>>> {
    let mut points = vec![Vec::new(); all.features.len()];
    for seen in &all.points {
        let p = all.flanges[seen.flange].point(&mount.point(&seen.seen_mm));
        points[seen.feature].push(p);
    }
    points
}

/// The plane through the points that leaves the least squares.
pub(super) fn plane_through(points: &[Vector3<f64>]) -> SampleSights {
    let sum: Vector3<f64> = points.iter().sum();
    let anchor_mm = sum / points.len().max(1) as f64;
    let mut scatter = Matrix3::zeros();
    for point in points {
        let arm = point - anchor_mm;
        scatter += arm * arm.transpose();
    }
    let eigen = scatter.symmetric_eigen();
    let normal = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    SampleSights::Plane {
        normal,
        anchor_mm,
        height_mm: 0.0,
    }
}

/// The centre of the ball through the points, by the linear (algebraic) fit; their middle
/// where that has no answer.
pub(super) fn algebraic_centre(points: &[Vector3<f64>]) -> Vector3<f64> {
    let sum: Vector3<f64> = points.iter().sum();
    let middle = sum / points.len().max(1) as f64;
    let a = DMatrix::from_fn(points.len(), 4, |i, k| match k {
        3 => 1.0,
        k => points[i][k] - middle[k],
    });
    let b = DVector::from_iterator(
        points.len(),
        points.iter().map(|p| (p - middle).norm_squared()),
    );
    let normal = a.tr_mul(&a);
    let Some(solved) = normal.cholesky().map(|c| c.solve(&a.tr_mul(&b))) else {
        return middle;
    };
    let centre = middle + 0.5 * Vector3::new(solved[0], solved[1], solved[2]);
    if centre.iter().all(|v| v.is_finite()) && (centre - middle).norm() < 1e3 {
        centre
    } else {
        middle
    }
}

/// A circle that a profile cuts out of a ball, in the sensor's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    pub flange: usize,
    pub feature: usize,
    /// Its centre, (x, 0, z).
    pub centre_mm: Vector3<f64>,
    pub radius_mm: f64,
    /// How many points it is of.
    pub points: usize,
    /// The sum of squares of what they are off the circle, in mm².
    pub off_circle: f64,
}

/// The circles of all profiles with enough points.
pub(super) fn cuts(all: &Observations) -> Vec<Cut> {
    let mut cuts = Vec::new();
    let mut begin = 0;
    while begin < all.points.len() {
        let first = all.points[begin];
        let same = all.points[begin..]
            .iter()
            .take_while(|p| (p.flange, p.feature) == (first.flange, first.feature))
            .count();
        let points = &all.points[begin..begin + same];
        begin += same;
        let sum: Vector3<f64> = points.iter().map(|p| p.seen_mm).sum();
        let middle = sum / same as f64;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for point in points {
            let p = point.seen_mm - middle;
            let row = Vector3::new(p.x, p.z, 1.0);
            normal += row * row.transpose();
            right += row * (p.x * p.x + p.z * p.z);
        }
        let Some(solved) = normal.cholesky().map(|c| c.solve(&right)) else {
            continue;
        };
        let centre = 0.5 * Vector3::new(solved.x, 0.0, solved.y);
        let radius_mm = (solved.z + centre.norm_squared()).sqrt();
        if same >= 5 && radius_mm.is_finite() && centre.norm() < 1e3 {
            let centre_mm = middle + centre;
            let off = |p: &Observation| (p.seen_mm - centre_mm).norm() - radius_mm;
            cuts.push(Cut {
                flange: first.flange,
                feature: first.feature,
                centre_mm,
                radius_mm,
                points: same,
                off_circle: points.iter().map(|p| off(p).powi(2)).sum(),
            });
        }
    }
    cuts
}

/// The middle of the cuts' centres of each feature, with this mount.
pub(super) fn middles(all: &Observations, cuts: &[Cut], mount: &Pose) -> Vec<Option<Vector3<f64>>> {
    (0..all.features.len())
        .map(|feature| {
            let mut n = 0.0;
            let mut sum = Vector3::zeros();
            for cut in cuts.iter().filter(|cut| cut.feature == feature) {
                sum += all.flanges[cut.flange].point(&mount.point(&cut.centre_mm));
                n += 1.0;
            }
            (n > 0.0).then(|| sum / n)
        })
        .collect()
}
