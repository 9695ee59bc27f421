//! How far mounts are from each other.

use umi_kinematics::Pose;

use crate::rigid::rotation_vector;

/// Mounts that are less apart are one: 0.05 mm, 0.03°.
pub(super) const APART: (f64, f64) = (0.05, 0.03);

/// How far one mount is from another: mm, degrees.
pub(super) fn apart(a: &Pose, b: &Pose) -> (f64, f64) {
    let turn = rotation_vector(&(a.rotation * b.rotation.transpose()));
    let shift = a.translation_mm - b.translation_mm;
    (shift.norm(), turn.norm().to_degrees())
}
