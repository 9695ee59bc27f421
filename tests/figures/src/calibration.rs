//! A calibration of a point sensor as a board would do it.

use heapless::Vec;
use umi_core::point::{
    BallReading, CalibrationBall, PointCalibration, PointQuestion, PointRefusal, calibrate,
};
use umi_core::units::{Mm, Point};

use crate::{Case, MAX_POINTS};

/// What a calibration is made of.
pub struct Readings {
    ball: CalibrationBall,
    readings: Vec<BallReading, MAX_POINTS>,
    question: PointQuestion,
}

impl Readings {
    /// Those of a case of the kind `point_sensor`.
    #[must_use]
    pub fn of(case: &Case) -> Option<Self> {
        let (&[x, y, z, radius, u_center, u_radius], rows) = case.rows.split_first()?;
        let readings = rows.iter().map(|&[x, y, z, gamma, ..]| BallReading {
            axes: Point::from_mm(x, y, z),
            gamma: Mm(gamma),
            ball: 0,
        });
        let [free_radius, free_gain, _] = case.hint.map(|of| of > 0.0);
        Some(Self {
            ball: CalibrationBall {
                center: Point::from_mm(x, y, z),
                radius: Mm(radius),
                u_center: Mm(u_center),
                u_radius: Mm(u_radius),
            },
            readings: readings.collect(),
            question: PointQuestion {
                free_radius,
                free_gain,
                ..PointQuestion::default()
            },
        })
    }

    /// The calibration.
    ///
    /// # Errors
    /// As [`calibrate`].
    pub fn calibrate(&self) -> Result<PointCalibration, PointRefusal> {
        calibrate(&self.readings, &[self.ball], &self.question)
    }

    /// The first reading.
    #[must_use]
    pub fn first(&self) -> Option<BallReading> {
        self.readings.first().copied()
    }
}
