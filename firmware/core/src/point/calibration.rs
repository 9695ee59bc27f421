//! The result of a calibration.

// Every index runs over arrays of length 7.
#![allow(clippy::indexing_slicing, clippy::needless_range_loop)]

use super::error::Weakness;
use super::reading::{BallReading, CalibrationBall};
use super::sensor::PointSensor;
use crate::fit::Statistics;
use crate::fit::solve::linalg::Square;
use crate::units::Mm;

/// A calibrated point sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCalibration {
    /// Offset t, direction a and gain g.
    pub sensor: PointSensor,
    /// What was added to the radius of the ball; 0 unless it was asked for.
    pub radius_error: Mm,
    /// Statistics of the residuals d = |P - C| - R. With
    /// `ResidualNoise::AlongBeam` `sigma` is of d / |n·a|, the noise of a reading,
    /// and `rms` of d all the same. `sigma` is None below an rms of 1e-11 mm.
    pub stats: Statistics,
    /// `inv(JᵀJ)` carried to t (mm), a and g, for unit noise: of t and a rank 5 (a has no
    /// part along itself), of g zero unless it was asked for.
    pub cov_unit: Square<7>,
    /// What the balls' standard uncertainties add, in the same order.
    pub cov_balls: Square<7>,
    /// Mean of the readings used, the stand-off of the calibration.
    pub mean_gamma: Mm,
    /// Variance of the radius error for unit noise; 0 unless it was asked for.
    pub radius_variance_unit: f64,
    /// The mirror image of the beam fits as well: all axis positions lie in
    /// (nearly) one plane, and only the rough direction tells the two apart.
    pub mirror: bool,
    /// What the readings hardly determine.
    pub weak: Option<Weakness>,
}

impl PointCalibration {
    /// Covariance of t (mm), a and g from the scatter of the residuals.
    #[must_use]
    pub fn covariance(&self) -> Option<Square<7>> {
        self.stats.covariance(&self.cov_unit)
    }

    /// [`Self::covariance`] and what the balls' uncertainties add.
    #[must_use]
    pub fn covariance_total(&self) -> Option<Square<7>> {
        let noise = self.covariance()?;
        Some(sum(&noise, &self.cov_balls))
    }

    /// Distance of a reading's point from its ball, positive outside: d.
    #[must_use]
    pub fn residual(&self, reading: &BallReading, ball: &CalibrationBall) -> Mm {
        let place = self.sensor.place(reading.axes, reading.gamma);
        let from_center = crate::fit::solve::linalg::norm(&(place.mm - ball.center.mm));
        Mm(from_center - ball.radius.0 - self.radius_error.0)
    }

    /// How well a point at a reading is known by this calibration, balls'
    /// uncertainties included. None where the residuals say nothing about noise.
    #[must_use]
    pub fn place_uncertainty(&self, gamma: Mm) -> Option<PlaceUncertainty> {
        let covariance = self
            .sensor
            .place_covariance(gamma, &self.covariance_total()?);
        Some(PlaceUncertainty {
            gamma,
            u: crate::fit::solve::linalg::diagonal(&covariance)
                .map(|variance| Mm(libm::sqrt(variance.max(0.0)))),
        })
    }
}

/// How well the point at a reading is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceUncertainty {
    /// The reading.
    pub gamma: Mm,
    /// Standard uncertainties of the point's x, y and z that the calibration brings.
    pub u: [Mm; 3],
}

/// The sum of two covariances.
fn sum(a: &Square<7>, b: &Square<7>) -> Square<7> {
    let mut sum = *a;
    for i in 0..7 {
        for j in 0..7 {
            sum[i][j] += b[i][j];
        }
    }
    sum
}
