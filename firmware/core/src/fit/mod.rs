//! Orthogonal least-squares fits of sphere, plane, line, circle, cylinder and
//! cone.
//!
//! All fits minimise the sum of squared orthogonal residuals, work on
//! coordinates that are centred and scaled by a power of two (points far from
//! the origin lose no digits), and return only what was proved to be a minimum:
//! gradient zero to rounding and Hessian positive definite.
//!
//! # What is promised
//!
//! * Parameters agree with the exact least-squares answer within 256 times the
//!   first-order effect of rounding, or 1e-9 mm, whichever is larger.
//! * `cov_unit` matrices agree within 1e-6 of their largest element.
//! * The predicted standard uncertainty agrees with the scatter of repeated
//!   fits (10 % over 2000 repetitions in the tests) where noise is independent,
//!   equal for all points and small against the radius.
//! * No result ever contains a NaN or an infinity.
//! * The same points in the same order give the same bits on every target.
//!
//! # What is refused
//!
//! Every refusal is a [`FitError`]. The limits are constants of this module:
//! [`SPREAD_LIMIT`], [`MAX_CONDITION`], [`MAX_RELATIVE_UNCERTAINTY`],
//! [`MIN_CURVATURE`], [`MAX_COORDINATE`] and [`MIN_EXTENT`].
//!
//! Covariances are `sigma² inv(JᵀJ)`, the usual first-order propagation. With
//! few degrees of freedom `sigma` itself is poorly known: multiply a standard
//! uncertainty by Student's t for `stats.dof` to get a 95 % interval.

pub mod error;
mod limits;
mod shapes;
pub(crate) mod solve;
pub mod statistics;
#[cfg(test)]
pub(crate) mod tests;

pub use error::{Degeneracy, FitError, PointSet, Quantity};
pub use shapes::{circle, circle2d, cone, cylinder, line, plane, sphere};

pub use shapes::circle::CircleFit;
pub use shapes::circle2d::Circle2dFit;
pub use shapes::cone::ConeFit;
pub use shapes::cylinder::CylinderFit;
pub use shapes::line::LineFit;
pub use shapes::plane::PlaneFit;
pub use shapes::sphere::SphereFit;
pub use statistics::Statistics;

use crate::units::Mm;

/// A dimension counts as missing (coincident, collinear, coplanar points) if
/// the spread along it is below this part of the largest spread. Spread is the
/// root of the sum of squared distances from the centroid along a principal
/// axis. A cap of a sphere gets here at a half angle of about 0.03 degrees.
pub const SPREAD_LIMIT: f64 = 1e-4;

/// The largest accepted condition: the error of a quantity over the error of a
/// point. At this limit one nanometre at the points is a millimetre in the
/// result.
pub const MAX_CONDITION: f64 = 1e6;

/// The largest accepted standard uncertainty of a radius, centre or axis over
/// the radius, and of a direction in radians. At this limit the curvature
/// 1/radius is five standard uncertainties away from flat; beyond it the
/// first-order covariance means nothing.
pub const MAX_RELATIVE_UNCERTAINTY: f64 = 0.2;

/// The least accepted curvature of the sum of squares at the solution, as part
/// of that of the linearised problem (its Gauss-Newton matrix). It is 1 for
/// points without residuals, and 0 or less where the solution is no minimum.
pub const MIN_CURVATURE: f64 = 0.05;

/// Coordinates beyond this are refused, long before their squares overflow.
pub const MAX_COORDINATE: Mm = Mm(1e12);

/// Point sets smaller than this (a picometre) are one point.
pub const MIN_EXTENT: Mm = Mm(1e-9);

/// Sums of squares are zero, and `sigma` not given, when the rms residual is
/// below this many roundings of the largest coordinate.
pub(crate) const EXACT_FIT_ROUNDINGS: f64 = 16.0;
