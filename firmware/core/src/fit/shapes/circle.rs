//! Circle in space: its plane first, then the circle in that plane.

use nalgebra::Vector3;

use super::circle2d::{InPlane, fit_disc};
use super::plane;
use crate::fit::solve::cloud::{Cloud, count};
use crate::fit::solve::linalg::{
    block3, canonical_sign, norm, perpendicular_frame, propagate, unit,
};
use crate::fit::{FitError, PointSet, Statistics};
use crate::units::{Mm, Point};

pub use super::circle2d::MIN_POINTS;

/// A circle fitted by orthogonal least squares within its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CircleFit {
    /// Centre, in the plane through the centroid of the points.
    pub center: Point,
    /// Radius.
    pub radius: Mm,
    /// Unit normal of the plane; its largest component is positive.
    pub normal: Vector3<f64>,
    /// Statistics of the residuals in the plane; `dof` is n - 3.
    pub stats: Statistics,
    /// rms distance of the points from the plane.
    pub rms_plane: Mm,
    /// `inv(JᵀJ)`: covariance for unit noise in the order centre x, y, z,
    /// radius; of the centre only the part in the plane (rank 3).
    pub cov_unit: [[f64; 4]; 4],
}

/// Fits a circle in the least-squares plane of the points.
///
/// # Errors
/// Those of [`plane::fit`] and, in the plane, of [`super::circle2d::fit`].
pub fn fit(points: &[Point]) -> Result<CircleFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    let (plane, spread) = plane::fit_cloud(&cloud)?;
    let [e1, e2, _] = spread.axes;
    fit_across(&cloud, &plane.normal, &InPlane { e1, e2 })
}

/// Fits a circle in the plane of the given normal through the centroid of the
/// points, for a known plane: the result does not depend on how well the points
/// determine one.
///
/// # Errors
/// Those of [`super::circle2d::fit`], and `degenerate` for a normal of no length.
pub fn fit_in_plane(points: &[Point], normal: &Vector3<f64>) -> Result<CircleFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    let normal = unit(normal).ok_or(FitError::NoDirection)?;
    let (e1, e2) = perpendicular_frame(&normal);
    fit_across(&cloud, &canonical_sign(&normal), &InPlane { e1, e2 })
}

fn fit_across(
    cloud: &Cloud<'_>,
    normal: &Vector3<f64>,
    in_plane: &InPlane,
) -> Result<CircleFit, FitError> {
    let (disc, stats, cov) = fit_disc(cloud, in_plane)?;
    let InPlane { e1, e2 } = in_plane;
    let off_plane = cloud.local().fold(0.0, |sum, q| {
        let d = normal.dot(&q);
        sum + d * d
    });
    Ok(CircleFit {
        center: cloud.point_at(&(e1 * disc.x + e2 * disc.y)),
        radius: cloud.mm(disc.radius),
        normal: *normal,
        stats,
        rms_plane: cloud.mm(libm::sqrt(off_plane / count(stats.n))),
        cov_unit: propagate(
            &[
                [e1.x, e2.x, 0.0],
                [e1.y, e2.y, 0.0],
                [e1.z, e2.z, 0.0],
                [0.0, 0.0, 1.0],
            ],
            &cov,
        ),
    })
}

impl CircleFit {
    /// Distance of a point from the circle within its plane, positive outside.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        let v = p.mm - self.center.mm;
        Mm(norm(&(v - self.normal * self.normal.dot(&v))) - self.radius.0)
    }

    /// rms distance from the circle in space: in the plane and off it.
    #[must_use]
    pub fn rms_total(&self) -> Mm {
        let (inside, off) = (self.stats.rms.0, self.rms_plane.0);
        Mm(libm::sqrt(inside * inside + off * off))
    }

    /// Covariance in the order centre x, y, z, radius, mm².
    #[must_use]
    pub fn cov(&self) -> Option<[[f64; 4]; 4]> {
        self.stats.covariance(&self.cov_unit)
    }

    /// Standard uncertainties of x, y and z of the centre, in the plane.
    #[must_use]
    pub fn center_uncertainty(&self) -> Option<[Mm; 3]> {
        self.stats
            .uncertainties(&block3(&self.cov_unit))
            .map(|u| u.map(Mm))
    }

    /// Standard uncertainty of the radius.
    #[must_use]
    pub fn radius_uncertainty(&self) -> Option<Mm> {
        let [.., [.., variance]] = self.cov_unit;
        self.stats.standard_uncertainty(variance).map(Mm)
    }
}
