//! Cylinders and cones are found without a hint, wherever they are and however
//! much of them is seen.

use std::vec::Vec;

use nalgebra::Vector3;

use super::{Random, moved, noisy, revolved};
use crate::fit::{cone, cylinder};
use crate::units::Point;

const WHOLE: f64 = core::f64::consts::TAU;

/// Name, heights in radii, arc, columns, twist.
type Shape = (&'static str, &'static [f64], f64, u32, f64);

const SHAPES: [Shape; 8] = [
    ("whole", &[0.0, 1.0, 2.0, 3.0], WHOLE, 7, 0.1),
    ("long", &[0.0, 5.0, 20.0, 60.0], WHOLE, 5, 0.4),
    ("needle", &[0.0, 100.0, 300.0], WHOLE, 5, 0.4),
    ("short", &[0.0, 0.05, 0.1], WHOLE, 8, 0.2),
    ("arc of 100 degrees", &[0.0, 0.2, 0.4, 0.55], 1.745, 10, 0.0),
    (
        "long arc of 100 degrees",
        &[0.0, 3.0, 6.0, 9.0],
        1.745,
        6,
        0.0,
    ),
    ("half", &[0.0, 1.0, 2.0], 3.1, 6, 0.0),
    ("two rings of four", &[0.0, 2.7], WHOLE, 4, 0.5),
];

/// The shape at a random place up to 1e4 mm away, with noise; its axis too.
fn placed(
    points: &[Point],
    noise: f64,
    random: &mut Random,
) -> (Vec<Point>, Vector3<f64>, Vector3<f64>) {
    let rotation = random.rotation();
    let shift = random.direction() * random.between(0.0, 1e4);
    let points = moved(&noisy(points, noise, random), &rotation, &shift);
    (points, rotation * Vector3::z(), shift)
}

#[test]
fn cylinders_are_found_anywhere() {
    let mut random = Random(21);
    for round in 0..40 {
        let radius = libm::pow(10.0, random.between(-0.3, 2.0));
        for (name, heights, arc, columns, twist) in SHAPES {
            let heights: Vec<f64> = heights.iter().map(|h| h * radius).collect();
            let points = revolved(|_| radius, &heights, arc, columns, twist);
            let noise = radius * [0.0, 1e-6, 1e-5, 1e-4][round % 4];
            let (points, axis, shift) = placed(&points, noise, &mut random);
            let fit = cylinder::fit(&points).unwrap_or_else(|e| panic!("{name} {e}"));
            // Five standard uncertainties for unit noise, or rounding.
            let (ur, noise) = (libm::sqrt(fit.var_unit_radius), noise + 1e-10);
            assert!(
                (fit.radius.0 - radius).abs() < 5.0 * ur * noise,
                "{name} {fit:?}"
            );
            let ud = libm::sqrt((0..3).map(|i| fit.cov_unit_direction[i][i]).sum::<f64>());
            assert!(
                fit.direction.cross(&axis).norm() < 5.0 * ud * noise,
                "{name} {fit:?}"
            );
            let across = (fit.point.mm - shift).cross(&axis).norm();
            let up = libm::sqrt((0..3).map(|i| fit.cov_unit_point[i][i]).sum::<f64>());
            // The origin of the shape is up to its length from the foot.
            let lever = (fit.point.mm - shift).norm();
            assert!(
                across < 5.0 * (up + lever * ud) * noise,
                "{name} {across} {fit:?}"
            );
        }
    }
}

