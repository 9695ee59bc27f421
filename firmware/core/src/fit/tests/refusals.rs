//! Input that must be refused by name, and never becomes a number.

use std::string::ToString;
use std::vec;
use std::vec::Vec;

use nalgebra::Vector3;

use super::wild::all_fits;
use super::{Random, five_hits, noisy, revolved};
use crate::fit::{Degeneracy, FitError, PointSet, Quantity};
use crate::fit::{circle, cone, cylinder, line, plane, sphere};
use crate::units::Point;

fn assert_all(points: &[Point], except: &[&str], code: &str) {
    for (kind, result) in all_fits(points) {
        if !except.contains(&kind) {
            assert_eq!(result.map_err(|e| e.code()), Err(code), "{kind}");
        }
    }
}

#[test]
fn too_few_points_are_counted() {
    assert_all(&[], &[], "too_few_points");
    assert_eq!(
        sphere::fit(&[Point::from_mm(0.0, 0.0, 0.0); 3]),
        Err(FitError::TooFewPoints {
            given: 3,
            needed: 4
        })
    );
}

#[test]
fn nan_and_infinity_are_named_with_their_row() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut points = five_hits(Point::from_mm(1.0, 2.0, 3.0), 12.7);
        points.push(Point::from_mm(1.0, bad, 1.0));
        assert_all(&points, &[], "not_finite");
        let error = plane::fit(&points).unwrap_err();
        assert_eq!(
            error,
            FitError::NotFinite {
                set: PointSet::Points,
                row: 5
            }
        );
        // People count from one.
        assert!(error.to_string().starts_with("point 6 "), "{error}");
    }
}

/// 1e300 is finite, but its square is not: refused by name, not as NaN.
#[test]
fn absurd_coordinates_are_refused() {
    let mut points = revolved(|_| 10.0, &[0.0, 5.0], 6.0, 6, 0.1);
    points[3].mm.x = 1e300;
    assert_all(&points, &[], "not_finite");
    assert_eq!(
        sphere::fit(&points),
        Err(FitError::OutOfRange {
            set: PointSet::Points,
            row: 3
        })
    );
}

#[test]
fn equal_points_coincide() {
    assert_all(&[Point::from_mm(1e4, -3.0, 0.1); 8], &[], "degenerate");
    // Equal up to the last digit of their coordinates, or to a picometre.
    let last_digit = |k: usize| {
        Point::from_mm(
            1e4 + 1.8e-12 * (k % 2) as f64,
            1e4,
            1.8e-12 * (k % 3) as f64,
        )
    };
    assert_all(
        &(0..8).map(last_digit).collect::<Vec<_>>(),
        &[],
        "degenerate",
    );
    let tiny = |k: usize| Point::from_mm(1e-310 * k as f64, 1e-310 * (k * k) as f64, 0.0);
    assert_all(&(0..8).map(tiny).collect::<Vec<_>>(), &[], "degenerate");
}

/// Six hits, but on three places: what is missing is said.
#[test]
fn repeated_points_do_not_count_twice() {
    let places = [[12.7, 0.0, 0.0], [0.0, 12.7, 0.0], [0.0, 0.0, 12.7]];
    let points: Vec<Point> = places
        .iter()
        .chain(&places)
        .map(|p| Point::from_array_mm(*p))
        .collect();
    let error = sphere::fit(&points).unwrap_err();
    let why = Degeneracy::Duplicates {
        distinct: 3,
        needed: 4,
    };
    assert_eq!(
        error,
        FitError::Degenerate {
            set: PointSet::Points,
            why
        }
    );
    assert!(error.to_string().contains("only 3 of 4"), "{error}");
    assert!(plane::fit(&points).is_ok());
}

