//! What the registration promises, beyond the reference cases of `tests/`.

// Matrices are compared element by element, by their indices.
#![allow(clippy::needless_range_loop)]

use std::string::ToString;
use std::vec::Vec;

use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use super::transform::rotated;
use super::{RigidTransform, distances, register};
use crate::fit::tests::{Random, moved, noisy};
use crate::fit::{Degeneracy, FitError, PointSet};
use crate::units::Point;

/// The three-sphere plate: centres some 270 mm apart, in one plane.
fn plate() -> Vec<Point> {
    [
        [-135.0, -136.6, 135.9],
        [138.0, -134.7, 110.3],
        [-136.7, 136.4, 136.1],
    ]
    .map(Point::from_array_mm)
    .to_vec()
}

fn cloud(n: usize, random: &mut Random) -> Vec<Point> {
    (0..n)
        .map(|_| Point {
            mm: random.normal3() * 50.0,
        })
        .collect()
}

fn orthogonality(r: &Matrix3<f64>) -> f64 {
    (r * r.transpose() - Matrix3::identity()).amax()
}

#[test]
fn refusals_name_the_side_and_the_row() {
    let plate = plate();
    assert_eq!(
        register(&plate, &plate[..2]),
        Err(FitError::LengthMismatch {
            source: 3,
            target: 2
        })
    );
    assert_eq!(
        register(&plate[..2], &plate[..2]),
        Err(FitError::TooFewPoints {
            given: 2,
            needed: 3
        })
    );
    let mut bad = plate.clone();
    bad[1].mm.y = f64::NAN;
    let error = register(&plate, &bad).unwrap_err();
    assert_eq!(
        error,
        FitError::NotFinite {
            set: PointSet::Target,
            row: 1
        }
    );
    assert!(error.to_string().starts_with("target point 2 "), "{error}");
    bad[1].mm.y = -1e300;
    let error = register(&bad, &plate).unwrap_err();
    assert_eq!(
        error,
        FitError::OutOfRange {
            set: PointSet::Source,
            row: 1
        }
    );

    // A null point printed as zeros in place of two spheres; a line; one point.
    let doubled = [plate[0], plate[1], plate[1]];
    let why = Degeneracy::Duplicates {
        distinct: 2,
        needed: 3,
    };
    assert_eq!(
        register(&plate, &doubled),
        Err(FitError::Degenerate {
            set: PointSet::Target,
            why
        })
    );
    let line: Vec<Point> = (0..3)
        .map(|k| Point {
            mm: plate[0].mm * f64::from(k),
        })
        .collect();
    let why = Degeneracy::Collinear;
    assert_eq!(
        register(&line, &plate),
        Err(FitError::Degenerate {
            set: PointSet::Source,
            why
        })
    );
    assert_eq!(
        register(&plate, &line),
        Err(FitError::Degenerate {
            set: PointSet::Target,
            why
        })
    );
    let why = Degeneracy::Coincident;
    assert_eq!(
        register(&[plate[0]; 3], &plate),
        Err(FitError::Degenerate {
            set: PointSet::Source,
            why
        })
    );
}

/// Three points have a mirror image in their own plane, so the plain product of
/// the decomposition is a reflection every other time. The result never is.
#[test]
fn a_reflection_is_never_returned() {
    let mut random = Random(31);
    for n in [3, 3, 4, 8] {
        for _ in 0..500 {
            let source = cloud(n, &mut random);
            let (rotation, shift) = (random.rotation(), random.normal3() * 1e3);
            let fit = register(&source, &moved(&source, &rotation, &shift)).unwrap();
            let r = fit.transform.rotation;
            assert!((r - rotation.matrix()).amax() < 1e-12, "{r} {rotation}");
            assert!(orthogonality(&r) < 4e-15);
            assert!((r.determinant() - 1.0).abs() < 4e-15);
            assert!(fit.stats.rms.0 < 1e-12);
        }
    }
}

