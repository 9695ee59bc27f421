//! Vectors about one axis.

use nalgebra::Vector3;
use umi_kinematics::branches;

/// An angle by whole turns within its limits, the one nearest to zero; else the limit that it is nearer to.
pub(super) fn within_or_limit(angle: f64, limits: [f64; 2]) -> f64 {
    branches::nearest_turn(angle, limits, 0.0).unwrap_or_else(|| {
        let off = |limit: f64| {
            let by = angle - limit;
            (by - 360.0 * (by / 360.0).round()).abs()
        };
        let [low, high] = limits;
        if off(low) <= off(high) { low } else { high }
    })
}

/// Vectors to be brought as near to one vector as turning about an axis can.
pub(super) struct Onto {
    axis: Vector3<f64>,
    /// That vector's part across the axis; none where it has none.
    across: Option<Vector3<f64>>,
}

impl Onto {
    pub(super) fn new(axis: &Vector3<f64>, w: &Vector3<f64>) -> Self {
        let across = w - axis * axis.dot(w);
        Onto {
            axis: *axis,
            across: (across.norm() >= 1e-9).then_some(across),
        }
    }

    /// Degrees that bring v there; none where one of both lies on the axis.
    pub(super) fn degrees(&self, v: &Vector3<f64>) -> Option<f64> {
        let axis = &self.axis;
        let a = v - axis * axis.dot(v);
        if a.norm() < 1e-9 {
            return None;
        }
        let b = self.across.as_ref()?;
        Some(axis.dot(&a.cross(b)).atan2(a.dot(b)).to_degrees())
    }
}

/// Degrees about `axis` that bring v as near to w as can be; none where one of both lies on the axis.
pub(super) fn best_about(axis: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> Option<f64> {
    Onto::new(axis, w).degrees(v)
}

/// A vector turned about an axis (Rodrigues).
pub(super) fn turned(axis: &Vector3<f64>, degrees: f64, v: &Vector3<f64>) -> Vector3<f64> {
    let (s, c) = degrees.to_radians().sin_cos();
    v * c + axis.cross(v) * s + axis * (axis.dot(v) * (1.0 - c))
}
