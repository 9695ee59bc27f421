//! What the mount's uncertainty makes of a point's.

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use umi_kinematics::AxisChain;

/// The standard uncertainty of the points' places by that of the mount: the root of the sum of the
/// variances along x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MountUncertainty {
    /// The root mean square over all points.
    pub rms_mm: f64,
    /// The greatest.
    pub max_mm: f64,
}

/// Adds it up over the points.
pub(super) struct MountShare {
    turn: Matrix3<f64>,
    rotation: Matrix3<f64>,
    /// With `e = w × arm + t`, `E|e|²` is this, twice `mixed · arm`, and `armᵀ · turned · arm`.
    shift: f64,
    mixed: Vector3<f64>,
    points: u64,
    sum: f64,
    greatest: f64,
}

impl MountShare {
    /// None where the machine file does not say how uncertain the mount is.
    pub fn of(machine: &AxisChain) -> Option<Self> {
        let c = machine.sensor_covariance.as_ref()?;
        let turns = Matrix3::from_fn(|i, k| c[i][k]);
        // Of t and w: E[t × w].
        let both = Matrix3::from_fn(|i, k| c[3 + i][k]);
        Some(Self {
            turn: Matrix3::identity() * turns.trace() - turns,
            rotation: machine.sensor.rotation,
            shift: c[3][3] + c[4][4] + c[5][5],
            mixed: Vector3::new(
                both[(1, 2)] - both[(2, 1)],
                both[(2, 0)] - both[(0, 2)],
                both[(0, 1)] - both[(1, 0)],
            ),
            points: 0,
            sum: 0.0,
            greatest: 0.0,
        })
    }

    /// Takes a point of a profile, in the sensor's frame; its standard uncertainty in mm.
    pub fn take(&mut self, seen_mm: &Vector3<f64>) -> f64 {
        let arm = self.rotation * seen_mm;
        let variance = self.shift + 2.0 * self.mixed.dot(&arm) + arm.dot(&(self.turn * arm));
        self.points += 1;
        self.sum += variance;
        self.greatest = self.greatest.max(variance);
        variance.max(0.0).sqrt()
    }

    /// None without points.
    pub fn finish(&self) -> Option<MountUncertainty> {
        (self.points > 0).then(|| MountUncertainty {
            rms_mm: (self.sum / self.points as f64).max(0.0).sqrt(),
            max_mm: self.greatest.sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x6, Matrix6};

    /// Beside the plain law: the trace of `A C Aᵀ` with `A = [-[arm]×, 1]`.
    #[test]
    fn a_points_variance_is_that_of_the_plain_law() {
        let half = Matrix6::from_fn(|i, k| ((3 * i + 5 * k) as f64).sin());
        let c = half * half.transpose();
        let mut machine = AxisChain::parse("[chain]\nsensor = []\n").unwrap();
        machine.sensor_covariance =
            Some(std::array::from_fn(|i| std::array::from_fn(|k| c[(i, k)])));
        machine.sensor.rotation = crate::rigid::rotation(&Vector3::new(0.3, -1.0, 0.5));
        let mut share = MountShare::of(&machine).unwrap();
        let seen = Vector3::new(12.0, 0.0, -7.5);
        let of_the_point = share.take(&seen);
        let arm = machine.sensor.rotation * seen;
        let mut a = Matrix3x6::zeros();
        a.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-arm.cross_matrix());
        a.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        let expected = (a * c * a.transpose()).trace().sqrt();
        let found = share.finish().unwrap();
        assert!((found.rms_mm / expected - 1.0).abs() < 1e-12);
        assert_eq!(found.rms_mm, found.max_mm);
        assert_eq!(of_the_point, found.max_mm);
    }
}
