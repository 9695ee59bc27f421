//! What ways of the axes cost in time.

use nalgebra::Vector3;

use super::super::spec::ScanSpec;
use super::realise::Pass;

/// Rapid feed that times are reckoned with, mm/s.
pub const RAPID_MM_PER_S: f64 = 100.0;
/// Speed of rotary axes that times are reckoned with, degrees/s.
pub const TURN_DEG_PER_S: f64 = 30.0;

/// Way of the middle ray's point counts beside time: of two ways as fast, the shorter one, mm/s.
const POINT_MM_PER_S: f64 = 400.0;

/// Time of a straight way of all axes together, in seconds.
pub fn seconds(a: &[f64], b: &[f64], mm_per_s: f64) -> f64 {
    let way = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let turn = a[3..]
        .iter()
        .zip(&b[3..])
        .map(|(x, y)| (x - y).abs())
        .fold(0.0, f64::max);
    (way / mm_per_s).max(turn / TURN_DEG_PER_S)
}

/// Where a pass is entered or left.
#[derive(Clone)]
pub(super) struct LinkEnd {
    /// Values of the axes.
    pub axes: Vec<f64>,
    /// Place of the middle ray's point.
    pub point: Vector3<f64>,
}

/// What a link from one end to another costs, in seconds. An axis that `winds` goes the shorter way round.
pub(super) fn price(left: &LinkEnd, entered: &LinkEnd, winds: &[bool]) -> f64 {
    let pairs = || {
        left.axes
            .iter()
            .zip(&entered.axes)
            .map(|(a, b)| (a - b).abs())
    };
    let way = pairs().take(3).map(|d| d * d).sum::<f64>().sqrt();
    let mut time = way / RAPID_MM_PER_S;
    for (k, turn) in pairs().skip(3).enumerate() {
        let turn = if winds.get(k) == Some(&true) {
            (turn - 360.0 * (turn / 360.0).round()).abs()
        } else {
            turn
        };
        time = time.max(turn / TURN_DEG_PER_S);
    }
    time + (left.point - entered.point).norm() / POINT_MM_PER_S
}

/// Place of the middle ray's point at a pose of a pass.
pub(super) fn tip(spec: &ScanSpec, pass: &Pass, k: usize) -> Vector3<f64> {
    pass.poses[k].origin_mm + pass.poses[k].beam * spec.sensor.reference_mm
}