#[test]
fn cones_are_found_anywhere() {
    let mut random = Random(22);
    for round in 0..40 {
        let radius = libm::pow(10.0, random.between(-0.3, 2.0));
        let half_angle = random.between(0.1, 1.2);
        for (name, heights, arc, columns, twist) in SHAPES {
            // A needle of a cone is a wide cone seen from afar.
            if ["needle", "two rings of four"].contains(&name) {
                continue;
            }
            let slope = libm::tan(half_angle);
            let heights: Vec<f64> = heights.iter().map(|h| (h + 0.5) * radius).collect();
            let points = revolved(|z| z * slope, &heights, arc, columns, twist);
            let noise = radius * [0.0, 1e-7, 1e-6, 1e-5][round % 4];
            let (points, axis, shift) = placed(&points, noise, &mut random);
            let fit = cone::fit(&points).unwrap_or_else(|e| panic!("{name} {half_angle} {e}"));
            let noise = noise + 1e-10;
            let uh = libm::sqrt(fit.var_unit_half_angle);
            assert!(
                (fit.half_angle.0 - half_angle).abs() < 5.0 * uh * noise,
                "{name} {fit:?}"
            );
            let ud = libm::sqrt((0..3).map(|i| fit.cov_unit_direction[i][i]).sum::<f64>());
            assert!(
                (fit.direction - axis).norm() < 5.0 * ud * noise,
                "{name} {fit:?}"
            );
            let ua = libm::sqrt((0..3).map(|i| fit.cov_unit_apex[i][i]).sum::<f64>());
            assert!(
                (fit.apex.mm - shift).norm() < 5.0 * ua * noise,
                "{name} {fit:?}"
            );
        }
    }
}

/// A list longer than the search's sample is fitted with all its points.
#[test]
fn long_lists_are_fitted_whole() {
    let mut random = Random(23);
    let heights: Vec<f64> = (0..100).map(f64::from).collect();
    let points = noisy(
        &revolved(|_| 15.0, &heights, 4.0, 30, 0.1),
        1e-3,
        &mut random,
    );
    let fit = cylinder::fit(&points).unwrap();
    assert_eq!((fit.stats.n, fit.stats.dof), (3000, 2995));
    assert!((fit.radius.0 - 15.0).abs() < 5.0 * fit.radius_uncertainty().unwrap().0);
    let other = cylinder::fit_near(&points, &Vector3::z()).unwrap();
    assert!((fit.radius.0 - other.radius.0).abs() < 1e-12);
}

/// Coordinates of a kilometre and of a nanometre.
#[test]
fn far_and_tiny_points_keep_their_digits() {
    // On a grid of 1/64 mm, so that adding 1e9 loses nothing.
    let points: Vec<Point> = revolved(|_| 15.0, &[0.0, 20.0], WHOLE, 12, 0.1)
        .iter()
        .map(|p| Point {
            mm: p.mm.map(|x| libm::round(x * 64.0) / 64.0),
        })
        .collect();
    let near = cylinder::fit(&points).unwrap();
    let far: Vec<Point> = points
        .iter()
        .map(|p| Point {
            mm: p.mm.add_scalar(1e9),
        })
        .collect();
    let fit = cylinder::fit(&far).unwrap();
    assert!((fit.radius.0 - near.radius.0).abs() < 1e-12);
    assert!((fit.stats.rms.0 - near.stats.rms.0).abs() < 1e-12);
    assert!((fit.direction - near.direction).amax() < 1e-13);
    let tiny: Vec<Point> = points.iter().map(|p| Point { mm: p.mm * 1e-6 }).collect();
    let fit = cylinder::fit(&tiny).unwrap();
    assert!((fit.radius.0 * 1e6 - near.radius.0).abs() < 1e-12);
}

/// A random cylinder (half angle 0) or cone with noise, and its axis.
struct RandomShape {
    points: Vec<Point>,
    axis: Vector3<f64>,
    half_angle: f64,
    /// The part of a turn that is seen, radians.
    arc: f64,
    /// Height over radius.
    aspect: f64,
    /// Noise over radius.
    noise: f64,
}

