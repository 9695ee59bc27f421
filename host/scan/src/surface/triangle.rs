//! A triangle of a mesh, and the box around points.

use crate::rigid::Vec3;

/// A triangle with its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// The corners in mm, counterclockwise seen from outside.
    pub corners: [Vec3; 3],
    /// The unit normal by the order of the corners.
    pub normal: Vec3,
    /// The area in mm².
    pub area_mm2: f64,
}

/// The least and the largest coordinates of `points`; (∞, −∞) for none.
pub(crate) fn bounds<'a>(points: impl Iterator<Item = &'a Vec3>) -> (Vec3, Vec3) {
    let none = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    points.fold(none, |(low, high), p| (low.inf(p), high.sup(p)))
}
