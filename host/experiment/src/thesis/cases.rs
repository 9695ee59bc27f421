//! The five clampings.

use nalgebra::{Matrix3, Vector3};
use umi_core::registration::RigidTransform;
use umi_core::units::Rad;

use super::printed;

/// One clamping.
#[derive(Clone, Debug)]
pub struct ExperimentCase {
    /// Its name, as "Case 1".
    pub title: String,
    /// How the plate stands, in words.
    pub about: String,
    /// From the reference clamping to this one, machine coordinates.
    pub pose: RigidTransform,
}

/// Turn about Z in degrees and shift in X in millimetres of the cases (thesis,
/// section 4.3).
const CASES: [(f64, f64, &str); 5] = [
    (0.0, 0.0, "nominal clamping: it is taught"),
    (1.0, 0.0, "turned by +1 degree about Z"),
    (-1.0, 16.0, "turned by -1 degree, moved by +16 mm in X"),
    (1.0, -48.0, "turned by +1 degree, moved by -48 mm in X"),
    (-2.0, -35.0, "turned by -2 degrees, moved by -35 mm in X"),
];

/// The clampings as the thesis' text states them (section 4.3): turned about the
/// machine's Z axis, then moved along X.
#[must_use]
pub fn stated() -> Vec<ExperimentCase> {
    CASES
        .iter()
        .enumerate()
        .map(|(number, (degrees, shift_mm, about))| {
            let (sin, cos) = Rad::from_degrees(*degrees).0.sin_cos();
            ExperimentCase {
                title: format!("Case {number}"),
                about: (*about).into(),
                pose: RigidTransform {
                    rotation: Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0),
                    translation_mm: Vector3::new(*shift_mm, 0.0, 0.0),
                },
            }
        })
        .collect()
}

/// The clampings that the thesis' registrations say (table 4.2): R and T as printed,
/// R made orthonormal.
#[must_use]
pub fn printed() -> Vec<ExperimentCase> {
    let mut cases = stated();
    for (case, printed) in cases.iter_mut().skip(1).zip(&printed::REGISTRATIONS) {
        let turn = Matrix3::from_fn(|row, column| printed.rotation[row][column]);
        // Four printed decimals leave R orthonormal to 1e-4: Gram and Schmidt do.
        let x = turn.row(0).transpose().normalize();
        let y = turn.row(1).transpose();
        let y = (y - x * x.dot(&y)).normalize();
        let z = x.cross(&y);
        case.pose = RigidTransform {
            rotation: Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]),
            translation_mm: Vector3::from(printed.translation_mm),
        };
        let [x, y, _] = printed.translation_mm;
        let degrees = case.pose.rotation.m21.atan2(case.pose.rotation.m11);
        case.about = format!(
            "table 4.2: turned by {:+.3} degrees, moved by {x:+.3} mm in X, {y:+.3} mm in Y",
            degrees.to_degrees()
        );
    }
    cases
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pose is rigid; the printed ones are those of table 4.2 to its digits.
    #[test]
    fn poses_are_rigid() {
        for case in stated().into_iter().chain(printed()) {
            let r = case.pose.rotation;
            assert!((r * r.transpose() - Matrix3::identity()).norm() < 1e-12);
            assert!((r.determinant() - 1.0).abs() < 1e-12);
        }
        for (case, printed) in printed().iter().skip(1).zip(&printed::REGISTRATIONS) {
            for (row, digits) in printed.rotation.iter().enumerate() {
                for (column, digit) in digits.iter().enumerate() {
                    let off = case.pose.rotation[(row, column)] - digit;
                    assert!(off.abs() < 2.1e-4, "{} {off}", case.title);
                }
            }
        }
        let (angle, axis) = stated()[4].pose.angle_axis();
        assert!((angle.to_degrees() - 2.0).abs() < 1e-12);
        assert!(axis.unwrap().z < -0.999);
    }
}