/// Mirrored measurements cannot be registered by a rotation: residuals as large
/// as the part say so, and the result is still a rotation.
#[test]
fn a_mirrored_part_shows_in_the_residuals() {
    let mut random = Random(32);
    for _ in 0..100 {
        let source = cloud(8, &mut random);
        let mirrored: Vec<Point> = source
            .iter()
            .map(|p| Point::from_mm(-p.mm.x, p.mm.y, p.mm.z))
            .collect();
        match register(&source, &mirrored) {
            Ok(fit) => {
                assert!(fit.stats.rms.0 > 5.0);
                assert!((fit.transform.rotation.determinant() - 1.0).abs() < 4e-15);
            }
            Err(error) => assert_eq!(error.code(), "ill_conditioned"),
        }
    }
}

/// A regular tetrahedron against its mirror image: every rotation about the
/// mirrored corner is as good, so there is no answer.
#[test]
fn a_rotation_that_is_not_unique_is_refused() {
    let corners = [
        [1.0, 1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
    ];
    let source = corners.map(Point::from_array_mm);
    let target = corners.map(|[x, y, z]| Point::from_mm(-x, -y, -z));
    assert_eq!(
        register(&source, &target).unwrap_err().code(),
        "ill_conditioned"
    );
}

/// Half turns about every kind of axis, where angle and axis formulas by the
/// sine break down.
#[test]
fn half_turns_are_exact() {
    let mut random = Random(33);
    for k in 0..200 {
        let axis = match k {
            0 => Vector3::x(),
            1 => Vector3::y(),
            2 => Vector3::z(),
            _ => random.direction(),
        };
        let source = cloud(3 + k % 4, &mut random);
        // R v = 2 a (a·v) - v.
        let target: Vec<Point> = source
            .iter()
            .map(|p| Point {
                mm: axis * (2.0 * axis.dot(&p.mm)) - p.mm,
            })
            .collect();
        let fit = register(&source, &target).unwrap();
        assert!(
            (fit.angle.0 - core::f64::consts::PI).abs() < 1e-13,
            "{:?}",
            fit.angle
        );
        assert!(fit.axis.unwrap().cross(&axis).amax() < 1e-13);
        assert!(fit.stats.rms.0 < 1e-13);
    }
}

/// Two degrees about z: the sign of angle and axis is that of a right-handed turn.
#[test]
fn angle_and_axis_turn_to_the_right() {
    let angle = 2.0_f64.to_radians();
    let turn = |p: &Point| {
        let (s, c) = (libm::sin(angle), libm::cos(angle));
        Point::from_mm(c * p.mm.x - s * p.mm.y, s * p.mm.x + c * p.mm.y, p.mm.z)
    };
    let source = plate();
    let target: Vec<Point> = source.iter().map(turn).collect();
    let fit = register(&source, &target).unwrap();
    assert!((fit.angle.0 - angle).abs() < 1e-15);
    assert!((fit.axis.unwrap() - Vector3::z()).amax() < 1e-13);
    let back = register(&target, &source).unwrap();
    assert!((back.angle.0 - angle).abs() < 1e-15);
    assert!((back.axis.unwrap() + Vector3::z()).amax() < 1e-13);
    let none = register(&source, &source).unwrap();
    assert_eq!(none.axis, None);
    assert!(none.angle.0 < 1e-15);
    assert_eq!(RigidTransform::identity().angle_axis().1, None);
}

/// An exchanged pair of spheres turns the plate upside down with residuals that
/// a limit might still let pass; the angle tells.
#[test]
fn exchanged_spheres_show_in_the_angle() {
    // Legs 273.014 and 273.041 mm, all balls at one height.
    let source =
        [[0.0, 0.0, 0.0], [273.014, 0.0, 0.0], [0.0, 273.041, 0.0]].map(Point::from_array_mm);
    let fit = register(&source, &[source[0], source[2], source[1]]).unwrap();
    assert!(fit.stats.rms.0 < 0.02);
    assert!(fit.angle.to_degrees() > 179.0);
    assert!(fit.transform.rotation.m33 < -0.999);
}

/// `inverse` is the transform back, `apply` the formula.
#[test]
fn the_inverse_goes_back() {
    let mut random = Random(34);
    for _ in 0..100 {
        let source = cloud(5, &mut random);
        let target = moved(&source, &random.rotation(), &(random.normal3() * 300.0));
        let fit = register(&source, &noisy(&target, 0.01, &mut random)).unwrap();
        let p = Point {
            mm: random.normal3() * 200.0,
        };
        let image = fit.apply(p);
        assert_eq!(
            image.mm,
            rotated(&fit.transform.rotation, &p.mm) + fit.transform.translation_mm
        );
        assert!((fit.inverse().apply(image).mm - p.mm).amax() < 1e-12);
        let (angle, _) = fit.inverse().angle_axis();
        assert!((angle.0 - fit.angle.0).abs() < 1e-15);
    }
}

/// The 6x6 covariance and the expected error at a point are what 2000 repeated
/// registrations scatter: within 10 %, for the three-sphere plate and a cloud.
#[test]
fn expected_errors_are_the_scatter_of_repeated_registrations() {
    const NOISE: f64 = 0.01;
    const RUNS: usize = 2000;
    let mut random = Random(35);
    for source in [plate(), cloud(6, &mut random)] {
        let rotation = random.rotation();
        let target = moved(&source, &rotation, &Vector3::new(-35.0, 16.0, 2.0));
        let exact = register(&source, &target).unwrap();
        let places = [
            Point::from_mm(0.0, 0.0, 0.0),
            Point::from_mm(50.0, -20.0, 64.0),
            Point::from_mm(300.0, 300.0, 300.0),
            exact.centroid,
        ];
        let mut squares = [0.0; 4];
        let mut sums = [[0.0; 6]; 6];
        let mut variance = 0.0;
        for _ in 0..RUNS {
            let fit = register(&source, &noisy(&target, NOISE, &mut random)).unwrap();
            variance += fit.stats.variance_mm2().unwrap() / RUNS as f64;
            for (sum, p) in squares.iter_mut().zip(places) {
                *sum += (fit.apply(p).mm - exact.apply(p).mm).norm_squared() / RUNS as f64;
            }
            // R_fit = exp([w]×) R_exact: the small rotation between the two.
            let between = fit.transform.rotation * exact.transform.rotation.transpose();
            let w = [
                0.5 * (between.m32 - between.m23),
                0.5 * (between.m13 - between.m31),
                0.5 * (between.m21 - between.m12),
            ];
            let t = fit.transform.translation_mm - exact.transform.translation_mm;
            let step = [w[0], w[1], w[2], t.x, t.y, t.z];
            for i in 0..6 {
                for j in 0..6 {
                    sums[i][j] += step[i] * step[j] / RUNS as f64;
                }
            }
        }
        assert!((variance / (NOISE * NOISE) - 1.0).abs() < 0.1);
        for i in 0..6 {
            for j in 0..6 {
                let predicted = exact.cov_unit[i][j] * NOISE * NOISE;
                let size = NOISE * NOISE * libm::sqrt(exact.cov_unit[i][i] * exact.cov_unit[j][j]);
                let difference = (sums[i][j] - predicted) / size;
                assert!(difference.abs() < 0.1, "{i} {j}: {difference}");
            }
        }
        for (p, square) in places.iter().zip(squares) {
            let unit = exact.cov_unit_at(*p);
            let predicted = NOISE * NOISE * (unit[0][0] + unit[1][1] + unit[2][2]);
            assert!(
                (square / predicted - 1.0).abs() < 0.1,
                "{p:?} {square} {predicted}"
            );
        }
        // The expected error is least at the centroid: sigma sqrt(3/n).
        let noisy_fit = register(&source, &noisy(&target, NOISE, &mut random)).unwrap();
        let sigma = noisy_fit.stats.sigma.unwrap().0;
        let least = noisy_fit.expected_error_at(noisy_fit.centroid).unwrap().0;
        assert!((least / (sigma * libm::sqrt(3.0 / source.len() as f64)) - 1.0).abs() < 1e-12);
        assert!(noisy_fit.expected_error_at(places[2]).unwrap().0 > least);
        // Through the 6x6 at the origin it is the same covariance.
        let at_origin = noisy_fit.cov_unit_at(places[0]);
        for i in 0..3 {
            for j in 0..3 {
                let difference = at_origin[i][j] - noisy_fit.cov_unit[i + 3][j + 3];
                assert!(difference.abs() < 1e-12);
            }
        }
    }
}

/// Distances refuse what they cannot measure, and need no heap to be compared.
#[test]
fn distances_are_those_of_the_points() {
    let plate = plate();
    assert_eq!(distances(&plate, &plate).unwrap().count(), 3);
    assert_eq!(distances(&[], &[]).unwrap().count(), 0);
    let mut bad = plate.clone();
    bad[2].mm.z = f64::INFINITY;
    let error = distances(&plate, &bad).err().unwrap();
    assert_eq!(
        error,
        FitError::NotFinite {
            set: PointSet::Target,
            row: 2
        }
    );
    let mut grown = plate.clone();
    for p in &mut grown {
        p.mm *= 1.001;
    }
    for d in distances(&plate, &grown).unwrap() {
        assert!((d.difference().0 - 0.001 * d.nominal.0).abs() < 1e-10);
        assert!((d.nominal.0 - (plate[d.first].mm - plate[d.second].mm).norm()).abs() < 1e-12);
    }
}

fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => (-2_i32..=2).prop_map(f64::from),
        2 => -200.0..200.0_f64,
        1 => (-310_i32..=308).prop_map(|e| libm::pow(10.0, f64::from(e))),
        1 => any::<f64>(),
    ]
}

