//! Every set that tells nothing is refused by its name, exact or noisy.

use std::string::ToString;
use std::vec::Vec;

use nalgebra::Vector3;
use proptest::prelude::*;

use super::super::{BallReading, PointQuestion, PointRefusal, calibrate};
use super::{ball, cap, noisy, reading_at, sensor, set};
use crate::fit::tests::Random;
use crate::units::Mm;

const FREE_RADIUS: PointQuestion = PointQuestion {
    direction: Vector3::new(0.0, 0.0, -1.0),
    free_radius: true,
    free_gain: false,
    noise: super::super::ResidualNoise::Everywhere,
};

fn refused(readings: &[BallReading], wanted: &PointQuestion) -> &'static str {
    let error = calibrate(readings, &[ball()], wanted).expect_err("a set that tells nothing");
    assert!(error.to_string().len() > 20);
    error.code()
}

/// Places of a circle of the ball: about `axis`, `cos` above its centre.
fn circle(axis: &Vector3<f64>, cos: f64, number: usize) -> Vec<Vector3<f64>> {
    let (e1, e2) = crate::fit::solve::linalg::perpendicular_frame(axis);
    let sin = libm::sqrt(1.0 - cos * cos);
    (0..number)
        .map(|k| {
            let turn = core::f64::consts::TAU * k as f64 / number as f64;
            axis * cos + (e1 * libm::cos(turn) + e2 * libm::sin(turn)) * sin
        })
        .collect()
}

fn at_depths(places: &[Vector3<f64>]) -> Vec<BallReading> {
    places
        .iter()
        .enumerate()
        .map(|(k, n)| reading_at(&sensor(), &ball(), n, 41.0 + (k * 7 % 5) as f64 * 1.4))
        .collect()
}

/// The upper half of a great circle whose plane is `tilt` beside the beam.
fn great_circle(turn: f64, tilt: f64, number: usize) -> Vec<BallReading> {
    let beam = -sensor().direction;
    let (e1, e2) = crate::fit::solve::linalg::perpendicular_frame(&beam);
    let side = e1 * libm::cos(turn) + e2 * libm::sin(turn);
    let up = beam * libm::cos(tilt) + beam.cross(&side) * libm::sin(tilt);
    let places: Vec<_> = (0..number)
        .map(|k| {
            let angle = -1.0 + 2.0 * k as f64 / (number - 1) as f64;
            up * libm::cos(angle) + side * libm::sin(angle)
        })
        .collect();
    at_depths(&places)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn one_great_circle(turn in 0.0..3.1_f64, tilt in prop_oneof![Just(0.0), -0.5..0.5_f64], number in 8_usize..60, sigma in 0_usize..4, seed in 0_u64..1000) {
        let sigma = [0.0, 1e-6, 1e-3, 0.01][sigma];
        // Of eight readings, three more than unknowns, one set in 30 000 scatters by chance as little as if it told something.
        let number = if sigma > 1e-5 { number + 12 } else { number };
        let readings = noisy(&great_circle(turn, tilt, number), &sensor(), &ball(), sigma, &mut Random(seed));
        let code = refused(&readings, &PointQuestion::default());
        prop_assert!(["great_circle", "degenerate", "ambiguous"].contains(&code), "{}", code);
        // ResidualNoise hides what is singular from a solver, not from a name.
        prop_assert!(sigma > 0.0 || tilt != 0.0 || code == "great_circle", "{}", code);
    }

    #[test]
    fn readings_all_alike(number in 8_usize..60, sigma in 0_usize..3, seed in 0_u64..1000) {
        let readings = set(&sensor(), &ball(), number, 0.0);
        let mut random = Random(seed);
        let sigma = [0.0, 1e-6, 1e-3][sigma];
        let mut readings = noisy(&readings, &sensor(), &ball(), sigma, &mut random);
        for reading in &mut readings {
            reading.gamma.0 += sigma * random.normal();
        }
        prop_assert_eq!(refused(&readings, &PointQuestion::default()), "range_not_varied");
    }

    #[test]
    fn one_circle_with_the_radius_free(cos in 0.3..0.95_f64, number in 8_usize..60, sigma in 0_usize..3, seed in 0_u64..1000) {
        let sigma = [0.0, 1e-6, 1e-4][sigma];
        let readings = at_depths(&circle(&-sensor().direction, cos, number));
        let readings = noisy(&readings, &sensor(), &ball(), sigma, &mut Random(seed));
        let code = refused(&readings, &FREE_RADIUS);
        prop_assert!(["one_circle", "degenerate"].contains(&code), "{}", code);
    }

    #[test]
    fn few_places_many_times(places in 1_usize..6, sigma in 0_usize..2, seed in 0_u64..1000) {
        let few = set(&sensor(), &ball(), places, 5.0);
        let readings: Vec<_> = few.iter().cycle().take(40).copied().collect();
        let mut random = Random(seed);
        let mut readings = readings;
        for reading in &mut readings {
            reading.gamma.0 += [0.0, 1e-3][sigma] * random.normal();
        }
        prop_assert_eq!(refused(&readings, &PointQuestion::default()), "coincident_points");
    }

    #[test]
    fn nothing_panics(
        rows in prop::collection::vec(prop::array::uniform4(prop_oneof![
            -700.0..700.0_f64, Just(0.0), Just(1e300), Just(f64::NAN), Just(44.0),
        ]), 0..30),
        radius in prop_oneof![Just(10.0), Just(0.0), Just(1e-9), Just(f64::INFINITY)],
        free_radius: bool, free_gain: bool,
    ) {
        let readings: Vec<_> = rows.iter().map(|r| BallReading {
            axes: crate::units::Point::from_mm(r[0], r[1], r[2]),
            gamma: Mm(r[3]),
            ball: 0,
        }).collect();
        let mut ball = ball();
        ball.radius = Mm(radius);
        let wanted = PointQuestion { free_radius, free_gain, ..PointQuestion::default() };
        if let Ok(fit) = calibrate(&readings, &[ball], &wanted) {
            prop_assert!(fit.sensor.offset.is_finite());
            prop_assert!(fit.cov_unit.as_flattened().iter().all(|x| x.is_finite()));
        }
    }
}

