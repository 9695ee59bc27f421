//! Moving, scaling or reordering the points does the same to the answer.

use std::vec::Vec;

use nalgebra::{Rotation3, Unit, Vector3};
use proptest::prelude::*;

use super::{Random, moved, noisy, revolved};
use crate::fit::Statistics;
use crate::fit::{circle, cone, cylinder, line, plane, sphere};
use crate::units::Point;

/// A rigid motion of up to 1 m, and a scale.
#[derive(Debug, Clone)]
struct Change {
    rotation: Rotation3<f64>,
    shift: Vector3<f64>,
    scale: f64,
    /// Points that move from the front of the list to its end.
    roll: usize,
}

fn change() -> impl Strategy<Value = Change> {
    let axis = prop::array::uniform3(-1.0..1.0_f64)
        .prop_filter("an axis has a length", |a| Vector3::from(*a).norm() > 0.1);
    let shift = prop::array::uniform3(-1000.0..1000.0_f64);
    (axis, -3.1..3.1_f64, shift, 0.01..100.0_f64, 0_usize..100).prop_map(
        |(axis, angle, shift, scale, roll)| {
            let axis = Unit::new_normalize(Vector3::from(axis));
            Change {
                rotation: Rotation3::from_axis_angle(&axis, angle),
                shift: Vector3::from(shift),
                scale,
                roll,
            }
        },
    )
}

impl Change {
    fn apply(&self, points: &[Point]) -> Vec<Point> {
        let mut points = moved(points, &self.rotation, &self.shift);
        for point in &mut points {
            point.mm *= self.scale;
        }
        let n = points.len();
        points.rotate_left(self.roll % n);
        points
    }

    fn position(&self, p: Point) -> Vector3<f64> {
        (self.rotation * p.mm + self.shift) * self.scale
    }

    /// What rounding of the moved coordinates may do to a position, times 1000
    /// for the condition of the points.
    fn tolerance(&self) -> f64 {
        1e3 * 2000.0 * f64::EPSILON * self.scale
    }

    fn same_position(&self, before: Point, after: Point) -> Result<(), TestCaseError> {
        prop_assert!(
            (self.position(before) - after.mm).amax() < self.tolerance(),
            "{before:?} {after:?}"
        );
        Ok(())
    }

    fn same_length(&self, before: f64, after: f64) -> Result<(), TestCaseError> {
        prop_assert!(
            (before * self.scale - after).abs() < self.tolerance(),
            "{before} {after}"
        );
        Ok(())
    }

    fn same_axis(&self, before: Vector3<f64>, after: Vector3<f64>) -> Result<(), TestCaseError> {
        let cross = (self.rotation * before).cross(&after);
        prop_assert!(
            cross.amax() < self.tolerance() / self.scale,
            "{before:?} {after:?}"
        );
        Ok(())
    }

    fn same_statistics(
        &self,
        before: &Statistics,
        after: &Statistics,
    ) -> Result<(), TestCaseError> {
        prop_assert_eq!((before.n, before.dof), (after.n, after.dof));
        self.same_length(before.rms.0, after.rms.0)?;
        self.same_length(before.max_abs_residual.0, after.max_abs_residual.0)
    }
}

