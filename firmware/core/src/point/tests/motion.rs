//! Moving, turning, mirroring or reordering a set does the same to the answer.

use nalgebra::{Rotation3, Unit, Vector3};
use proptest::prelude::*;

use super::super::{PointQuestion, calibrate};
use super::{ball, noisy, sensor, set};
use crate::fit::tests::Random;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn a_moved_machine_has_the_moved_sensor(
        axis in prop::array::uniform3(-1.0..1.0_f64).prop_filter("a length", |a| Vector3::from(*a).norm() > 0.1),
        angle in -3.1..3.1_f64,
        shift in prop::array::uniform3(-1000.0..1000.0_f64),
        roll in 0_usize..30,
        seed in 0_u64..1000,
    ) {
        let readings = noisy(&set(&sensor(), &ball(), 30, 5.0), &sensor(), &ball(), 1e-3, &mut Random(seed));
        let wanted = PointQuestion::default();
        let before = calibrate(&readings, &[ball()], &wanted).unwrap();
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::from(axis)), angle);
        let shift = Vector3::from(shift);
        let mut moved_readings = readings.clone();
        for reading in &mut moved_readings {
            reading.axes.mm = turn * reading.axes.mm + shift;
        }
        moved_readings.rotate_left(roll);
        let mut moved_ball = ball();
        moved_ball.center.mm = turn * moved_ball.center.mm + shift;
        let wanted = PointQuestion { direction: turn * wanted.direction, ..wanted };
        let after = calibrate(&moved_readings, &[moved_ball], &wanted).unwrap();
        prop_assert!((turn * before.sensor.offset.mm - after.sensor.offset.mm).amax() < 1e-8);
        prop_assert!((turn * before.sensor.direction - after.sensor.direction).amax() < 1e-10);
        prop_assert!((before.stats.rms.0 - after.stats.rms.0).abs() < 1e-11);
        prop_assert!((trace(&before.cov_unit) / trace(&after.cov_unit) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_scaled_set_has_the_scaled_sensor(scale in 0.1..10.0_f64, seed in 0_u64..1000) {
        let readings = noisy(&set(&sensor(), &ball(), 20, 5.0), &sensor(), &ball(), 1e-3, &mut Random(seed));
        let before = calibrate(&readings, &[ball()], &PointQuestion::default()).unwrap();
        let mut larger = readings.clone();
        for reading in &mut larger {
            reading.axes.mm *= scale;
            reading.gamma.0 *= scale;
        }
        let mut larger_ball = ball();
        larger_ball.center.mm *= scale;
        larger_ball.radius.0 *= scale;
        let after = calibrate(&larger, &[larger_ball], &PointQuestion::default()).unwrap();
        prop_assert!((before.sensor.offset.mm * scale - after.sensor.offset.mm).amax() < 1e-8 * scale.max(1.0));
        prop_assert!((before.sensor.direction - after.sensor.direction).amax() < 1e-10);
    }
}

fn trace(matrix: &[[f64; 7]; 7]) -> f64 {
    matrix
        .iter()
        .enumerate()
        .fold(0.0, |sum, (k, row)| sum + row[k])
}
