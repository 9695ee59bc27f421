//! A rigid motion: a rotation and a shift.

use nalgebra::{Matrix3, Vector3};

/// Where a frame stands in another: `p_outer = rotation * p_inner + translation_mm`.
///
/// The rotation is a matrix, not a quaternion: a file's nine digits stay as they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Orthogonal, determinant +1.
    pub rotation: Matrix3<f64>,
    /// The inner frame's origin in the outer frame, in millimetres.
    pub translation_mm: Vector3<f64>,
}

/// The most by which `RᵀR` may miss the identity.
const ORTHOGONAL: f64 = 1e-6;

impl Pose {
    /// Both frames are the same.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation_mm: Vector3::zeros(),
        }
    }

    /// A shift alone.
    #[must_use]
    pub fn shift_mm(translation_mm: Vector3<f64>) -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation_mm,
        }
    }

    /// The right-handed turn by `angle_rad` about the line through `point_mm` along the
    /// unit vector `axis`.
    #[must_use]
    pub fn turn(axis: &Vector3<f64>, point_mm: &Vector3<f64>, angle_rad: f64) -> Self {
        let rotation = rotation_about(axis, angle_rad);
        Self {
            rotation,
            translation_mm: point_mm - rotation * point_mm,
        }
    }

    /// From the rows of a rotation matrix, if it is one.
    ///
    /// # Errors
    /// A sentence without subject ("is not …"): a number that is not finite, columns that
    /// are no orthogonal unit vectors within 1e-6, a left-handed frame.
    pub fn from_rows(rows: &[[f64; 3]; 3], translation_mm: &[f64; 3]) -> Result<Self, String> {
        let rotation = Matrix3::from_fn(|row, column| rows[row][column]);
        let translation_mm = Vector3::from(*translation_mm);
        if !rotation
            .iter()
            .chain(&translation_mm)
            .all(|v| v.is_finite())
        {
            return Err("has a number that is not finite".into());
        }
        let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
        if off > ORTHOGONAL {
            return Err(format!(
                "is no rotation: its columns miss unit length and right angles by {off:.2e} \
                 (at most 1e-6 is allowed)"
            ));
        }
        if rotation.determinant() < 0.0 {
            return Err("is a left-handed frame (determinant -1): reverse one of its axes".into());
        }
        Ok(Self {
            rotation,
            translation_mm,
        })
    }

    /// The rows of the rotation, as files have them.
    #[must_use]
    pub fn rows(&self) -> [[f64; 3]; 3] {
        std::array::from_fn(|row| std::array::from_fn(|column| self.rotation[(row, column)]))
    }

    /// `other` first, then this.
    #[must_use]
    pub fn after(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            translation_mm: self.rotation * other.translation_mm + self.translation_mm,
        }
    }

    /// The way back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation_mm: -(rotation * self.translation_mm),
        }
    }

    /// A point of the inner frame in the outer frame.
    #[must_use]
    pub fn point(&self, p_mm: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p_mm + self.translation_mm
    }

    /// A point of the outer frame in the inner one.
    #[must_use]
    pub fn undo(&self, q_mm: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&(q_mm - self.translation_mm))
    }

    /// The largest distance between the images of `points` by this pose and by `other`.
    #[must_use]
    pub fn apart_mm(&self, other: &Self, points: &[Vector3<f64>]) -> f64 {
        let apart = |p| (self.point(p) - other.point(p)).norm();
        points.iter().map(apart).fold(0.0, f64::max)
    }
}

/// Rodrigues' formula; `axis` has length 1.
fn rotation_about(axis: &Vector3<f64>, angle_rad: f64) -> Matrix3<f64> {
    let sin = angle_rad.sin();
    let cross = axis.cross_matrix();
    // 1 - cos as 2 sin², which keeps small angles exact.
    let half = (0.5 * angle_rad).sin();
    Matrix3::identity() + cross * sin + cross * cross * (2.0 * half * half)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_leaves_its_axis_where_it_is_and_turns_right_handed() {
        let point = Vector3::new(1.0, 2.0, 3.0);
        let turn = Pose::turn(&Vector3::z(), &point, std::f64::consts::FRAC_PI_2);
        let on_axis = point + Vector3::z() * 7.0;
        assert!((turn.point(&on_axis) - on_axis).norm() < 1e-14);
        let turned = turn.point(&(point + Vector3::x()));
        assert!((turned - (point + Vector3::y())).norm() < 1e-14);
    }

    #[test]
    fn the_way_back_undoes_the_way() {
        let pose = Pose::turn(
            &Vector3::new(0.6, 0.0, 0.8),
            &Vector3::new(10.0, -4.0, 2.0),
            1.234,
        )
        .after(&Pose::shift_mm(Vector3::new(5.0, 6.0, 7.0)));
        let p = Vector3::new(-3.0, 0.5, 11.0);
        assert!((pose.inverse().point(&pose.point(&p)) - p).norm() < 1e-13);
        assert!((pose.undo(&pose.point(&p)) - p).norm() < 1e-13);
        let away = (pose.point(&p) - p).norm();
        assert!((pose.apart_mm(&Pose::identity(), &[p]) - away).abs() < 1e-13);
    }

    #[test]
    fn a_frame_that_is_left_handed_skew_or_not_finite_is_refused() {
        let skew = [[1.0, 2e-6, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let left = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        let nan = [[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (rows, word) in [(skew, "1e-6"), (left, "left-handed"), (nan, "finite")] {
            let error = Pose::from_rows(&rows, &[0.0; 3]).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }
}
