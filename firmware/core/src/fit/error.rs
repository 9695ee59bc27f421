//! Fit errors: the reasons why points cannot be fitted.

use core::fmt;

use strum::{Display, IntoStaticStr};
use thiserror::Error;

/// Which list of points an error speaks of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Display)]
pub enum PointSet {
    /// The points of a fit (there is only one list).
    #[strum(serialize = "point")]
    Points,
    /// The source (nominal, CAD) side of a registration.
    #[strum(serialize = "source point")]
    Source,
    /// The target (measured, MCS) side of a registration.
    #[strum(serialize = "target point")]
    Target,
}

/// How a set of points lacks a dimension that the geometry needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Degeneracy {
    /// All points are one point, up to the rounding of their coordinates.
    #[error("all coincide: probe points that lie apart")]
    Coincident,
    /// Repeated points leave only `distinct` different ones.
    #[error(
        "repeat each other, only {distinct} of {needed} needed are distinct: probe more places"
    )]
    Duplicates {
        /// Different points in the list.
        distinct: usize,
        /// Different points that the geometry needs.
        needed: usize,
    },
    /// All points on one straight line.
    #[error("lie on one straight line: add a point well off it")]
    Collinear,
    /// All points in one plane.
    #[error("lie in one plane: add a point well off it")]
    Coplanar,
}

/// The quantity whose condition was too poor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Display)]
#[strum(serialize_all = "lowercase")]
pub enum Quantity {
    /// The centre of a sphere or circle.
    #[strum(serialize = "centre")]
    Center,
    /// The radius of a sphere, circle or cylinder.
    Radius,
    /// The direction of a normal or of an axis.
    Direction,
    /// The position of an axis.
    #[strum(serialize = "position of the axis")]
    Position,
    /// The half angle of a cone.
    #[strum(serialize = "half angle")]
    HalfAngle,
    /// The apex of a cone.
    Apex,
    /// The rotation of a registration.
    Rotation,
}

/// Why a fit or a registration was refused.
///
/// [`FitError::code`] is stable and meant for machines, [`fmt::Display`] says
/// what is wrong and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum FitError {
    /// Fewer points than the geometry has to have.
    #[error("{given} points given, at least {needed} needed: probe more points")]
    TooFewPoints {
        /// Points in the list.
        given: usize,
        /// Points that the geometry needs.
        needed: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("{set} {} has a coordinate that is not a number: remove or measure it again", .row.saturating_add(1))]
    NotFinite {
        /// The list it is in.
        set: PointSet,
        /// Its row, the first is 0.
        row: usize,
    },
    /// A coordinate is finite but beyond [`crate::fit::MAX_COORDINATE`], where
    /// squares could overflow: no position on a machine.
    #[strum(serialize = "not_finite")]
    #[error("{set} {} has a coordinate beyond {:e} mm: check the unit and the digits", .row.saturating_add(1), super::MAX_COORDINATE.0)]
    OutOfRange {
        /// The list it is in.
        set: PointSet,
        /// Its row, the first is 0.
        row: usize,
    },
    /// The points lack a dimension.
    #[error("the {set}s {why}")]
    Degenerate {
        /// The list that does.
        set: PointSet,
        /// In which way.
        why: Degeneracy,
    },
    /// The points are not degenerate, but by where they lie they hardly
    /// determine a quantity.
    #[error(
        "the points hardly determine the {quantity}: condition {condition:.1e}, limit {limit:.1e}; spread them wider"
    )]
    IllConditioned {
        /// Which quantity.
        quantity: Quantity,
        /// Its condition: how many times the error of a point comes back in it
        /// (for a direction, over the extent of the points).
        condition: f64,
        /// The limit that it broke, [`crate::fit::MAX_CONDITION`].
        limit: f64,
    },
    /// By where the points lie and how much they scatter, a quantity is too
    /// uncertain for its covariance to mean anything.
    #[strum(serialize = "ill_conditioned")]
    #[error(
        "the points scatter too much to say the {quantity}: relative standard uncertainty {relative_uncertainty:.3}, limit {limit:.3}; spread them wider or check the feature"
    )]
    Uncertain {
        /// Which quantity.
        quantity: Quantity,
        /// Its standard uncertainty over its natural size: the radius for
        /// lengths, one radian for directions, the angle itself for angles.
        relative_uncertainty: f64,
        /// The limit, [`crate::fit::MAX_RELATIVE_UNCERTAINTY`].
        limit: f64,
    },
    /// The cap or arc is so small for its noise that its curvature, and with
    /// it radius and centre, cannot be said.
    #[error(fmt = cap_too_small)]
    CapTooSmall {
        /// Standard uncertainty of the radius over the radius (infinite if the
        /// best surface is a plane).
        relative_uncertainty: f64,
        /// The limit, [`crate::fit::MAX_RELATIVE_UNCERTAINTY`].
        limit: f64,
    },
    /// Different answers fit the points about equally well.
    #[strum(serialize = "ill_conditioned")]
    #[error(
        "different answers fit about as well (rms {best_rms_mm:.3e} and {other_rms_mm:.3e} mm): probe more points or give the direction"
    )]
    Ambiguous {
        /// rms of the best fit, millimetres.
        best_rms_mm: f64,
        /// rms of another one, millimetres.
        other_rms_mm: f64,
    },
    /// A direction that was given with the points has no length.
    #[strum(serialize = "degenerate")]
    #[error("the given direction has no length: give a unit vector")]
    NoDirection,
    /// The iteration found no minimum.
    #[error(
        "no least-squares minimum found in {iterations} steps: the points do not look like this shape; check the feature and its points"
    )]
    NoConvergence {
        /// Steps tried.
        iterations: u32,
    },
    /// Source and target lists of different length.
    #[error("{source} source points but {target} target points: give one target for each source")]
    LengthMismatch {
        /// Source points.
        r#source: usize,
        /// Target points.
        target: usize,
    },
}

impl FitError {
    /// The class of the error, for machines: never changes.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.into()
    }
}

fn cap_too_small(
    relative_uncertainty: &f64,
    limit: &f64,
    f: &mut fmt::Formatter<'_>,
) -> fmt::Result {
    f.write_str("the cap or arc is too small to say a radius: ")?;
    if relative_uncertainty.is_finite() {
        write!(
            f,
            "its standard uncertainty is {relative_uncertainty:.3} of it, limit {limit:.3}"
        )?;
    } else {
        f.write_str("a flat surface fits as well")?;
    }
    f.write_str("; probe a larger part")
}