fn wild_points(n: usize) -> impl Strategy<Value = Vec<Point>> {
    prop::collection::vec([wild(), wild(), wild()], n)
        .prop_map(|rows| rows.into_iter().map(Point::from_array_mm).collect())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// No panic, no non-finite number, always a rotation.
    #[test]
    fn wild_pairs_give_a_rotation_or_a_refusal(
        (source, target) in (0_usize..7).prop_flat_map(|n| (wild_points(n), wild_points(n)))
    ) {
        if let Ok(fit) = register(&source, &target) {
            let text = std::format!("{fit:?}");
            prop_assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            prop_assert!(orthogonality(&fit.transform.rotation) < 1e-14);
            prop_assert!((fit.transform.rotation.determinant() - 1.0).abs() < 1e-14);
        }
    }

    /// A motion of the target is composed with the transform, whatever the
    /// order of the pairs.
    #[test]
    fn a_moved_target_moves_the_transform(seed in any::<u64>(), roll in 0_usize..6) {
        let mut random = Random(seed);
        let mut source = cloud(6, &mut random);
        let mut target = noisy(&source, 0.05, &mut random);
        let before = register(&source, &target).unwrap();
        let (rotation, shift) = (random.rotation(), random.normal3() * 500.0);
        source.rotate_left(roll);
        target.rotate_left(roll);
        let after = register(&source, &moved(&target, &rotation, &shift)).unwrap();
        let wanted = rotation.matrix() * before.transform.rotation;
        prop_assert!((after.transform.rotation - wanted).amax() < 1e-12);
        let wanted = rotation * before.transform.translation_mm + shift;
        prop_assert!((after.transform.translation_mm - wanted).amax() < 1e-9);
        prop_assert!((after.stats.rms.0 - before.stats.rms.0).abs() < 1e-12);
    }
}
