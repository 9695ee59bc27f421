//! Calibrations of a point sensor on a ball: offset, direction, and standard uncertainties of both.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{Dyn, OMatrix, OVector, U5, Vector3, Vector5};
use umi_core::point::{BallReading, CalibrationBall, PointQuestion, calibrate};
use umi_core::units::{Mm, Point};

use crate::Contender;
use crate::data::Data;

const TASK: &str = "calibration of a point sensor by 100 readings";

/// Everyone who calibrates point sensors.
pub fn contenders(data: &Data) -> Vec<Contender> {
    let [x, y, z, radius] = data.ball;
    let ball = CalibrationBall {
        center: Point::from_mm(x, y, z),
        radius: Mm(radius),
        u_center: Mm(0.0),
        u_radius: Mm(0.0),
    };
    let ours: Vec<BallReading> = data
        .readings
        .iter()
        .map(|[x, y, z, gamma]| BallReading {
            axes: Point::from_mm(*x, *y, *z),
            gamma: Mm(*gamma),
            ball: 0,
        })
        .collect();
    let (center, readings) = (Vector3::new(x, y, z), data.readings.clone());
    let theirs: Vec<(Vector3<f64>, f64)> = readings
        .iter()
        .map(|[x, y, z, gamma]| (Vector3::new(*x, *y, *z) - center, *gamma))
        .collect();
    vec![
        Contender {
            task: TASK,
            by: "umi-core",
            bytes: None,
            work: Box::new(move |answer| by_umi(&ours, ball, answer)),
        },
        Contender {
            task: TASK,
            by: "levenberg-marquardt",
            bytes: None,
            work: Box::new(move |answer| by_levenberg_marquardt(&theirs, radius, answer)),
        },
    ]
}

fn by_umi(readings: &[BallReading], ball: CalibrationBall, answer: &mut Vec<f64>) {
    answer.clear();
    let Ok(found) = calibrate(readings, &[ball], &PointQuestion::default()) else {
        return;
    };
    let Some(covariance) = found.covariance() else {
        return;
    };
    answer.extend(found.sensor.offset.to_array_mm());
    answer.extend(found.sensor.direction.iter());
    answer.extend((0..6).map(|k| covariance[k][k].sqrt()));
}

/// The crate `levenberg-marquardt` from one start, the beam straight down: no other minimum is
/// looked for, nothing is refused.
fn by_levenberg_marquardt(readings: &[(Vector3<f64>, f64)], radius: f64, answer: &mut Vec<f64>) {
    answer.clear();
    let n = readings.len();
    let middle = readings
        .iter()
        .fold(Vector3::zeros(), |sum: Vector3<f64>, (q, gamma)| {
            sum + (q - Vector3::z() * *gamma) / n as f64
        });
    let start = -middle + Vector3::z() * (0.75 * radius);
    let problem = Problem {
        readings,
        radius,
        at: Vector5::new(start.x, start.y, start.z, 0.0, 0.0),
    };
    let (end, report) = LevenbergMarquardt::new().minimize(problem);
    let (Some(residuals), Some(jacobian)) = (end.residuals(), end.jacobian()) else {
        return;
    };
    let Some(unit) = (jacobian.transpose() * &jacobian).try_inverse() else {
        return;
    };
    if !report.termination.was_successful() {
        return;
    }
    let (a, turns) = beam(&end.at);
    let variance = residuals.norm_squared() / (n - 5) as f64;
    answer.extend(end.at.fixed_rows::<3>(0).iter());
    answer.extend(a.iter());
    answer.extend((0..3).map(|k| (variance * unit[(k, k)]).sqrt()));
    let turned = unit.fixed_view::<2, 2>(3, 3);
    answer.extend((0..3).map(|k| {
        let row = nalgebra::Vector2::new(turns[0][k], turns[1][k]);
        (variance * (row.transpose() * turned * row)[(0, 0)]).sqrt()
    }));
}

/// The unit direction (u, v, -1), and how it turns with u and v.
fn beam(at: &Vector5<f64>) -> (Vector3<f64>, [Vector3<f64>; 2]) {
    let (u, v) = (at[3], at[4]);
    let length = (u * u + v * v + 1.0).sqrt();
    let a = Vector3::new(u, v, -1.0) / length;
    let turn = |along: Vector3<f64>| (along - a * a.dot(&along)) / length;
    (a, [turn(Vector3::x()), turn(Vector3::y())])
}

/// Distances from a ball at the origin: t in the first three, u and v behind.
struct Problem<'a> {
    readings: &'a [(Vector3<f64>, f64)],
    radius: f64,
    at: Vector5<f64>,
}

impl LeastSquaresProblem<f64, Dyn, U5> for Problem<'_> {
    type ParameterStorage = Owned<f64, U5>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U5>;

    fn set_params(&mut self, at: &Vector5<f64>) {
        self.at = *at;
    }

    fn params(&self) -> Vector5<f64> {
        self.at
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let ((a, _), t) = (beam(&self.at), self.at.fixed_rows::<3>(0));
        let distances = self
            .readings
            .iter()
            .map(|(q, gamma)| (q + t + a * *gamma).norm() - self.radius);
        Some(OVector::<f64, Dyn>::from_iterator(
            self.readings.len(),
            distances,
        ))
    }

    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, U5>> {
        let ((a, [du, dv]), t) = (beam(&self.at), self.at.fixed_rows::<3>(0));
        let mut jacobian = OMatrix::<f64, Dyn, U5>::zeros(self.readings.len());
        for (mut row, (q, gamma)) in jacobian.row_iter_mut().zip(self.readings) {
            let n = (q + t + a * *gamma).normalize();
            row.copy_from_slice(&[n.x, n.y, n.z, gamma * n.dot(&du), gamma * n.dot(&dv)]);
        }
        Some(jacobian)
    }
}
