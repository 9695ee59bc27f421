//! What a calibration promises, beyond the reference cases of `tests/`.

mod bounded;
mod few;
mod motion;
mod refusals;
mod scatter;
mod search;

use std::vec::Vec;

use nalgebra::Vector3;

use super::{BallReading, CalibrationBall, PointSensor};
use crate::fit::tests::Random;
use crate::units::{Mm, Point};

/// The ball of the paper's calibration: 20 mm, somewhere on a table.
fn ball() -> CalibrationBall {
    CalibrationBall {
        center: Point::from_mm(209.85, -98.61, -614.52),
        radius: Mm(10.0),
        u_center: Mm(0.0),
        u_radius: Mm(0.0),
    }
}

/// A sensor whose beam stands about a degree off the vertical.
fn sensor() -> PointSensor {
    PointSensor {
        offset: Point::from_mm(3.2, -54.3, -138.1),
        direction: Vector3::new(0.0124, -0.0093, -1.0).normalize(),
        gain: 1.0,
    }
}

/// The reading that puts a sensor's point at a place of a ball: the axes
/// stand where they must for it, and read `gamma`.
fn reading_at(
    sensor: &PointSensor,
    ball: &CalibrationBall,
    normal: &Vector3<f64>,
    gamma: f64,
) -> BallReading {
    let place = ball.center.mm + normal * ball.radius.0;
    BallReading {
        axes: Point {
            mm: place - sensor.offset.mm - sensor.direction * (gamma * sensor.gain),
        },
        gamma: Mm(gamma),
        ball: 0,
    }
}

/// Normals of a ball over a cone about `up`, even in area (a spiral).
fn cap(up: &Vector3<f64>, half_angle: f64, number: usize) -> Vec<Vector3<f64>> {
    let (e1, e2) = crate::fit::solve::linalg::perpendicular_frame(up);
    (0..number)
        .map(|k| {
            let part = (k as f64 + 0.5) / number as f64;
            let cos = 1.0 - part * (1.0 - libm::cos(half_angle));
            let sin = libm::sqrt(1.0 - cos * cos);
            let turn = 2.399_963 * k as f64;
            up * cos + (e1 * libm::cos(turn) + e2 * libm::sin(turn)) * sin
        })
        .collect()
}

/// Readings over a cap at stand-offs spread over `depth` about 44 mm.
fn set(
    sensor: &PointSensor,
    ball: &CalibrationBall,
    number: usize,
    depth: f64,
) -> Vec<BallReading> {
    cap(&-sensor.direction, 1.0, number)
        .iter()
        .enumerate()
        .map(|(k, normal)| {
            let place = (k * 7 % 5) as f64 / 4.0 - 0.5;
            reading_at(sensor, ball, normal, 44.0 + depth * place)
        })
        .collect()
}

/// Readings moved off the ball along its normal, each by its own noise.
fn noisy(
    readings: &[BallReading],
    sensor: &PointSensor,
    ball: &CalibrationBall,
    sigma: f64,
    random: &mut Random,
) -> Vec<BallReading> {
    let mut readings = readings.to_vec();
    for reading in &mut readings {
        let place = sensor.place(reading.axes, reading.gamma);
        let normal = (place.mm - ball.center.mm).normalize();
        reading.axes.mm += normal * (sigma * random.normal());
    }
    readings
}
