//! The uncertainty that is said is the scatter that is there.
//!
//! `OPENUMI_LONG=1 cargo test -p umi-core --release point::tests::scatter -- --nocapture`
//! runs 10 000 calibrations for each line; without it, as many as a second takes.

use std::vec::Vec;

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};

use super::super::{
    BallReading, PointCalibration, PointQuestion, PointSensor, ResidualNoise, calibrate,
};
use super::{ball, noisy, sensor, set};
use crate::fit::tests::Random;
use crate::units::Mm;

/// Quantiles of 95 % of F with (3, 95) and (2, 95) degrees of freedom, times the
/// dimension.
const T2: [f64; 2] = [3.0 * 2.7004, 2.0 * 3.0922];

fn rounds(quick: u32) -> u32 {
    if std::env::var_os("OPENUMI_LONG").is_some() {
        10_000
    } else {
        quick
    }
}

/// Whether the 95 % regions of t and of a hold the truth: Hotelling's T² with
/// the 95 degrees of freedom that sigma has here.
fn holds(fit: &PointCalibration, truth: &PointSensor) -> [bool; 2] {
    let c = fit.covariance_total().unwrap();
    let c = |i: usize, j: usize| c[i][j];
    let off = fit.sensor.offset.mm - truth.offset.mm;
    let of_offset = Matrix3::from_fn(c).try_inverse().unwrap();
    // a has a region in the plane across it only.
    let (e1, e2) = crate::fit::solve::linalg::perpendicular_frame(&fit.sensor.direction);
    let turn = fit.sensor.direction - truth.direction;
    let turn = Vector2::new(turn.dot(&e1), turn.dot(&e2));
    let block = Matrix3::from_fn(|i, j| c(i + 3, j + 3));
    let basis = [e1, e2];
    let of_turn = Matrix2::from_fn(|i, j| basis[i].dot(&(block * basis[j])))
        .try_inverse()
        .unwrap();
    [
        off.dot(&(of_offset * off)) <= T2[0],
        turn.dot(&(of_turn * turn)) <= T2[1],
    ]
}

/// The part of the rounds in which the regions held.
fn coverage(
    number: u32,
    wanted: &PointQuestion,
    u_center: f64,
    noise: impl Fn(&[BallReading], &mut Random) -> Vec<BallReading>,
) -> [f64; 2] {
    let readings = set(&sensor(), &ball(), 100, 5.0);
    let random = &mut Random(42);
    let mut held = [0.0; 2];
    for _ in 0..number {
        let mut said = ball();
        said.u_center = Mm(u_center);
        said.center.mm += random.normal3() * u_center;
        let fit = calibrate(&noise(&readings, random), &[said], wanted).unwrap();
        for (count, held) in held.iter_mut().zip(holds(&fit, &sensor())) {
            *count += f64::from(u8::from(held));
        }
    }
    held.map(|count| count / f64::from(number))
}

/// The reading's own noise: along the beam.
fn along(readings: &[BallReading], random: &mut Random) -> Vec<BallReading> {
    let mut readings = readings.to_vec();
    for reading in &mut readings {
        reading.gamma.0 += 1e-3 * random.normal();
    }
    readings
}

#[test]
fn regions_hold_what_they_say() {
    let everywhere = |readings: &[BallReading], random: &mut Random| {
        noisy(readings, &sensor(), &ball(), 1e-3, random)
    };
    let number = rounds(250);
    let weighted = PointQuestion {
        noise: ResidualNoise::AlongBeam,
        ..PointQuestion::default()
    };
    // 250 rounds: a standard deviation of 1.4 %.
    let slack = if number == 10_000 { 0.01 } else { 0.045 };
    let lines = [
        (
            "alike everywhere",
            coverage(number, &PointQuestion::default(), 0.0, everywhere),
        ),
        (
            "and the centre 2 µm",
            coverage(number, &PointQuestion::default(), 0.002, everywhere),
        ),
        (
            "along the beam, weighted",
            coverage(number, &weighted, 0.0, along),
        ),
    ];
    for (name, held) in lines {
        std::println!("{name}: t {:.4}, a {:.4}", held[0], held[1]);
        for part in held {
            assert!((part - 0.95).abs() <= slack, "{name} {part}");
        }
    }
    // Without weights the reading's own noise is smaller at the cap's edge,
    // where it counts as much: the regions are off, and by how much is said.
    let held = coverage(number, &PointQuestion::default(), 0.0, along);
    std::println!(
        "along the beam, not weighted: t {:.4}, a {:.4}",
        held[0],
        held[1]
    );
    assert!(
        held.iter().all(|part| (0.85..=1.0).contains(part)),
        "{held:?}"
    );
}

