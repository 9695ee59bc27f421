//! Why points could not be fitted.

use core::fmt;

/// Which list of points an error speaks of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointSet {
    /// The points of a fit (there is only one list).
    Points,
    /// The source (nominal, CAD) side of a registration.
    Source,
    /// The target (measured, MCS) side of a registration.
    Target,
}

impl PointSet {
    fn plural(self) -> &'static str {
        match self {
            Self::Points => "the points",
            Self::Source => "the source points",
            Self::Target => "the target points",
        }
    }

    fn singular(self) -> &'static str {
        match self {
            Self::Points => "point",
            Self::Source => "source point",
            Self::Target => "target point",
        }
    }
}

/// How a set of points lacks a dimension that the geometry needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degeneracy {
    /// All points are one point, up to the rounding of their coordinates.
    Coincident,
    /// Repeated points leave only `distinct` different ones.
    Duplicates {
        /// Different points in the list.
        distinct: usize,
        /// Different points that the geometry needs.
        needed: usize,
    },
    /// All points on one straight line.
    Collinear,
    /// All points in one plane.
    Coplanar,
}

/// The quantity whose condition was too poor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The centre of a sphere or circle.
    Center,
    /// The radius of a sphere, circle or cylinder.
    Radius,
    /// The direction of a normal or of an axis.
    Direction,
    /// The position of an axis.
    Position,
    /// The half angle of a cone.
    HalfAngle,
    /// The apex of a cone.
    Apex,
    /// The rotation of a registration.
    Rotation,
}

impl Quantity {
    fn name(self) -> &'static str {
        match self {
            Self::Center => "centre",
            Self::Radius => "radius",
            Self::Direction => "direction",
            Self::Position => "position of the axis",
            Self::HalfAngle => "half angle",
            Self::Apex => "apex",
            Self::Rotation => "rotation",
        }
    }
}

/// Why a fit or a registration was refused.
///
/// [`FitError::code`] is stable and meant for machines, [`fmt::Display`] says
/// what is wrong and what to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FitError {
    /// Fewer points than the geometry has to have.
    TooFewPoints {
        /// Points in the list.
        given: usize,
        /// Points that the geometry needs.
        needed: usize,
    },
    /// A coordinate is NaN or infinite.
    NotFinite {
        /// The list it is in.
        set: PointSet,
        /// Its row, the first is 0.
        row: usize,
    },
    /// A coordinate is finite but beyond [`crate::fit::MAX_COORDINATE`], where
    /// squares could overflow: no position on a machine.
    OutOfRange {
        /// The list it is in.
        set: PointSet,
        /// Its row, the first is 0.
        row: usize,
    },
    /// The points lack a dimension.
    Degenerate {
        /// The list that does.
        set: PointSet,
        /// In which way.
        why: Degeneracy,
    },
    /// The points are not degenerate, but by where they lie they hardly
    /// determine a quantity.
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
    CapTooSmall {
        /// Standard uncertainty of the radius over the radius (infinite if the
        /// best surface is a plane).
        relative_uncertainty: f64,
        /// The limit, [`crate::fit::MAX_RELATIVE_UNCERTAINTY`].
        limit: f64,
    },
    /// Different answers fit the points about equally well.
    Ambiguous {
        /// rms of the best fit, millimetres.
        best_rms_mm: f64,
        /// rms of another one, millimetres.
        other_rms_mm: f64,
    },
    /// A direction that was given with the points has no length.
    NoDirection,
    /// The iteration found no minimum.
    NoConvergence {
        /// Steps tried.
        iterations: u32,
    },
    /// Source and target lists of different length.
    LengthMismatch {
        /// Source points.
        source: usize,
        /// Target points.
        target: usize,
    },
}

impl FitError {
    /// The class of the error, for machines: never changes.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::TooFewPoints { .. } => "too_few_points",
            Self::NotFinite { .. } | Self::OutOfRange { .. } => "not_finite",
            Self::Degenerate { .. } | Self::NoDirection => "degenerate",
            Self::IllConditioned { .. } | Self::Uncertain { .. } | Self::Ambiguous { .. } => {
                "ill_conditioned"
            }
            Self::CapTooSmall { .. } => "cap_too_small",
            Self::NoConvergence { .. } => "no_convergence",
            Self::LengthMismatch { .. } => "length_mismatch",
        }
    }
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooFewPoints { given, needed } => {
                write!(
                    f,
                    "{given} points given, at least {needed} needed: probe more points"
                )
            }
            Self::NotFinite { set, row } => write!(
                f,
                "{} {} has a coordinate that is not a number: remove or measure it again",
                set.singular(),
                row.saturating_add(1)
            ),
            Self::OutOfRange { set, row } => write!(
                f,
                "{} {} has a coordinate beyond {:e} mm: check the unit and the digits",
                set.singular(),
                row.saturating_add(1),
                super::MAX_COORDINATE.0
            ),
            Self::Degenerate { set, why } => {
                let points = set.plural();
                match why {
                    Degeneracy::Coincident => {
                        write!(f, "{points} all coincide: probe points that lie apart")
                    }
                    Degeneracy::Duplicates { distinct, needed } => write!(
                        f,
                        "{points} repeat each other, only {distinct} of {needed} needed are distinct: probe more places"
                    ),
                    Degeneracy::Collinear => {
                        write!(
                            f,
                            "{points} lie on one straight line: add a point well off it"
                        )
                    }
                    Degeneracy::Coplanar => {
                        write!(f, "{points} lie in one plane: add a point well off it")
                    }
                }
            }
            Self::IllConditioned {
                quantity,
                condition,
                limit,
            } => write!(
                f,
                "the points hardly determine the {}: condition {condition:.1e}, limit {limit:.1e}; spread them wider",
                quantity.name()
            ),
            Self::Uncertain {
                quantity,
                relative_uncertainty,
                limit,
            } => write!(
                f,
                "the points scatter too much to say the {}: relative standard uncertainty {relative_uncertainty:.3}, limit {limit:.3}; spread them wider or check the feature",
                quantity.name()
            ),
            Self::CapTooSmall {
                relative_uncertainty,
                limit,
            } => {
                if relative_uncertainty.is_finite() {
                    write!(
                        f,
                        "the cap or arc is too small to say a radius: its standard uncertainty is {:.3} of it, limit {:.3}; probe a larger part",
                        relative_uncertainty, limit
                    )
                } else {
                    write!(
                        f,
                        "the cap or arc is too small to say a radius: a flat surface fits as well; probe a larger part"
                    )
                }
            }
            Self::Ambiguous {
                best_rms_mm,
                other_rms_mm,
            } => write!(
                f,
                "different answers fit about as well (rms {best_rms_mm:.3e} and {other_rms_mm:.3e} mm): probe more points or give the direction"
            ),
            Self::NoDirection => write!(f, "the given direction has no length: give a unit vector"),
            Self::NoConvergence { iterations } => write!(
                f,
                "no least-squares minimum found in {iterations} steps: the points do not look like this shape; check the feature and its points"
            ),
            Self::LengthMismatch { source, target } => write!(
                f,
                "{source} source points but {target} target points: give one target for each source"
            ),
        }
    }
}

impl core::error::Error for FitError {}
