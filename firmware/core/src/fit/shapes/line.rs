//! Straight line in space: a point and a direction.

use nalgebra::Vector3;

use crate::fit::solve::cloud::Cloud;
use crate::fit::solve::linalg::{canonical_sign, norm, outer_sum};
use crate::fit::{FitError, MIN_CURVATURE, PointSet, Quantity, Statistics, limits};
use crate::units::{Mm, Point};

/// Points that a line needs.
pub const MIN_POINTS: usize = 2;

/// A line fitted by orthogonal least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineFit {
    /// The centroid of the points, which lies on the line.
    pub point: Point,
    /// Unit direction; its largest component is positive.
    pub direction: Vector3<f64>,
    /// Statistics of the distances from the line; a point is two observations,
    /// so `dof` is 2n - 4.
    pub stats: Statistics,
    /// Covariance of the direction for unit noise, 1/mm², rank 2.
    pub cov_unit_direction: [[f64; 3]; 3],
    /// Covariance of `point` across the line for unit noise, rank 2.
    pub cov_unit_point: [[f64; 3]; 3],
}

/// Fits a line: the direction is that of largest spread.
///
/// # Errors
/// * `too_few_points` below two points, `not_finite`, `degenerate` if they
///   coincide;
/// * `ill_conditioned` if the points are about as wide as long, or if the
///   standard uncertainty of the direction is above
///   [`crate::fit::MAX_RELATIVE_UNCERTAINTY`] radians.
pub fn fit(points: &[Point]) -> Result<LineFit, FitError> {
    let cloud = Cloud::new(points, PointSet::Points, MIN_POINTS)?;
    let spread = cloud.spread();
    let [along, second, third] = spread.axes;
    let [long, wide, _] = spread.values.map(|value| cloud.mm(value).0);
    let distance = |q: Vector3<f64>| {
        let across = second * second.dot(&q) + third * third.dot(&q);
        cloud.mm(norm(&across)).0
    };
    let stats = Statistics::new(
        cloud.local().map(distance),
        2 * cloud.len() - 4,
        cloud.rounding(),
    );
    if wide * wide > (1.0 - MIN_CURVATURE) * long * long {
        // The line along the second axis has the same distances along the third,
        // and the first axis' coordinates in place of the second's.
        let n = cloud.count();
        let other = stats.rms.0 * stats.rms.0 + (long * long - wide * wide) / n;
        let other_rms_mm = libm::sqrt(other);
        return Err(FitError::Ambiguous {
            best_rms_mm: stats.rms.0,
            other_rms_mm,
        });
    }
    let across = |weight: f64| outer_sum([(weight, second), (weight, third)]);
    let result = LineFit {
        point: cloud.point_at(&Vector3::zeros()),
        direction: canonical_sign(&along),
        stats,
        cov_unit_direction: across(1.0 / (long * long)),
        cov_unit_point: across(1.0 / cloud.count()),
    };
    limits::uncertain(&result.stats, Quantity::Direction, 1.0 / (long * long), 1.0)?;
    Ok(result)
}

impl LineFit {
    /// Distance of a point from the line.
    #[must_use]
    pub fn residual(&self, p: Point) -> Mm {
        let v = p.mm - self.point.mm;
        Mm(norm(&(v - self.direction * self.direction.dot(&v))))
    }

    /// Covariance of the direction, dimensionless.
    #[must_use]
    pub fn cov_direction(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_direction)
    }

    /// Covariance of `point` across the line, mm².
    #[must_use]
    pub fn cov_point(&self) -> Option<[[f64; 3]; 3]> {
        self.stats.covariance(&self.cov_unit_point)
    }

    /// Standard uncertainties of the direction's x, y and z (radians).
    #[must_use]
    pub fn direction_uncertainty(&self) -> Option<[f64; 3]> {
        self.stats.uncertainties(&self.cov_unit_direction)
    }

    /// Standard uncertainties of x, y and z of `point` across the line.
    #[must_use]
    pub fn point_uncertainty(&self) -> Option<[Mm; 3]> {
        self.stats
            .uncertainties(&self.cov_unit_point)
            .map(|u| u.map(Mm))
    }
}
