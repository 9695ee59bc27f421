//! Predicted uncertainties against the scatter of repeated noisy fits.

use std::vec::Vec;

use super::{Random, five_hits, noisy, revolved};
use crate::fit::{circle, cone, cylinder, sphere};
use crate::units::Point;

/// Repetitions: the standard deviation of a variance estimated from 2000 is
/// 3.2 %, so 10 % is three of them.
const RUNS: usize = 2000;

/// Mean and covariance of samples.
fn moments<const K: usize>(samples: &[[f64; K]]) -> ([f64; K], [[f64; K]; K]) {
    let n = samples.len() as f64;
    let mean: [f64; K] = core::array::from_fn(|i| samples.iter().map(|s| s[i]).sum::<f64>() / n);
    let cov = core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            samples
                .iter()
                .map(|s| (s[i] - mean[i]) * (s[j] - mean[j]))
                .sum::<f64>()
                / (n - 1.0)
        })
    });
    (mean, cov)
}

/// Asserts that variances agree within 10 % and correlations within 0.1.
fn assert_scatter<const K: usize>(label: &str, samples: &[[f64; K]], predicted: &[[f64; K]; K]) {
    let (_, cov) = moments(samples);
    for i in 0..K {
        let ratio = cov[i][i] / predicted[i][i];
        assert!(
            (ratio - 1.0).abs() < 0.1,
            "{label} {i}: scatter/predicted {ratio}"
        );
        for j in 0..i {
            let size = libm::sqrt(predicted[i][i] * predicted[j][j]);
            let difference = (cov[i][j] - predicted[i][j]) / size;
            assert!(difference.abs() < 0.1, "{label} {i} {j}: {difference}");
        }
    }
}

fn cap(half_angle: f64, n: u32) -> Vec<Point> {
    // A spiral that covers the cap evenly.
    (0..n)
        .map(|k| {
            let polar = half_angle * libm::sqrt((f64::from(k) + 0.5) / f64::from(n));
            let around = 2.399_963 * f64::from(k);
            let (s, c) = (libm::sin(polar), libm::cos(polar));
            Point::from_mm(
                12.7 * s * libm::cos(around),
                12.7 * s * libm::sin(around),
                12.7 * c,
            )
        })
        .collect()
}

/// The covariance of a sphere is that of repeated fits, and `sigma` is the
/// noise: for the five-point pattern, a 120 degree cap and a 20 degree cap.
#[test]
fn a_spheres_covariance_is_its_scatter() {
    const NOISE: f64 = 1e-3;
    let mut random = Random(11);
    let patterns = [
        (
            "five",
            five_hits(Point::from_mm(-136.0, 136.0, 136.0), 12.7),
        ),
        ("cap 120", cap(60.0_f64.to_radians(), 25)),
        ("cap 20", cap(10.0_f64.to_radians(), 50)),
    ];
    for (label, points) in patterns {
        let predicted = sphere::fit(&points)
            .unwrap()
            .cov_unit
            .map(|row| row.map(|c| c * NOISE * NOISE));
        let (mut samples, mut variance) = (Vec::new(), 0.0);
        for _ in 0..RUNS {
            let fit = sphere::fit(&noisy(&points, NOISE, &mut random)).unwrap();
            let c = fit.center.mm;
            samples.push([c.x, c.y, c.z, fit.radius.0]);
            variance += fit.stats.variance_mm2().unwrap_or(0.0) / RUNS as f64;
        }
        assert_scatter(label, &samples, &predicted);
        let ratio = variance / (NOISE * NOISE);
        assert!((ratio - 1.0).abs() < 0.1, "{label}: sigma²/noise² {ratio}");
    }
}