#[test]
fn points_in_one_plane_make_no_space_figure() {
    let mut random = Random(1);
    for _ in 0..50 {
        let (rotation, shift) = (random.rotation(), random.normal3() * 1e4);
        let ring = revolved(|_| 10.0, &[0.0], 6.0, 9, 0.0);
        let ring = super::moved(&ring, &rotation, &shift);
        for (kind, result) in all_fits(&ring) {
            if ["sphere", "cylinder", "cylinder near", "cone", "cone near"].contains(&kind) {
                let why = Degeneracy::Coplanar;
                assert_eq!(
                    result,
                    Err(FitError::Degenerate {
                        set: PointSet::Points,
                        why
                    }),
                    "{kind}"
                );
            }
        }
        assert!(circle::fit(&ring).is_ok());
    }
}

#[test]
fn points_on_one_line_make_only_a_line() {
    let mut random = Random(2);
    for _ in 0..50 {
        let (at, along) = (random.normal3() * 1e4, random.direction());
        let points: Vec<Point> = (0..8)
            .map(|k| Point {
                mm: at + along * (3.0 * f64::from(k)),
            })
            .collect();
        assert_all(&points, &["line"], "degenerate");
        assert!(line::fit(&points).is_ok());
    }
}

/// The limit of "degenerate" is where [`crate::fit::SPREAD_LIMIT`] says.
#[test]
fn the_spread_limit_holds_on_both_sides() {
    let strip = |width: f64| {
        let row = |y: f64| (0..5).map(move |k| Point::from_mm(f64::from(k) * 25.0, y, 0.0));
        row(0.0).chain(row(width)).collect::<Vec<_>>()
    };
    // Spread along: sqrt(2 · 25² · 10); across: sqrt(10) width / 2.
    let width_at_limit = 1e-4 * libm::sqrt(2.0 * 625.0 * 10.0) * 2.0 / libm::sqrt(10.0);
    assert!(plane::fit(&strip(1.01 * width_at_limit)).is_ok());
    assert_eq!(
        plane::fit(&strip(0.99 * width_at_limit))
            .unwrap_err()
            .code(),
        "degenerate"
    );
}

/// A great circle with rounding noise, and with the noise of a real probe: the
/// radius would be known, but not the centre across the plane.
#[test]
fn a_great_circle_is_no_sphere() {
    let ring = revolved(|_| 10.0, &[0.0], core::f64::consts::TAU, 12, 0.0);
    let mut random = Random(3);
    let error = sphere::fit(&noisy(&ring, 1e-13, &mut random)).unwrap_err();
    assert_eq!(error.code(), "degenerate");
    let mut fitted = 0;
    for _ in 0..200 {
        match sphere::fit(&noisy(&ring, 1e-3, &mut random)) {
            Err(error) => {
                let codes = [
                    "ill_conditioned",
                    "cap_too_small",
                    "no_convergence",
                    "degenerate",
                ];
                assert!(codes.contains(&error.code()), "{error:?}");
            }
            // By luck of the residuals; then the covariance still tells.
            Ok(fit) => {
                fitted += 1;
                assert!(fit.center_uncertainty().unwrap()[2].0 > 0.1, "{fit:?}");
            }
        }
    }
    assert!(fitted < 10, "{fitted}");
}

/// A plate surface with noise is not a sphere of any radius: refused as too
/// small a cap, or because no minimum exists. A few look round by chance (with
/// eight degrees of freedom five sigma are not so rare); they are large then.
#[test]
fn a_noisy_plane_is_no_sphere() {
    let mut random = Random(4);
    let mut round = 0;
    for _ in 0..1000 {
        let sigma = libm::pow(10.0, random.between(-3.0, -1.0));
        let points: Vec<Point> = (0..12)
            .map(|_| Point::from_mm(random.between(0.0, 100.0), random.between(0.0, 100.0), 0.0))
            .collect();
        match sphere::fit(&noisy(&points, sigma, &mut random)) {
            Err(error) => {
                let codes = [
                    "cap_too_small",
                    "ill_conditioned",
                    "no_convergence",
                    "degenerate",
                ];
                assert!(codes.contains(&error.code()), "{error:?}");
            }
            Ok(fit) => {
                round += 1;
                assert!(fit.radius.0 > 1000.0, "{fit:?}");
            }
        }
    }
    assert!(round <= 10, "{round}");
}

