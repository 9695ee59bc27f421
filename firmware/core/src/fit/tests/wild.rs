//! Any coordinates at all: an answer of numbers, or a refusal.

use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use nalgebra::Vector3;
use proptest::prelude::*;

use crate::fit::FitError;
use crate::fit::{circle, circle2d, cone, cylinder, line, plane, sphere};
use crate::units::Point;

/// Every fit of the same points: its kind, and its result as text or its error.
pub(super) fn all_fits(points: &[Point]) -> Vec<(&'static str, Result<String, FitError>)> {
    let z = Vector3::z();
    vec![
        ("sphere", sphere::fit(points).map(|f| format!("{f:?}"))),
        ("plane", plane::fit(points).map(|f| format!("{f:?}"))),
        ("line", line::fit(points).map(|f| format!("{f:?}"))),
        ("circle", circle::fit(points).map(|f| format!("{f:?}"))),
        (
            "circle in plane",
            circle::fit_in_plane(points, &z).map(|f| format!("{f:?}")),
        ),
        ("circle2d", circle2d::fit(points).map(|f| format!("{f:?}"))),
        ("cylinder", cylinder::fit(points).map(|f| format!("{f:?}"))),
        (
            "cylinder near",
            cylinder::fit_near(points, &z).map(|f| format!("{f:?}")),
        ),
        ("cone", cone::fit(points).map(|f| format!("{f:?}"))),
        (
            "cone near",
            cone::fit_near(points, &z).map(|f| format!("{f:?}")),
        ),
    ]
}

/// Coordinates as a broken line or a hostile file would bring them.
fn wild_coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => (-3_i32..=3).prop_map(f64::from),
        2 => -200.0..200.0_f64,
        1 => (-310_i32..=308).prop_map(|e| libm::pow(10.0, f64::from(e))),
        1 => any::<f64>(),
    ]
}

fn few_values() -> impl Strategy<Value = f64> {
    prop_oneof![
        (-2_i32..=2).prop_map(f64::from),
        Just(1e-7),
        Just(1e4),
        Just(1e4 + 1e-9)
    ]
}

fn assert_finite(points: &[Point]) -> Result<(), TestCaseError> {
    for (kind, result) in all_fits(points) {
        if let Ok(text) = result {
            prop_assert!(
                !text.contains("NaN") && !text.contains("inf"),
                "{kind} {text} {points:?}"
            );
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// No panic and no non-finite number, whatever the coordinates.
    #[test]
    fn wild_points_never_give_a_number_that_is_none(
        points in prop::collection::vec([wild_coordinate(), wild_coordinate(), wild_coordinate()], 0..9)
    ) {
        let points: Vec<Point> = points.into_iter().map(Point::from_array_mm).collect();
        assert_finite(&points)?;
    }

    /// The same where nearly every set is special: grids, repeats, tiny offsets.
    #[test]
    fn special_points_never_give_a_number_that_is_none(
        points in prop::collection::vec([few_values(), few_values(), few_values()], 0..12)
    ) {
        let points: Vec<Point> = points.into_iter().map(Point::from_array_mm).collect();
        assert_finite(&points)?;
    }
}

/// A coordinate whose square loses its digits is zero: the line goes through both points.
#[test]
fn a_coordinate_that_vanishes_in_its_square_does_not_turn_the_line() {
    let points = [[0.0, 0.0, 0.0], [-1.536_596_328_594_492_6e-159, 0.0, -1.0]];
    let points = points.map(Point::from_array_mm);
    assert_finite(&points).unwrap();
    let line = crate::fit::line::fit(&points).unwrap();
    assert_eq!(line.direction.map(f64::abs), nalgebra::Vector3::z());
    assert!(line.stats.rms.0 < 1e-150);
}
