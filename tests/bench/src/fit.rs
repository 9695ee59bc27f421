//! Sphere fits: centre, radius, and the standard uncertainties of the centre.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{Dyn, Matrix3, OMatrix, OVector, U4, Vector3, Vector4};
use umi_core::fit::sphere;
use umi_core::units::Point;

use crate::Contender;
use crate::data::Data;

/// Everyone who fits spheres.
pub fn contenders(data: &Data) -> Vec<Contender> {
    let tasks = [
        ("sphere of 5 points", &data.sphere_5),
        ("sphere of 500 points", &data.sphere_500),
    ];
    tasks
        .into_iter()
        .flat_map(|(task, points)| {
            let ours: Vec<Point> = points.iter().copied().map(Point::from_array_mm).collect();
            let peers: Vec<Vector3<f64>> = points.iter().copied().map(Vector3::from).collect();
            [
                Contender {
                    task,
                    by: "umi-core",
                    bytes: None,
                    work: Box::new(move |answer| by_umi(&ours, answer)),
                },
                Contender {
                    task,
                    by: "levenberg-marquardt",
                    bytes: None,
                    work: Box::new(move |answer| by_levenberg_marquardt(&peers, answer)),
                },
            ]
        })
        .collect()
}

fn by_umi(points: &[Point], answer: &mut Vec<f64>) {
    answer.clear();
    let Ok(fit) = sphere::fit(points) else { return };
    answer.extend(fit.center.to_array_mm());
    answer.push(fit.radius.0);
    answer.extend(fit.center_uncertainty().into_iter().flatten().map(|u| u.0));
}

/// The crate `levenberg-marquardt`, a translation of MINPACK, from the same linear start;
/// the covariance is `sigma² inv(JᵀJ)`. Points are taken from their centroid, as anyone
/// would who has met one bad fit.
fn by_levenberg_marquardt(points: &[Vector3<f64>], answer: &mut Vec<f64>) {
    answer.clear();
    let n = points.len();
    let centroid = points.iter().sum::<Vector3<f64>>() / n as f64;
    let points: Vec<Vector3<f64>> = points.iter().map(|p| p - centroid).collect();
    let Some(start) = linear(&points) else { return };
    let problem = Problem {
        points: &points,
        at: start,
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
    let variance = residuals.norm_squared() / (n - 4) as f64;
    let center = end.at.xyz() + centroid;
    answer.extend(center.iter());
    answer.push(end.at.w);
    answer.extend((0..3).map(|axis| (variance * unit[(axis, axis)]).sqrt()));
}

/// `|q|² = 2 c·q + h`, by the normal equations: the points are centred, so `h` stands alone.
fn linear(points: &[Vector3<f64>]) -> Option<Vector4<f64>> {
    let n = points.len() as f64;
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    let mut squares = 0.0;
    for q in points {
        normal += 2.0 * q * q.transpose();
        right += q * q.norm_squared();
        squares += q.norm_squared();
    }
    let center = normal.cholesky()?.solve(&right);
    let radius = (squares / n + center.norm_squared()).sqrt();
    Some(center.push(radius))
}

/// Orthogonal distances from a sphere of centre x, y, z and radius w.
struct Problem<'a> {
    points: &'a [Vector3<f64>],
    at: Vector4<f64>,
}

impl LeastSquaresProblem<f64, Dyn, U4> for Problem<'_> {
    type ParameterStorage = Owned<f64, U4>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U4>;

    fn set_params(&mut self, at: &Vector4<f64>) {
        self.at = *at;
    }

    fn params(&self) -> Vector4<f64> {
        self.at
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let distances = self
            .points
            .iter()
            .map(|p| (p - self.at.xyz()).norm() - self.at.w);
        Some(OVector::<f64, Dyn>::from_iterator(
            self.points.len(),
            distances,
        ))
    }

    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, U4>> {
        let mut jacobian = OMatrix::<f64, Dyn, U4>::zeros(self.points.len());
        for (mut row, p) in jacobian.row_iter_mut().zip(self.points) {
            let u = (p - self.at.xyz()).normalize();
            row.copy_from_slice(&[-u.x, -u.y, -u.z, -1.0]);
        }
        Some(jacobian)
    }
}
