//! Plane: a point and a normal.

use nalgebra::Vector3;

use crate::fit::solve::cloud::{Cloud, Spread};
use crate::fit::solve::linalg::{canonical_sign, outer_sum};
use crate::fit::{FitError, MIN_CURVATURE, PointSet, Quantity, Statistics, limits};
use crate::units::{Mm, Point};

/// Points that a plane needs.
pub const MIN_POINTS: usize = 3;

/// A plane fitted by orthogonal least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneFit {
    /// The centroid of the points, which lies in the plane.
    pub point: Point,
    /// Unit normal; its largest component is positive.
    pub normal: Vector3<f64>,
    /// Distance of the plane from the origin along the normal: normal · point.
    pub offset: Mm,
    /// Statistics of the residuals; `dof` is n - 3.
    pub stats: Statistics,
    /// Covariance of the normal for unit noise, 1/mm², rank 2.
    pub cov_unit_normal: [[f64; 3]; 3],
    /// Variance of the offset at `point` for unit noise: 1/n.
    pub var_unit_offset_at_point: f64,
}

/// Fits a plane: the normal is the direction of least spread, from a singular
/// value decomposition of the centred points (Shakarji, J. Res. NIST 103, 1998).
///
/// # Errors
/// * `too_few_points` below three points, `not_finite`, `degenerate` for
///   collinear points (see [`crate::fit::SPREAD_LIMIT`]);
/// * `ill_conditioned` if the points are about as thick as wide, so that planes
///   across each other fit as well, or if the standard uncertainty of the normal
///   is above [`crate::fit::MAX_RELATIVE_UNCERTAINTY`] radians.
pub fn fit(points: &[Point]) -> Result<PlaneFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    fit_cloud(&cloud).map(|(plane, _)| plane)
}

/// The plane with the principal axes; the circle fit builds on it.
pub(crate) fn fit_cloud(cloud: &Cloud<'_>) -> Result<(PlaneFit, Spread), FitError> {
    let spread = cloud.spread();
    spread.require_plane()?;
    let [first, second, third] = spread.axes;
    let [wide, middle, thin] = spread.values.map(|value| cloud.mm(value).0);
    let normal = canonical_sign(&third);
    let point = cloud.point_at(&Vector3::zeros());
    let stats = Statistics::new(
        cloud.local().map(|q| cloud.mm(normal.dot(&q)).0),
        cloud.len() - MIN_POINTS,
        cloud.rounding(),
    );
    // The curvature of the sum of squares is middle² - thin².
    if thin * thin > (1.0 - MIN_CURVATURE) * middle * middle {
        let other_rms_mm = middle / libm::sqrt(cloud.count());
        return Err(FitError::Ambiguous {
            best_rms_mm: stats.rms.0,
            other_rms_mm,
        });
    }
    let result = PlaneFit {
        point,
        normal,
        offset: Mm(normal.dot(&point.mm)),
        stats,
        cov_unit_normal: outer_sum([
            (1.0 / (wide * wide), first),
            (1.0 / (middle * middle), second),
        ]),
        var_unit_offset_at_point: 1.0 / cloud.count(),
    };
    limits::uncertain(
        &result.stats,
        Quantity::Direction,
        1.0 / (middle * middle),
        1.0,
    )?;
    Ok((result, spread))
}

impl PlaneFit {
    /// Distance of a point from the plane, positive on the side of the normal.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        Mm(self.normal.dot(&(p.mm - self.point.mm)))
    }

    /// Covariance of the normal, dimensionless.
    #[must_use]
    pub fn cov_normal(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_normal)
    }

    /// Variance of the offset at `point`, mm².
    #[must_use]
    pub fn var_offset_at_point(&self) -> Option<f64> {
        self.stats
            .variance_mm2()
            .map(|variance| variance * self.var_unit_offset_at_point)
    }
}
