//! Calibration refusals, each with a code and a sentence.

use strum::IntoStaticStr;
use thiserror::Error;

use crate::units::Mm;

/// What the readings of a calibration hardly determine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weakness {
    /// The unknown that the weakest combination is mostly made of.
    pub what: &'static str,
    /// Error of that combination over the error of all readings together, in
    /// units of the set's own spread: 1 is ideal, 10 000 is refused.
    pub factor: f64,
}

/// Why a set of readings gives no calibration.
///
/// [`PointRefusal::code`] is stable and meant for machines, its sentence says
/// what is wrong and what to measure instead.
#[derive(Clone, Copy, Debug, PartialEq, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum PointRefusal {
    /// Fewer readings than unknowns and one.
    #[error("{given} readings given, at least {needed} needed: measure more places of the ball")]
    TooFewPoints {
        /// Readings given.
        given: usize,
        /// Readings needed.
        needed: usize,
    },
    /// A reading is NaN, infinite or beyond any machine.
    #[error("reading {} is not a finite number below 1e9 mm: remove it or measure it again", .row.saturating_add(1))]
    NotFinite {
        /// Its row, the first is 0.
        row: usize,
    },
    /// The rough direction has no length.
    #[strum(serialize = "no_convergence")]
    #[error("the rough direction of the beam has no length: give it as X,Y,Z, for example 0,0,-1")]
    NoDirection,
    /// A ball without a proper radius or centre, or a radius to find from
    /// several balls.
    #[error("ball {}: {why}", .ball.saturating_add(1))]
    BadSphere {
        /// Index of the ball.
        ball: usize,
        /// What is wrong with it.
        why: &'static str,
    },
    /// A reading names a ball that is not there.
    #[error("reading {} names a ball that is not given: give its centre and radius", .row.saturating_add(1))]
    UnknownSphere {
        /// Its row, the first is 0.
        row: usize,
    },
    /// The readings repeat a few places.
    #[error(
        "the readings repeat {distinct} places of the axes, {needed} different ones are needed: measure more places of the ball"
    )]
    CoincidentPoints {
        /// Places that differ.
        distinct: usize,
        /// Places that are needed.
        needed: usize,
    },
    /// All readings strike a ball at one place.
    #[strum(serialize = "coincident_points")]
    #[error(
        "all readings strike the ball at one place: spread them over a cone of 90 degrees or more"
    )]
    OnePlace,
    /// All readings are alike, up to a thousandth of the radius.
    #[error("the readings vary by less than a thousandth of the ball's radius (standard deviation {:.2e} mm), which shows only where the point at that reading lies, not the beam's direction: measure at two stand-offs or more, over the depth of field", .spread.0)]
    RangeNotVaried {
        /// Standard deviation of the readings.
        spread: Mm,
    },
    /// The readings vary hardly more than they scatter.
    #[strum(serialize = "range_not_varied")]
    #[error("the readings vary by {:.2e} mm only (standard deviation) and lie {:.2e} mm off the balls, which hides the beam's direction: measure over the whole depth of field, with more captures at a place", .spread.0, .rms.0)]
    RangeInScatter {
        /// Standard deviation of the readings.
        spread: Mm,
        /// rms of their distances from the balls.
        rms: Mm,
    },
    /// The readings lie so far off the balls that they are no measurement of these.
    #[strum(serialize = "residual_too_large")]
    #[error("the readings lie {:.2e} mm off the balls at best, and vary by {:.2e} mm (standard deviation): check the ball's radius, the unit of the readings, and that axes and readings belong together", .rms.0, .spread.0)]
    Misfit {
        /// Standard deviation of the readings.
        spread: Mm,
        /// rms of their distances from the balls.
        rms: Mm,
    },
    /// All points lie on one great circle.
    #[error("all points lie on one great circle (within {:.2e} mm), which leaves offset and direction across it open: measure points on both sides of it", .off_plane.0)]
    GreatCircle {
        /// Their root mean square distance from its plane.
        off_plane: Mm,
    },
    /// All points lie on one circle, and the radius is asked for.
    #[error("all points lie on one circle (within {:.2e} mm), and balls of any radius pass through it: measure the top of the ball as well, or give the radius", .off_plane.0)]
    OneCircle {
        /// Their standard deviation along the circle's axis.
        off_plane: Mm,
    },
    /// Some other combination of the unknowns cannot be told.
    #[error("the readings do not determine the {} (an error grows {:.1e} times): spread them over a wider cone of the ball and over the depth of field", .0.what, .0.factor)]
    Degenerate(Weakness),
    /// The result would be too uncertain for its covariance to mean anything.
    #[strum(serialize = "degenerate")]
    #[error("the readings scatter too much for where they lie: standard uncertainty {:.3} mm of a point, {direction_rad:.3} rad of the direction; spread them over a wider cone of the ball and over the depth of field", .point.0)]
    Uncertain {
        /// Standard uncertainty of the point at the mean reading.
        point: Mm,
        /// Standard uncertainty of the direction, radians.
        direction_rad: f64,
    },
    /// Two beams on the side of the rough direction fit about equally well.
    #[error("two beams {apart_deg:.1} degrees and {:.3} mm apart fit alike (rms {:.3e} and {:.3e} mm), as far as readings can tell that are {dof} more than the unknowns, and both are on the side of the rough direction: measure more places, with the axes at several heights, and not on one circle of the ball alone, or give a better direction", .apart.0, .best_rms.0, .other_rms.0)]
    Ambiguous {
        /// Degrees of freedom.
        dof: usize,
        /// rms of the better one.
        best_rms: Mm,
        /// rms of the other one.
        other_rms: Mm,
        /// Angle between them, degrees.
        apart_deg: f64,
        /// Distance between their points at the mean reading.
        apart: Mm,
    },
    /// A beam that points away from the rough direction fits, and none else.
    #[strum(serialize = "no_convergence")]
    #[error("only a beam against the rough direction, or one that leaves the ball where it should strike it, fits (rms {:.3e} mm): check the direction, and that readings grow with the distance", .rms.0)]
    OtherWay {
        /// rms of that one.
        rms: Mm,
    },
    /// The search found no minimum.
    #[error(
        "no beam on the side of the rough direction fits the readings: check the direction, the balls and the unit of the readings"
    )]
    NoConvergence,
}

impl PointRefusal {
    /// The class of the error, for machines: never changes.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.into()
    }
}
