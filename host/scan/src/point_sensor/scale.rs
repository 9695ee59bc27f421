//! Whether the axes count as long as the balls lie apart.
//!
//! A sensor alone does not see a warm scale: ball and part are both seen through it. Several balls
//! whose centres come from elsewhere (a bar, a plate of known length) show it: with
//! Q' = Q + s (Q - Q̄) the residual changes by s n·(Q - Q̄), which is fitted beside t, a and the gain.

use nalgebra::{SMatrix, SVector, Vector3};
use umi_core::point::{BallReading, CalibrationBall, PointCalibration};

/// Unknowns: t, two angles of a, gain, scale.
const UNKNOWNS: usize = 7;

/// Less than this is no matter (0.1 K of steel).
const LEAST: f64 = 1.2e-6;

/// More standard uncertainties than this are no chance.
const SURE: f64 = 5.0;

/// How much longer the axes' lengths should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ScaleError {
    /// Part of a length.
    pub scale: f64,
    /// Its standard uncertainty.
    pub u: f64,
}

impl ScaleError {
    /// Whether it is surely one.
    pub fn is_sure(&self) -> bool {
        self.scale.abs() > LEAST && self.scale.abs() > SURE * self.u
    }
}

/// The scale that the readings of several balls show; none for one ball, or where their residuals
/// say nothing about noise.
pub(super) fn scale(
    readings: &[BallReading],
    balls: &[CalibrationBall],
    fit: &PointCalibration,
) -> Option<ScaleError> {
    let first = readings.first()?.ball;
    if readings.iter().all(|reading| reading.ball == first) || readings.len() <= UNKNOWNS {
        return None;
    }
    let n = readings.len() as f64;
    let middle = readings
        .iter()
        .fold(Vector3::zeros(), |sum, r| sum + r.axes.mm)
        / n;
    let a = fit.sensor.direction;
    let helper = if a.x.abs() < 0.6 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let e1 = a.cross(&helper).normalize();
    let e2 = a.cross(&e1);
    // The largest distance makes the column as large as the others.
    let size = readings
        .iter()
        .fold(0.0_f64, |most, r| most.max((r.axes.mm - middle).norm()));
    if size <= 0.0 {
        return None;
    }
    let row = |reading: &BallReading| -> Option<(SVector<f64, UNKNOWNS>, Vector3<f64>, f64)> {
        let ball = balls.get(reading.ball)?;
        let arm = fit.sensor.place(reading.axes, reading.gamma).mm - ball.center.mm;
        let normal = arm.try_normalize(0.0)?;
        let spread = (reading.gamma.0 - fit.mean_gamma.0) * fit.sensor.gain;
        let row = SVector::from([
            normal.x,
            normal.y,
            normal.z,
            spread * normal.dot(&e1),
            spread * normal.dot(&e2),
            // Where the gain is not free its column stays empty.
            if fit.cov_unit[6][6] > 0.0 {
                spread * normal.dot(&a)
            } else {
                0.0
            },
            normal.dot(&(reading.axes.mm - middle)) / size,
        ]);
        Some((row, normal, fit.residual(reading, ball).0))
    };
    let mut gram = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
    let mut right = SVector::<f64, UNKNOWNS>::zeros();
    for reading in readings {
        let (row, _, residual) = row(reading)?;
        gram += row * row.transpose();
        right -= row * residual;
    }
    if gram[(5, 5)] == 0.0 {
        gram[(5, 5)] = 1.0;
    }
    let inverse = gram.cholesky()?.inverse();
    let found = inverse * right;
    let (mut squares, mut pulls) = (0.0, vec![SVector::<f64, 4>::zeros(); balls.len()]);
    for reading in readings {
        let (row, normal, residual) = row(reading)?;
        let left = residual + row.dot(&found);
        squares += left * left;
        // How the scale moves with a ball's centre and radius.
        let weight = (inverse * row)[UNKNOWNS - 1];
        *pulls.get_mut(reading.ball)? +=
            SVector::from([normal.x, normal.y, normal.z, 1.0]) * weight;
    }
    let mut variance = squares / (n - UNKNOWNS as f64) * inverse[(UNKNOWNS - 1, UNKNOWNS - 1)];
    for (pull, ball) in pulls.iter().zip(balls) {
        let [u_center, u_radius] = [ball.u_center.0, ball.u_radius.0];
        variance += pull.fixed_rows::<3>(0).norm_squared() * u_center * u_center
            + pull[3] * pull[3] * u_radius * u_radius;
    }
    Some(ScaleError {
        scale: found[UNKNOWNS - 1] / size,
        u: variance.sqrt() / size,
    })
}