#[test]
fn one_place_at_many_depths() {
    let readings = at_depths(&[-sensor().direction; 12]);
    let depths: Vec<_> = (0..12)
        .map(|k| {
            reading_at(
                &sensor(),
                &ball(),
                &-sensor().direction,
                40.0 + f64::from(k),
            )
        })
        .collect();
    assert_eq!(
        refused(&readings, &PointQuestion::default()),
        "coincident_points"
    );
    assert_eq!(
        refused(&depths, &PointQuestion::default()),
        "coincident_points"
    );
}

#[test]
fn numbers_that_are_none() {
    let mut readings = set(&sensor(), &ball(), 12, 5.0);
    assert_eq!(
        refused(&readings[..5], &PointQuestion::default()),
        "too_few_points"
    );
    assert_eq!(refused(&readings[..6], &FREE_RADIUS), "too_few_points");
    readings[3].gamma = Mm(f64::NAN);
    assert_eq!(refused(&readings, &PointQuestion::default()), "not_finite");
    readings[3] = readings[2];
    readings[3].ball = 1;
    assert_eq!(
        refused(&readings, &PointQuestion::default()),
        "unknown_sphere"
    );
    let mut flat = ball();
    flat.radius = Mm(-1.0);
    readings[3].ball = 0;
    let error = calibrate(&readings, &[flat], &PointQuestion::default()).unwrap_err();
    assert_eq!(error.code(), "bad_sphere");
}

/// Readings in another unit, of another ball, of nothing: they vary, and are not told to be alike.
#[test]
fn readings_of_no_such_ball() {
    let random = &mut Random(5);
    let good = noisy(
        &set(&sensor(), &ball(), 30, 5.0),
        &sensor(),
        &ball(),
        1e-3,
        random,
    );
    let changed = |change: &mut dyn FnMut(&mut f64)| {
        let mut readings = good.clone();
        for reading in &mut readings {
            change(&mut reading.gamma.0);
        }
        refused(&readings, &PointQuestion::default())
    };
    assert_eq!(changed(&mut |gamma| *gamma *= 1e3), "residual_too_large");
    assert_eq!(
        changed(&mut |gamma| *gamma = 44.0 + 5.0 * random.normal()),
        "residual_too_large"
    );
    let mut small = ball();
    small.radius = Mm(5.0);
    let error = calibrate(&good, &[small], &PointQuestion::default()).unwrap_err();
    assert_eq!(error.code(), "residual_too_large", "{error}");
    // One that is far off draws the beam with it, so that the others strike the ball at one place.
    for far in [1e3, 1e6, 1e8] {
        let mut one = good.clone();
        one[3].gamma.0 = far;
        assert_eq!(
            refused(&one, &PointQuestion::default()),
            "residual_too_large"
        );
    }
}

/// A small circle beside the beam: the ball may be on either side of it, whatever the direction.
#[test]
fn one_small_circle_beside_the_beam() {
    let side = Vector3::new(0.0, 1.0, 0.0);
    let upper: Vec<_> = circle(&side, 0.3, 48)
        .into_iter()
        .filter(|normal| normal.z > 0.5)
        .collect();
    let error = calibrate(&at_depths(&upper), &[ball()], &PointQuestion::default()).unwrap_err();
    let PointRefusal::Ambiguous {
        apart_deg, apart, ..
    } = error
    else {
        panic!("{error}");
    };
    assert!(apart_deg < 0.01 && (apart.0 - 6.0).abs() < 0.05, "{error}");
}

/// Readings that grow towards the sensor.
#[test]
fn swapped_sign_is_no_calibration() {
    let random = &mut Random(3);
    for depth in [2.0, 5.0, 8.0] {
        let mut readings = set(&sensor(), &ball(), 30, depth);
        readings = noisy(&readings, &sensor(), &ball(), 1e-3, random);
        for reading in &mut readings {
            reading.gamma.0 = -reading.gamma.0;
        }
        let error = calibrate(&readings, &[ball()], &PointQuestion::default()).unwrap_err();
        assert!(matches!(error, PointRefusal::OtherWay { .. }), "{error}");
        assert_eq!(error.code(), "no_convergence");
    }
}

/// A narrow cap is weak and says so, long before it is refused.
#[test]
fn weak_sets_are_told() {
    let narrow = |half_angle: f64| {
        let readings = at_depths(&cap(&-sensor().direction, half_angle, 40));
        calibrate(&readings, &[ball()], &PointQuestion::default())
    };
    assert!(narrow(1.0).unwrap().weak.is_none());
    let weak = narrow(0.03).unwrap().weak.unwrap();
    assert!(weak.factor > 33.0, "{weak:?}");
}