/// The figures in the documentation of [`sphere::fit`]: standard uncertainties
/// per micrometre of noise, and the 99 % bound of the centre.
#[test]
fn the_promised_accuracy_of_a_sphere_holds() {
    let table = [
        (
            five_hits(Point::from_mm(0.0, 0.0, 0.0), 12.7),
            [0.71, 1.12, 0.50],
            3.5,
        ),
        (cap(60.0_f64.to_radians(), 25), [0.45, 1.39, 1.05], 4.0),
        (cap(10.0_f64.to_radians(), 50), [1.65, 32.3, 32.1], 90.0),
    ];
    let mut random = Random(12);
    for (points, [across, along, radius], bound) in table {
        let exact = sphere::fit(&points).unwrap();
        let unit = exact.cov_unit;
        for (variance, promised) in [
            (unit[0][0], across),
            (unit[2][2], along),
            (unit[3][3], radius),
        ] {
            let u = libm::sqrt(variance);
            assert!((u / promised - 1.0).abs() < 0.02, "{u} {promised}");
        }
        let outside = (0..RUNS)
            .filter(|_| {
                let fit = sphere::fit(&noisy(&points, 1e-3, &mut random)).unwrap();
                (fit.center.mm - exact.center.mm).norm() > bound * 1e-3
            })
            .count();
        assert!(
            outside <= RUNS / 100,
            "{outside} of {RUNS} beyond {bound} um"
        );
    }
}

#[test]
fn covariances_of_circle_cylinder_and_cone_are_their_scatter() {
    const NOISE: f64 = 1e-3;
    let square = |matrix: [[f64; 3]; 3]| matrix.map(|row| row.map(|c| c * NOISE * NOISE));
    let mut random = Random(13);

    let points = revolved(|_| 40.0, &[0.0], 1.5, 12, 0.0);
    let exact = circle::fit(&points).unwrap();
    let [x, y, _, r] = exact.cov_unit;
    let samples: Vec<[f64; 3]> = (0..RUNS)
        .map(|_| {
            let fit = circle::fit(&noisy(&points, NOISE, &mut random)).unwrap();
            [fit.center.mm.x, fit.center.mm.y, fit.radius.0]
        })
        .collect();
    let predicted = square([[x[0], x[1], x[3]], [y[0], y[1], y[3]], [r[0], r[1], r[3]]]);
    assert_scatter("circle", &samples, &predicted);

    let points = revolved(|_| 15.0, &[-25.0, 0.0, 25.0], 4.0, 6, 0.3);
    let exact = cylinder::fit(&points).unwrap();
    let samples: Vec<([f64; 2], [f64; 2], [f64; 1])> = (0..RUNS)
        .map(|_| {
            let fit =
                cylinder::fit_near(&noisy(&points, NOISE, &mut random), &exact.direction).unwrap();
            let (p, d) = (fit.point.mm, fit.direction);
            ([p.x, p.y], [d.x, d.y], [fit.radius.0])
        })
        .collect();
    let block = |m: &[[f64; 3]; 3]| {
        let m = square(*m);
        [[m[0][0], m[0][1]], [m[1][0], m[1][1]]]
    };
    let point: Vec<_> = samples.iter().map(|s| s.0).collect();
    assert_scatter("cylinder point", &point, &block(&exact.cov_unit_point));
    let direction: Vec<_> = samples.iter().map(|s| s.1).collect();
    assert_scatter(
        "cylinder direction",
        &direction,
        &block(&exact.cov_unit_direction),
    );
    let radius: Vec<_> = samples.iter().map(|s| s.2).collect();
    assert_scatter(
        "cylinder radius",
        &radius,
        &[[exact.var_unit_radius * NOISE * NOISE]],
    );

    let points = revolved(|z| 20.0 + 0.4 * z, &[-25.0, 0.0, 25.0], 4.0, 6, 0.3);
    let exact = cone::fit(&points).unwrap();
    let samples: Vec<([f64; 3], [f64; 2], [f64; 1])> = (0..RUNS)
        .map(|_| {
            let fit =
                cone::fit_near(&noisy(&points, NOISE, &mut random), &exact.direction).unwrap();
            let (p, d) = (fit.apex.mm, fit.direction);
            ([p.x, p.y, p.z], [d.x, d.y], [fit.half_angle.0])
        })
        .collect();
    let apex: Vec<_> = samples.iter().map(|s| s.0).collect();
    assert_scatter("cone apex", &apex, &square(exact.cov_unit_apex));
    let direction: Vec<_> = samples.iter().map(|s| s.1).collect();
    assert_scatter(
        "cone direction",
        &direction,
        &block(&exact.cov_unit_direction),
    );
    let angle: Vec<_> = samples.iter().map(|s| s.2).collect();
    assert_scatter(
        "cone angle",
        &angle,
        &[[exact.var_unit_half_angle * NOISE * NOISE]],
    );
}