/// How small a cap may be, for 1 µm of noise: 20 degrees of a 25.4 mm ball are
/// fitted, 1 degree is refused.
#[test]
fn a_cap_too_small_to_say_is_refused() {
    let mut random = Random(5);
    let mut cap = |degrees: f64| {
        let points: Vec<Point> = (0..50)
            .map(|_| {
                let polar = libm::sqrt(random.unit()) * (0.5 * degrees).to_radians();
                let around = random.between(0.0, core::f64::consts::TAU);
                let (s, c) = (libm::sin(polar), libm::cos(polar));
                Point {
                    mm: Vector3::new(s * libm::cos(around), s * libm::sin(around), c) * 12.7,
                }
            })
            .collect();
        noisy(&points, 1e-3, &mut random)
    };
    for _ in 0..50 {
        assert!(sphere::fit(&cap(20.0)).is_ok());
        assert_eq!(sphere::fit(&cap(1.0)).unwrap_err().code(), "cap_too_small");
    }
}

/// Eight corners of a box lie on three cylinders: no answer without a hint, the
/// right one of the three with it.
#[test]
fn ambiguous_cylinders_need_a_direction() {
    let corner = |k: i32| {
        Point::from_mm(
            f64::from(k & 1),
            f64::from(k >> 1 & 1) * 2.0,
            f64::from(k >> 2) * 3.0,
        )
    };
    let points: Vec<Point> = (0..8).map(corner).collect();
    let error = cylinder::fit(&points).unwrap_err();
    assert!(matches!(error, FitError::Ambiguous { .. }), "{error:?}");
    assert_eq!(error.code(), "ill_conditioned");
    for (axis, square) in [
        (Vector3::x(), 4.0 + 9.0),
        (Vector3::y(), 1.0 + 9.0),
        (Vector3::z(), 1.0 + 4.0),
    ] {
        let fit = cylinder::fit_near(&points, &axis).unwrap();
        assert!((fit.radius.0 - 0.5 * libm::sqrt(square)).abs() < 1e-14);
        assert!((fit.direction - axis).amax() < 1e-14);
    }
    assert_eq!(
        cylinder::fit_near(&points, &Vector3::zeros()),
        Err(FitError::NoDirection)
    );
    assert_eq!(
        cone::fit_near(&points, &Vector3::zeros()),
        Err(FitError::NoDirection)
    );
    assert_eq!(
        circle::fit_in_plane(&points, &Vector3::zeros()),
        Err(FitError::NoDirection)
    );
}

/// A cylinder is not a cone: its half angle cannot be told from zero.
#[test]
fn a_cylinder_is_no_cone() {
    let mut random = Random(6);
    let exact = revolved(|_| 10.0, &[0.0, 8.0, 20.0], core::f64::consts::TAU, 8, 0.2);
    assert_eq!(cone::fit(&exact).unwrap_err().code(), "ill_conditioned");
    for _ in 0..20 {
        let error = cone::fit(&noisy(&exact, 1e-3, &mut random)).unwrap_err();
        let uncertain = matches!(
            error,
            FitError::Uncertain {
                quantity: Quantity::HalfAngle,
                ..
            }
        );
        assert!(uncertain || error.code() == "ill_conditioned", "{error:?}");
    }
}

/// A sphere is not a cylinder: none of the directions is the right one.
#[test]
fn a_sphere_is_no_cylinder() {
    let mut random = Random(7);
    for _ in 0..20 {
        let points: Vec<Point> = (0..40)
            .map(|_| Point {
                mm: random.direction() * 12.7,
            })
            .collect();
        match cylinder::fit(&points) {
            Err(error) => assert_eq!(error.code(), "ill_conditioned"),
            // Uneven points may prefer one; then the residuals cannot be missed.
            Ok(fit) => assert!(fit.stats.rms.0 > 1.0),
        }
    }
}