/// Thirteen readings at 1 µm: t to some 15 µm, but a point at the stand-off to
/// less than a micrometre.
#[test]
fn a_point_is_known_better_than_the_offset() {
    let readings = set(&sensor(), &ball(), 13, 5.0);
    let random = &mut Random(5);
    let (number, mut offset2, mut point2, mut said2) = (rounds(300), 0.0, 0.0, [0.0; 2]);
    for _ in 0..number {
        let readings = noisy(&readings, &sensor(), &ball(), 1e-3, random);
        let fit = calibrate(&readings, &[ball()], &PointQuestion::default()).unwrap();
        let origin = crate::units::Point::from_mm(0.0, 0.0, 0.0);
        let at = |sensor: &PointSensor| sensor.place(origin, Mm(44.0)).mm;
        offset2 += (fit.sensor.offset.mm - sensor().offset.mm).x.powi(2);
        point2 += (at(&fit.sensor) - at(&sensor())).x.powi(2);
        said2[0] += fit.covariance().unwrap()[0][0];
        said2[1] += fit.place_uncertainty(Mm(44.0)).unwrap().u[0].0.powi(2);
    }
    let root = |sum: f64| libm::sqrt(sum / f64::from(number));
    let (offset, point) = (root(offset2), root(point2));
    std::println!("t.x {offset:.5} mm, point.x {point:.5} mm");
    assert!((0.005..0.03).contains(&offset), "{offset}");
    assert!(point < 0.001, "{point}");
    assert!((root(said2[0]) / offset - 1.0).abs() < 0.15);
    assert!((root(said2[1]) / point - 1.0).abs() < 0.15);
}

/// With the gain free t takes up what the gain is off, and a point where it was calibrated is
/// known nearly as well as without: what is said of it is what there is.
#[test]
fn a_point_is_known_with_the_gain_free() {
    let readings = set(&sensor(), &ball(), 100, 5.0);
    let wanted = PointQuestion {
        free_gain: true,
        ..PointQuestion::default()
    };
    let random = &mut Random(6);
    let (number, origin) = (rounds(300), crate::units::Point::from_mm(0.0, 0.0, 0.0));
    let gammas = [42.0, 44.0, 47.0].map(Mm);
    let mut sums = [[0.0; 2]; 3];
    for _ in 0..number {
        let readings = noisy(&readings, &sensor(), &ball(), 1e-3, random);
        let fit = calibrate(&readings, &[ball()], &wanted).unwrap();
        for (gamma, [off2, said2]) in gammas.iter().zip(&mut sums) {
            let off = fit.sensor.place(origin, *gamma).mm - sensor().place(origin, *gamma).mm;
            *off2 += off.z * off.z;
            *said2 += fit.place_uncertainty(*gamma).unwrap().u[2].0.powi(2);
        }
    }
    for (gamma, [off2, said2]) in gammas.iter().zip(sums) {
        let (off, said) = (libm::sqrt(off2), libm::sqrt(said2));
        std::println!("{} mm: {}", gamma.0, said / off);
        assert!((said / off - 1.0).abs() < 0.15, "{gamma:?} {said} {off}");
    }
}

/// The covariance is the inverse of the numerical Jacobian's square.
#[test]
fn covariance_is_that_of_the_numerical_jacobian() {
    let readings = noisy(
        &set(&sensor(), &ball(), 20, 5.0),
        &sensor(),
        &ball(),
        1e-3,
        &mut Random(9),
    );
    let fit = calibrate(&readings, &[ball()], &PointQuestion::default()).unwrap();
    let (e1, e2) = crate::fit::solve::linalg::perpendicular_frame(&fit.sensor.direction);
    let moved = |p: &[f64; 5], r: &BallReading| {
        let sensor = PointSensor {
            offset: crate::units::Point {
                mm: fit.sensor.offset.mm + Vector3::new(p[0], p[1], p[2]),
            },
            direction: (fit.sensor.direction + e1 * p[3] + e2 * p[4]).normalize(),
            gain: 1.0,
        };
        (sensor.place(r.axes, r.gamma).mm - ball().center.mm).norm()
    };
    let jacobian = DMatrix::from_fn(readings.len(), 5, |i, k| {
        let h = 1e-5;
        let (mut up, mut down) = ([0.0; 5], [0.0; 5]);
        up[k] = h;
        down[k] = -h;
        (moved(&up, &readings[i]) - moved(&down, &readings[i])) / (2.0 * h)
    });
    let inverse = (jacobian.transpose() * &jacobian).try_inverse().unwrap();
    for i in 0..3 {
        let unit = DVector::from_fn(5, |k, _| f64::from(u8::from(k == i)));
        let variance = unit.dot(&(&inverse * &unit));
        assert!((variance / fit.cov_unit[i][i] - 1.0).abs() < 1e-5);
    }
    // a has no part along itself.
    for i in 0..6 {
        let along: f64 = (0..3)
            .map(|j| fit.cov_unit[i][j + 3] * fit.sensor.direction[j])
            .sum();
        assert!(along.abs() < 1e-12);
    }
}
