//! Rotations, and the small steps that a solver makes.

use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};
pub use umi_kinematics::Pose;

/// A place or a direction in space; places in mm.
pub type Vec3 = Vector3<f64>;

/// Nothing of a scan lies farther out, in mm: it would be another unit, or none, and what is summed of its squares be lost.
pub const FARTHEST_MM: f64 = 1e9;

/// Whether a place is one that can be reckoned with.
#[must_use]
pub fn is_in_reach(p: &Vec3) -> bool {
    // NaN is not.
    p.iter().all(|x| x.abs() <= FARTHEST_MM)
}

/// `motion`, then the small motion `step` (rotation vector, translation) about `pivot`. R stays orthonormal.
#[must_use]
pub fn stepped(motion: &Pose, step: &Vector6<f64>, pivot: &Vec3) -> Pose {
    let turn = rotation(&Vec3::new(step[0], step[1], step[2]));
    let shift = Vec3::new(step[3], step[4], step[5]);
    Pose {
        rotation: orthonormal(&(turn * motion.rotation)),
        translation_mm: turn * (motion.translation_mm - pivot) + pivot + shift,
    }
}

/// Of the rows of R and t, as files have them: orthonormal to what six printed digits leave, and made so to the last
/// bit. None if the rows mirror, or are no rotation.
#[must_use]
pub fn pose_of_rows(rows: &[[f64; 3]; 3], translation_mm: &[f64; 3]) -> Option<Pose> {
    let rotation = Matrix3::from_fn(|i, k| rows[i][k]);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    let fits =
        off < 1e-5 && rotation.determinant() > 0.0 && translation_mm.iter().all(|x| x.is_finite());
    fits.then(|| Pose {
        rotation: orthonormal(&rotation),
        translation_mm: Vec3::from(*translation_mm),
    })
}

/// The rotation by the vector `w`: about its direction, by its length in rad (Rodrigues).
#[must_use]
pub fn rotation(w: &Vec3) -> Matrix3<f64> {
    let angle = w.norm();
    let k = w.cross_matrix();
    // sin(x)/x and (1-cos x)/x², by their series where the quotients lose digits.
    let (a, b) = if angle < 1e-4 {
        let x2 = angle * angle;
        (1.0 - x2 / 6.0, 0.5 - x2 / 24.0)
    } else {
        let half = (angle / 2.0).sin() / angle;
        (angle.sin() / angle, 2.0 * half * half)
    };
    Matrix3::identity() + k * a + k * k * b
}

/// The rotation vector of `r`: the inverse of [`rotation`], its length in 0..=π.
#[must_use]
pub fn rotation_vector(r: &Matrix3<f64>) -> Vec3 {
    let skew = Vec3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    ) / 2.0;
    let (sine, cosine) = (skew.norm(), (r.trace() - 1.0) / 2.0);
    let angle = sine.atan2(cosine);
    if angle < 1e-9 {
        return skew;
    }
    if sine > 1e-5 || cosine > 0.0 {
        return skew * (angle / sine);
    }
    // Near half a turn: the axis is the longest column of (R + 1) / 2.
    let m = (r + Matrix3::identity()) / 2.0;
    let axis = (0..3)
        .map(|i| m.column(i).into_owned())
        .max_by(|a, b| a.norm().total_cmp(&b.norm()))
        .unwrap_or_else(Vec3::x);
    let axis = axis / axis.norm().max(1e-300);
    if axis.dot(&skew) < 0.0 {
        axis * -angle
    } else {
        axis * angle
    }
}

/// `r` without the rounding that many products have left in it: two steps of Newton's iteration to the nearest rotation.
#[must_use]
pub fn orthonormal(r: &Matrix3<f64>) -> Matrix3<f64> {
    let mut r = *r;
    for _ in 0..2 {
        r = r * (Matrix3::identity() * 1.5 - r.tr_mul(&r) * 0.5);
    }
    r
}

/// A matrix by rows, as files have it.
#[must_use]
pub fn rows<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<Vec<f64>> {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_vector_comes_back() {
        for w in [
            Vec3::new(1e-7, -2e-7, 3e-7),
            Vec3::new(0.3, -0.2, 1.0),
            Vec3::new(0.0, std::f64::consts::PI - 1e-7, 0.0),
            Vec3::new(-2.0, 1.0, 1.5),
        ] {
            let back = rotation_vector(&rotation(&w));
            assert!((back - w).norm() < 1e-8, "{w} {back}");
        }
    }
}
