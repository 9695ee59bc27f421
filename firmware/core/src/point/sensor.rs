//! A reading's point.

use nalgebra::Vector3;

use crate::fit::solve::linalg::{Square, propagate};
use crate::units::{Mm, Point};

/// Where a sensor's zero stands and where its beam points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSensor {
    /// Offset t: from the position of the axes to the zero of the readings.
    pub offset: Point,
    /// Direction a of the beam, a unit vector.
    pub direction: Vector3<f64>,
    /// Gain g of the readings; 1 for a sensor that is trusted.
    pub gain: f64,
}

impl PointSensor {
    /// The point that a reading shows: P = Q + t + γ g a.
    #[must_use]
    pub fn place(&self, axes: Point, gamma: Mm) -> Point {
        Point {
            mm: axes.mm + self.offset.mm + self.direction * (gamma.0 * self.gain),
        }
    }

    /// The covariance of that point in mm², from the one of t, a and g:
    /// `[I γgI γa] C [I γgI γa]ᵀ`. The reading's own noise and the axes' are not in it.
    #[must_use]
    pub fn place_covariance(&self, gamma: Mm, covariance: &Square<7>) -> Square<3> {
        let g = gamma.0 * self.gain;
        let [x, y, z] = (self.direction * gamma.0).into();
        propagate(
            &[
                [1.0, 0.0, 0.0, g, 0.0, 0.0, x],
                [0.0, 1.0, 0.0, 0.0, g, 0.0, y],
                [0.0, 0.0, 1.0, 0.0, 0.0, g, z],
            ],
            covariance,
        )
    }
}
