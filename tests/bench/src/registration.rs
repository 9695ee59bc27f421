//! Rigid registrations: rotation (by rows) and translation.

use nalgebra::{Matrix3, Vector3};
use umi_core::registration::register;
use umi_core::units::Point;

use crate::Contender;
use crate::data::Data;

/// Everyone who registers point pairs.
pub fn contenders(data: &Data) -> Vec<Contender> {
    let tasks = [
        ("registration of 3 pairs", &data.pairs_3),
        ("registration of 50 pairs", &data.pairs_50),
    ];
    tasks
        .into_iter()
        .flat_map(|(task, pairs)| {
            let ours: (Vec<Point>, Vec<Point>) = pairs
                .iter()
                .map(|[a, b, c, x, y, z]| (Point::from_mm(*a, *b, *c), Point::from_mm(*x, *y, *z)))
                .unzip();
            let peers: Vec<(Vector3<f64>, Vector3<f64>)> = pairs
                .iter()
                .map(|[a, b, c, x, y, z]| (Vector3::new(*a, *b, *c), Vector3::new(*x, *y, *z)))
                .collect();
            [
                Contender {
                    task,
                    by: "umi-core",
                    bytes: None,
                    work: Box::new(move |answer| by_umi(&ours.0, &ours.1, answer)),
                },
                Contender {
                    task,
                    by: "nalgebra SVD",
                    bytes: None,
                    work: Box::new(move |answer| by_nalgebra(&peers, answer)),
                },
            ]
        })
        .collect()
}

fn by_umi(source: &[Point], target: &[Point], answer: &mut Vec<f64>) {
    answer.clear();
    let Ok(registration) = register(source, target) else {
        return;
    };
    let transform = registration.transform;
    answer.extend(transform.rotation.transpose().iter());
    answer.extend(transform.translation_mm.iter());
}

/// The textbook's closed form (Umeyama 1991) on the singular value decomposition of
/// nalgebra: rotation and translation only, no covariance and no refusals.
fn by_nalgebra(pairs: &[(Vector3<f64>, Vector3<f64>)], answer: &mut Vec<f64>) {
    answer.clear();
    let n = pairs.len() as f64;
    let (source, target) = pairs
        .iter()
        .fold((Vector3::zeros(), Vector3::zeros()), |(p, q), pair| {
            (p + pair.0 / n, q + pair.1 / n)
        });
    let covariance: Matrix3<f64> = pairs
        .iter()
        .map(|(p, q)| (q - target) * (p - source).transpose())
        .sum();
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return;
    };
    let sign = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let translation = target - rotation * source;
    answer.extend(rotation.transpose().iter());
    answer.extend(translation.iter());
}
