//! Rigid registrations: rotation (by rows) and translation.

use std::hint::black_box;

use nalgebra::{Matrix3, Matrix6, Vector3};
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
                with(task, "nalgebra SVD", &peers, by_nalgebra),
                with(task, "... and refusals", &peers, and_refusals),
                with(task, "... and residuals", &peers, and_residuals),
                with(task, "... and covariance", &peers, and_covariance),
            ]
        })
        .collect()
}

/// Source and target of each pair.
type Pairs = [(Vector3<f64>, Vector3<f64>)];

fn with(
    task: &'static str,
    by: &'static str,
    pairs: &Pairs,
    work: fn(&Pairs, &mut Vec<f64>),
) -> Contender {
    let pairs = pairs.to_vec();
    Contender {
        task,
        by,
        bytes: None,
        work: Box::new(move |answer| work(&pairs, answer)),
    }
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
fn by_nalgebra(pairs: &Pairs, answer: &mut Vec<f64>) {
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

/// The same behind the questions that a set of points must answer: are they numbers, are there
/// three different ones, is neither side a line?
fn and_refusals(pairs: &Pairs, answer: &mut Vec<f64>) {
    answer.clear();
    let sides = [
        pairs.iter().map(|pair| pair.0).collect::<Vec<_>>(),
        pairs.iter().map(|pair| pair.1).collect::<Vec<_>>(),
    ];
    for side in &sides {
        let is_finite = side.iter().flatten().all(|x| x.is_finite());
        let mut distinct: Vec<Vector3<f64>> = Vec::new();
        for point in side {
            if distinct.len() < 3 && !distinct.contains(point) {
                distinct.push(*point);
            }
        }
        let mean = side.iter().sum::<Vector3<f64>>() / side.len() as f64;
        let scatter: Matrix3<f64> = side
            .iter()
            .map(|p| (p - mean) * (p - mean).transpose())
            .sum();
        let spread = scatter.svd(false, false).singular_values;
        // The values are squares of lengths: a line has a second one of nothing.
        if !is_finite || distinct.len() < 3 || spread[1] <= 1e-8 * spread[0] {
            return;
        }
    }
    by_nalgebra(pairs, answer);
}

/// The same, and how far the pairs lie apart: rms and the largest.
fn and_residuals(pairs: &Pairs, answer: &mut Vec<f64>) {
    and_refusals(pairs, answer);
    let [rotation @ .., x, y, z] = answer.as_slice() else {
        return;
    };
    let rotation = Matrix3::from_row_slice(rotation);
    let translation = Vector3::new(*x, *y, *z);
    let (mut sum, mut largest) = (0.0, 0.0_f64);
    for (p, q) in pairs {
        let squared = (rotation * p + translation - q).norm_squared();
        sum += squared;
        largest = largest.max(squared);
    }
    black_box(((sum / pairs.len() as f64).sqrt(), largest.sqrt()));
}

/// The same, and the covariance of its six parameters, by the normal equations: with less
/// accuracy than an orthogonal decomposition has.
fn and_covariance(pairs: &Pairs, answer: &mut Vec<f64>) {
    and_residuals(pairs, answer);
    let [rotation @ .., _, _, _] = answer.as_slice() else {
        return;
    };
    let rotation = Matrix3::from_row_slice(rotation);
    let mut normal = Matrix6::zeros();
    for (p, _) in pairs {
        let turned = -(rotation * p).cross_matrix();
        let mut block = normal.fixed_view_mut::<3, 3>(0, 0);
        block += turned.transpose() * turned;
        let mut block = normal.fixed_view_mut::<3, 3>(0, 3);
        block += turned.transpose();
        let mut block = normal.fixed_view_mut::<3, 3>(3, 0);
        block += turned;
        let mut block = normal.fixed_view_mut::<3, 3>(3, 3);
        block += Matrix3::identity();
    }
    black_box(normal.cholesky().map(|factor| factor.inverse()));
}