impl RandomShape {
    fn new(cone: bool, random: &mut Random) -> Self {
        let half_angle = if cone { random.between(0.05, 1.2) } else { 0.0 };
        let radius = libm::pow(10.0, random.between(-0.5, 2.0));
        let arc = [WHOLE, WHOLE, 3.1, 1.745][(random.unit() * 4.0) as usize];
        // From a disc to a hundred radii, arcs up to eight.
        let longest = if arc < WHOLE { 0.9 } else { 2.0 };
        let aspect = libm::pow(10.0, random.between(-0.5, longest));
        let n = if arc < WHOLE || cone { 12 } else { 8 } + (random.unit() * 30.0) as usize;
        let noise = [0.0, 1e-5, 1e-4, 1e-3][(random.unit() * 4.0) as usize];
        let (sine, cosine) = (libm::sin(half_angle), libm::cos(half_angle));
        let points: Vec<Point> = (0..n)
            .map(|_| {
                let along = random.between(0.0, aspect) * radius;
                let angle = random.between(0.0, arc);
                let (rho, z) = if cone {
                    (
                        (along + 0.2 * radius) * sine,
                        (along + 0.2 * radius) * cosine,
                    )
                } else {
                    (radius, along)
                };
                let off = noise * radius * random.normal();
                let (rho, z) = (rho + off * cosine, z - off * sine);
                Point::from_mm(rho * libm::cos(angle), rho * libm::sin(angle), z)
            })
            .collect();
        let (points, axis, _) = placed(&points, 0.0, random);
        Self {
            points,
            axis,
            half_angle,
            arc,
            aspect,
            noise,
        }
    }

    /// The axis tilted by an angle in degrees.
    fn tilted(&self, degrees: f64, random: &mut Random) -> Vector3<f64> {
        let across = self.axis.cross(&random.direction()).normalize();
        self.axis + across * libm::tan(degrees.to_radians())
    }
}

/// The search finds what the true axis as a hint leads to, in 1000 random
/// cylinders: discs, needles, arcs from 100 degrees, from eight points. A hint
/// off by ten degrees leads there too, where the cylinder is no needle.
#[test]
fn random_cylinders_are_found_without_a_hint() {
    let mut random = Random(24);
    for k in 0..1000 {
        let shape = RandomShape::new(false, &mut random);
        let told = cylinder::fit_near(&shape.points, &shape.axis);
        let found = match cylinder::fit(&shape.points) {
            Ok(found) => found,
            // Refused in doubt, but only where there is noise to doubt.
            Err(error) => {
                assert!(
                    shape.noise > 0.0 && error.code() != "no_convergence",
                    "{k} {error}"
                );
                continue;
            }
        };
        let rms = told.map_or(f64::INFINITY, |told| told.stats.rms.0);
        assert!(
            found.stats.rms.0 <= rms * (1.0 + 1e-6) + 1e-12,
            "{k} {found:?} {told:?}"
        );
        if shape.aspect < 3.0 && shape.aspect > 0.5 {
            let hint = shape.tilted(if shape.arc < 3.0 { 5.0 } else { 10.0 }, &mut random);
            let hinted = cylinder::fit_near(&shape.points, &hint).unwrap();
            assert!(
                hinted.direction.cross(&found.direction).amax() < 1e-6,
                "{k} {}",
                shape.arc
            );
        }
    }
}

/// The same for 1000 random cones from twelve points.
#[test]
fn random_cones_are_found_without_a_hint() {
    let mut random = Random(25);
    for k in 0..1000 {
        let shape = RandomShape::new(true, &mut random);
        let told = cone::fit_near(&shape.points, &shape.axis);
        let found = match cone::fit(&shape.points) {
            Ok(found) => found,
            Err(error) => {
                assert!(
                    shape.noise > 0.0 && error.code() != "no_convergence",
                    "{k} {error}"
                );
                continue;
            }
        };
        let rms = told.map_or(f64::INFINITY, |told| told.stats.rms.0);
        assert!(
            found.stats.rms.0 <= rms * (1.0 + 1e-6) + 1e-12,
            "{k} {found:?} {told:?}"
        );
        if shape.arc == WHOLE && shape.half_angle > 0.2 && shape.half_angle < 1.0 {
            let hint = shape.tilted(5.0, &mut random);
            let hinted = cone::fit_near(&shape.points, &hint).unwrap();
            assert!(
                hinted.direction.cross(&found.direction).amax() < 1e-6,
                "{k}"
            );
        }
    }
}
