//! A rigid transform: `q = R p + t`.

use nalgebra::{Matrix3, Vector3};

use crate::fit::solve::linalg::{norm, unit};
use crate::units::{Point, Rad};

/// A rotation followed by a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidTransform {
    /// Rotation matrix R, orthogonal with determinant +1.
    pub rotation: Matrix3<f64>,
    /// Translation t at the origin of the source frame, millimetres.
    pub translation_mm: Vector3<f64>,
}

impl RigidTransform {
    /// The transform that leaves every point where it is.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation_mm: Vector3::zeros(),
        }
    }

    /// From R by rows, as messages and files have it.
    #[must_use]
    pub fn from_rows(rotation: [[f64; 3]; 3], translation_mm: [f64; 3]) -> Self {
        let [x, y, z] = rotation;
        Self {
            rotation: Matrix3::from_rows(&[x.into(), y.into(), z.into()]),
            translation_mm: translation_mm.into(),
        }
    }

    /// The image `R p + t` of a point.
    #[must_use]
    pub fn apply(&self, p: Point) -> Point {
        Point {
            mm: self.rotate(&p.mm) + self.translation_mm,
        }
    }

    /// The image of a direction or difference: rotated, not translated.
    #[must_use]
    pub fn rotate(&self, v: &Vector3<f64>) -> Vector3<f64> {
        rotated(&self.rotation, v)
    }

    /// The transform back: `p = Rᵀ q - Rᵀ t`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation_mm: -rotated(&rotation, &self.translation_mm),
        }
    }

    /// The rotation about Z that is nearest to R in the least-squares sense, and the angle
    /// between the two Z axes, degrees: what a machinist sees.
    #[must_use]
    pub fn turn_and_tilt_deg(&self) -> (f64, f64) {
        let r = &self.rotation;
        let turn = libm::atan2(r.m21 - r.m12, r.m11 + r.m22);
        // atan2 and not acos(R33): acos loses half the digits of a small tilt.
        let tilt = libm::atan2(libm::sqrt(r.m13 * r.m13 + r.m23 * r.m23), r.m33);
        (turn.to_degrees(), tilt.to_degrees())
    }

    /// Angle of rotation, 0 to π, and its axis (right-handed). The axis is None
    /// if the angle is nothing but rounding.
    #[must_use]
    pub fn angle_axis(&self) -> (Rad, Option<Vector3<f64>>) {
        let Quaternion { w, v } = Quaternion::from_rotation(&self.rotation);
        // Both halves of the double cover mean the same rotation: take w >= 0.
        let v = if w < 0.0 { -v } else { v };
        let half_sine = norm(&v);
        let axis = if half_sine > 4.0 * f64::EPSILON {
            unit(&v)
        } else {
            None
        };
        (Rad(2.0 * libm::atan2(half_sine, w.abs())), axis)
    }
}

/// `R v`, written out: the same operations on every target.
pub(crate) fn rotated(rotation: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let m = rotation;
    Vector3::new(
        m.m11 * v.x + m.m12 * v.y + m.m13 * v.z,
        m.m21 * v.x + m.m22 * v.y + m.m23 * v.z,
        m.m31 * v.x + m.m32 * v.y + m.m33 * v.z,
    )
}

/// A unit quaternion, in which a rotation stays orthogonal to the last digit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quaternion {
    w: f64,
    v: Vector3<f64>,
}

impl Quaternion {
    /// From a rotation matrix (Shepperd, J. Guidance and Control 1, 1978: the
    /// largest component first, so that half turns lose no digits).
    pub(crate) fn from_rotation(r: &Matrix3<f64>) -> Self {
        let trace = r.m11 + r.m22 + r.m33;
        let (w, v) = if trace >= r.m11 && trace >= r.m22 && trace >= r.m33 {
            (
                1.0 + trace,
                Vector3::new(r.m32 - r.m23, r.m13 - r.m31, r.m21 - r.m12),
            )
        } else if r.m11 >= r.m22 && r.m11 >= r.m33 {
            let x = 1.0 + r.m11 - r.m22 - r.m33;
            (r.m32 - r.m23, Vector3::new(x, r.m12 + r.m21, r.m13 + r.m31))
        } else if r.m22 >= r.m33 {
            let y = 1.0 - r.m11 + r.m22 - r.m33;
            (r.m13 - r.m31, Vector3::new(r.m12 + r.m21, y, r.m23 + r.m32))
        } else {
            let z = 1.0 - r.m11 - r.m22 + r.m33;
            (r.m21 - r.m12, Vector3::new(r.m13 + r.m31, r.m23 + r.m32, z))
        };
        Self { w, v }.normalised()
    }

    /// This rotation followed by the small rotation vector `w` (radians).
    pub(crate) fn turned_by(&self, w: &Vector3<f64>) -> Self {
        // Exact direction, and exact to second order in the angle: enough for a
        // step of an iteration that ends with steps of rounding size.
        let turn = Self { w: 1.0, v: w * 0.5 }.normalised();
        Self {
            w: turn.w * self.w - turn.v.dot(&self.v),
            v: self.v * turn.w + turn.v * self.w + turn.v.cross(&self.v),
        }
        .normalised()
    }

    /// The rotation matrix.
    pub(crate) fn to_rotation(self) -> Matrix3<f64> {
        let Self { w, v } = self;
        let (x, y, z) = (v.x, v.y, v.z);
        Matrix3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        )
    }

    fn normalised(self) -> Self {
        let length = libm::sqrt(self.w * self.w + self.v.dot(&self.v));
        if length > 0.0 {
            Self {
                w: self.w / length,
                v: self.v / length,
            }
        } else {
            Self {
                w: 1.0,
                v: Vector3::zeros(),
            }
        }
    }
}
