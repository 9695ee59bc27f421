//! Point distance sensor: where its zero stands and where its beam points.
//!
//! A sensor that measures along one beam (a point laser, conoscopic
//! holography) is fixed to the machine. Its reading γ at the axes' position Q
//! is the point P = Q + t + γ g a, with the offset t, the unit direction a and
//! the gain g, which is 1 unless asked for (Zapico and others, "CNC centralized
//! control for digitizing freeform surfaces", eq. 1).
//!
//! t and a are found from readings of balls whose centres are known (eq. 2 and
//! 3 there): [`calibrate`] minimises the sum of squared distances of the points
//! from the balls. That paper leaves open what the solution needs:
//!
//! * |a| = 1 makes t and a five unknowns, not six.
//! * t and the centre enter as their difference. Without a centre from
//!   elsewhere t cannot be found, and the centre's error goes into t whole.
//! * Readings that are all alike show only t + γ a ([`PointRefusal::RangeNotVaried`]).
//! * Points on one great circle leave t and a across it open
//!   ([`PointRefusal::GreatCircle`]). The Jacobian is singular there to first
//!   order only, so noise and rounding hide it; it is told by the spread of the
//!   points at the optimum.
//! * Where all axis positions lie in a plane the mirror image of the beam fits
//!   as well. A rough direction decides, and [`PointCalibration::mirror`] says
//!   that it did.
//!
//! There are several local minima. Squared, the equations are linear: mostly they show
//! that every beam that fits is near one place (`search::squared`). Else a search starts from a
//! fixed fan of directions and keeps the least minimum whose direction is on the side
//! of the rough one.

mod calibration;
mod error;
mod identify;
mod model;
mod reading;
mod search;
mod sensor;
mod solve;
pub mod station;
#[cfg(test)]
mod tests;
mod uncertainty;

pub use calibration::{PlaceUncertainty, PointCalibration};
pub use error::{PointRefusal, Weakness};
pub use reading::{BallReading, CalibrationBall, PointQuestion, ResidualNoise};
pub use sensor::PointSensor;
pub use solve::calibrate;