/// The points as thick as wide have no plane, as wide as long no line.
#[test]
fn a_ball_of_points_has_no_plane_and_no_line() {
    let corner =
        |k: i32| Point::from_mm(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2));
    let cube: Vec<Point> = (0..8).map(corner).collect();
    for error in [
        plane::fit(&cube).unwrap_err(),
        line::fit(&cube).unwrap_err(),
    ] {
        assert!(matches!(error, FitError::Ambiguous { .. }), "{error:?}");
    }
}

/// The Hessian decides: a start on a maximum, where the gradient is zero too,
/// must not pass as a result.
#[test]
fn a_stationary_point_that_is_no_minimum_is_not_an_answer() {
    use crate::fit::solve::least_squares::{Surface, Term, minimise};

    /// One parameter, residuals p cos(x): stationary at x = 0, a maximum.
    #[derive(Clone, Copy)]
    struct Wave(f64);
    impl Surface<1> for Wave {
        fn term(&self, q: &Vector3<f64>) -> Option<Term<1>> {
            let (s, c) = (libm::sin(self.0), libm::cos(self.0));
            Some(Term {
                residual: q.x * c,
                gradient: [-q.x * s],
                second: [[-q.x * c]],
            })
        }
        fn moved(&self, [step]: &[f64; 1]) -> Option<Self> {
            Some(Self(self.0 + step))
        }
        fn magnitude(&self) -> f64 {
            1.0
        }
    }
    let points = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(2.0, 0.0, 0.0)];
    assert!(minimise(Wave(0.0), &points.iter().copied()).is_err());
    // From anywhere else it finds the minimum at a right angle.
    let found = minimise(Wave(0.3), &points.iter().copied()).ok().unwrap();
    assert!(
        libm::cos(found.surface.0).abs() < 1e-12,
        "{}",
        found.surface.0
    );
}

/// Messages end with what to do, and codes are the stable ones.
#[test]
fn every_error_says_what_to_do() {
    let set = PointSet::Points;
    let mut errors = vec![
        FitError::TooFewPoints {
            given: 3,
            needed: 4,
        },
        FitError::NotFinite { set, row: 0 },
        FitError::OutOfRange { set, row: 0 },
        FitError::IllConditioned {
            quantity: Quantity::Center,
            condition: 2e6,
            limit: 1e6,
        },
        FitError::Uncertain {
            quantity: Quantity::Direction,
            relative_uncertainty: 0.3,
            limit: 0.2,
        },
        FitError::CapTooSmall {
            relative_uncertainty: 0.3,
            limit: 0.2,
        },
        FitError::CapTooSmall {
            relative_uncertainty: f64::INFINITY,
            limit: 0.2,
        },
        FitError::Ambiguous {
            best_rms_mm: 1e-3,
            other_rms_mm: 2e-3,
        },
        FitError::NoDirection,
        FitError::NoConvergence { iterations: 200 },
        FitError::LengthMismatch {
            source: 3,
            target: 4,
        },
    ];
    for why in [
        Degeneracy::Coincident,
        Degeneracy::Duplicates {
            distinct: 2,
            needed: 4,
        },
        Degeneracy::Collinear,
        Degeneracy::Coplanar,
    ] {
        errors.push(FitError::Degenerate {
            set: PointSet::Target,
            why,
        });
    }
    let codes = [
        "too_few_points",
        "not_finite",
        "degenerate",
        "ill_conditioned",
        "cap_too_small",
        "no_convergence",
        "length_mismatch",
    ];
    for error in errors {
        assert!(codes.contains(&error.code()));
        let message = error.to_string();
        // "what is wrong: what to do", or the same with a semicolon.
        let (wrong, todo) = message
            .split_once(';')
            .or(message.rsplit_once(':'))
            .unwrap();
        assert!(wrong.len() > 15 && todo.len() > 10, "{message}");
        assert!(
            !message.contains("inf") && !message.contains("NaN"),
            "{message}"
        );
    }
}