fn ball(seed: u64) -> Vec<Point> {
    let mut random = Random(seed);
    let points: Vec<Point> = (0..12)
        .map(|_| Point {
            mm: random.direction() * 12.7,
        })
        .collect();
    noisy(&points, 1e-3, &mut random)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn a_moved_sphere_is_the_sphere_moved(seed in any::<u64>(), change in change()) {
        let points = ball(seed);
        let (before, after) = (sphere::fit(&points).unwrap(), sphere::fit(&change.apply(&points)).unwrap());
        change.same_position(before.center, after.center)?;
        change.same_length(before.radius.0, after.radius.0)?;
        change.same_statistics(&before.stats, &after.stats)?;
        // The covariance of the radius has no direction and no size.
        prop_assert!((before.cov_unit[3][3] - after.cov_unit[3][3]).abs() < 1e-8);
    }

    #[test]
    fn a_moved_plane_is_the_plane_moved(seed in any::<u64>(), change in change()) {
        let mut random = Random(seed);
        let points: Vec<Point> = (0..9)
            .map(|k| Point::from_mm(f64::from(k % 3) * 100.0, f64::from(k / 3) * 80.0, 0.0))
            .collect();
        let points = noisy(&points, 0.01, &mut random);
        let (before, after) = (plane::fit(&points).unwrap(), plane::fit(&change.apply(&points)).unwrap());
        change.same_position(before.point, after.point)?;
        change.same_axis(before.normal, after.normal)?;
        change.same_statistics(&before.stats, &after.stats)?;
        prop_assert!((after.normal.dot(&after.point.mm) - after.offset.0).abs() < change.tolerance());
    }

    #[test]
    fn a_moved_line_is_the_line_moved(seed in any::<u64>(), change in change()) {
        let mut random = Random(seed);
        let points: Vec<Point> = (0..10).map(|k| Point::from_mm(f64::from(k) * 15.0, 0.0, 0.0)).collect();
        let points = noisy(&points, 0.02, &mut random);
        let (before, after) = (line::fit(&points).unwrap(), line::fit(&change.apply(&points)).unwrap());
        change.same_position(before.point, after.point)?;
        change.same_axis(before.direction, after.direction)?;
        change.same_statistics(&before.stats, &after.stats)?;
    }

    #[test]
    fn a_moved_circle_is_the_circle_moved(seed in any::<u64>(), change in change()) {
        let mut random = Random(seed);
        let points = noisy(&revolved(|_| 40.0, &[0.0], 4.0, 12, 0.0), 1e-3, &mut random);
        let (before, after) = (circle::fit(&points).unwrap(), circle::fit(&change.apply(&points)).unwrap());
        change.same_position(before.center, after.center)?;
        change.same_length(before.radius.0, after.radius.0)?;
        change.same_axis(before.normal, after.normal)?;
        change.same_statistics(&before.stats, &after.stats)?;
        change.same_length(before.rms_plane.0, after.rms_plane.0)?;
    }

    #[test]
    fn a_moved_cylinder_is_the_cylinder_moved(seed in any::<u64>(), change in change()) {
        let mut random = Random(seed);
        let points = noisy(&revolved(|_| 15.0, &[0.0, 20.0, 50.0], 5.0, 5, 0.3), 1e-3, &mut random);
        let (before, after) = (cylinder::fit(&points).unwrap(), cylinder::fit(&change.apply(&points)).unwrap());
        change.same_position(before.point, after.point)?;
        change.same_length(before.radius.0, after.radius.0)?;
        change.same_axis(before.direction, after.direction)?;
        change.same_statistics(&before.stats, &after.stats)?;
    }

    #[test]
    fn a_moved_cone_is_the_cone_moved(seed in any::<u64>(), change in change()) {
        let mut random = Random(seed);
        let points = noisy(&revolved(|z| 5.0 + 0.5 * z, &[0.0, 20.0, 50.0], 5.0, 6, 0.3), 1e-3, &mut random);
        let (before, after) = (cone::fit(&points).unwrap(), cone::fit(&change.apply(&points)).unwrap());
        change.same_position(before.apex, after.apex)?;
        change.same_axis(before.direction, after.direction)?;
        prop_assert!((change.rotation * before.direction).dot(&after.direction) > 0.0);
        prop_assert!((before.half_angle.0 - after.half_angle.0).abs() < 1e-9);
        change.same_statistics(&before.stats, &after.stats)?;
    }
}

/// `residual` of the result speaks of the same surface as the statistics.
#[test]
fn residuals_of_the_points_are_those_of_the_statistics() {
    let mut random = Random(9);
    let rms = |residuals: Vec<f64>| {
        let n = residuals.len() as f64;
        libm::sqrt(residuals.iter().map(|d| d * d).sum::<f64>() / n)
    };
    let shift = Vector3::new(300.0, -200.0, 1000.0);
    let place = |points: Vec<Point>, random: &mut Random| {
        let rotation = random.rotation();
        moved(&noisy(&points, 1e-2, random), &rotation, &shift)
    };
    for _ in 0..20 {
        let points = place(ball(3), &mut random);
        let fit = sphere::fit(&points).unwrap();
        assert!(
            (rms(points.iter().map(|p| fit.residual(*p).0).collect()) - fit.stats.rms.0).abs()
                < 1e-12
        );
        let points = place(revolved(|_| 40.0, &[0.0], 6.0, 12, 0.0), &mut random);
        let fit = circle::fit(&points).unwrap();
        assert!(
            (rms(points.iter().map(|p| fit.residual(*p).0).collect()) - fit.stats.rms.0).abs()
                < 1e-12
        );
        let fit = plane::fit(&points).unwrap();
        assert!(
            (rms(points.iter().map(|p| fit.residual(*p).0).collect()) - fit.stats.rms.0).abs()
                < 1e-12
        );
        let points = place(
            revolved(|_| 15.0, &[0.0, 20.0, 50.0], 5.0, 5, 0.3),
            &mut random,
        );
        let fit = cylinder::fit(&points).unwrap();
        assert!(
            (rms(points.iter().map(|p| fit.residual(*p).0).collect()) - fit.stats.rms.0).abs()
                < 1e-12
        );
        let points = place(
            revolved(|z| 5.0 + 0.5 * z, &[0.0, 20.0, 50.0], 5.0, 6, 0.3),
            &mut random,
        );
        let fit = cone::fit(&points).unwrap();
        assert!(
            (rms(points.iter().map(|p| fit.residual(*p).0).collect()) - fit.stats.rms.0).abs()
                < 1e-12
        );
        let points = place(
            (0..9)
                .map(|k| Point::from_mm(f64::from(k) * 9.0, 0.0, 0.0))
                .collect(),
            &mut random,
        );
        let fit = line::fit(&points).unwrap();
        assert!(
            (rms(points.iter().map(|p| fit.residual(*p).0).collect()) - fit.stats.rms.0).abs()
                < 1e-12
        );
    }
}
