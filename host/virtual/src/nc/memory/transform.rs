//! From the coordinates of a program to those of the machine, and back.
//!
//! ```text
//! machine = length of the tool along Z
//!           + origin (external + G54.. + G52 + G92)
//!           + setting error (G54.4)( rotation (G68)( program ) )
//! ```
//!
//! The length is applied last: the spindle of a three-axis machine does not turn with
//! the workpiece.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

/// A rotation and a translation: `p -> turn p + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    pub turn: Matrix3<f64>,
    pub shift: Vector3<f64>,
}

impl Frame {
    pub fn shift(shift: Vector3<f64>) -> Self {
        Self {
            turn: Matrix3::identity(),
            shift,
        }
    }

    /// A rotation about an axis through a point, degrees; exact at multiples of 90.
    pub fn about(center: Vector3<f64>, axis: Unit<Vector3<f64>>, degrees: f64) -> Self {
        let turn = rotation(axis, degrees);
        Self {
            turn,
            shift: center - turn * center,
        }
    }

    /// Workpiece setting error: turned about X, then Y, then Z, then shifted. The axes
    /// are those of the work coordinate system. (Mazak's manual of `G54.4`: the angles
    /// are applied about X, Y and Z in that order, right-handed, the origin being that of
    /// the current work coordinates.)
    pub fn setting_error([dx, dy, dz, da, db, dc]: [f64; 6]) -> Self {
        Self {
            turn: rotation(Vector3::z_axis(), dc)
                * rotation(Vector3::y_axis(), db)
                * rotation(Vector3::x_axis(), da),
            shift: Vector3::new(dx, dy, dz),
        }
    }

    pub fn apply(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.turn * point + self.shift
    }

    /// The point of which this is the image.
    pub fn undo(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.turn.transpose() * (point - self.shift)
    }

    /// This frame inside another: first this, then that.
    pub fn inside(&self, outer: &Self) -> Self {
        Self {
            turn: outer.turn * self.turn,
            shift: outer.apply(self.shift),
        }
    }
}

/// Rotation about an axis, degrees; exact at multiples of 90 about X, Y and Z.
pub(crate) fn rotation(axis: Unit<Vector3<f64>>, degrees: f64) -> Matrix3<f64> {
    let turned = libm::fmod(degrees, 360.0);
    if turned == 0.0 {
        return Matrix3::identity();
    }
    let matrix = Rotation3::from_axis_angle(&axis, turned.to_radians()).into_inner();
    if libm::fmod(turned, 90.0) == 0.0 && axis.iter().any(|c| c.abs() == 1.0) {
        matrix.map(f64::round)
    } else {
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// There and back, and one inside another.
    #[test]
    fn frames() {
        let point = Vector3::new(1.0, 2.0, 3.0);
        let quarter = Frame::about(Vector3::new(1.0, 0.0, 0.0), Vector3::z_axis(), 90.0);
        assert_eq!(quarter.apply(point), Vector3::new(-1.0, 0.0, 3.0));
        assert_eq!(quarter.undo(quarter.apply(point)), point);
        let both = quarter.inside(&Frame::shift(Vector3::new(10.0, 0.0, 0.0)));
        assert_eq!(both.apply(point), Vector3::new(9.0, 0.0, 3.0));
    }

    /// The angles of a setting error: about X first, Z last.
    #[test]
    fn order_of_setting_errors() {
        let error = Frame::setting_error([1.0, 0.0, 0.0, 90.0, 0.0, 90.0]);
        // Y goes to Z (about X); Z stays (about Z); X goes to Y.
        assert_eq!(error.apply(Vector3::y()), Vector3::new(1.0, 0.0, 1.0));
        assert_eq!(error.apply(Vector3::x()), Vector3::new(1.0, 1.0, 0.0));
    }
}
