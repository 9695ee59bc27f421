//! A flat side alone: what tells it, and what it leaves free.

use nalgebra::{Matrix3, Vector6};

use crate::rigid::Vec3;
use crate::solve::eigen;

/// A scan shows one side if its normals spread less than this to all others, in squares.
const ONE_SIDE: f64 = 0.01;

/// The normal that all share, but for a few; none if they spread.
pub(in crate::localise) fn only_normal(normals: impl Iterator<Item = Vec3>) -> Option<Vec3> {
    let spread: Matrix3<f64> = normals.map(|normal| normal * normal.transpose()).sum();
    let (values, vectors) = eigen(&spread);
    (values[1] < ONE_SIDE * values[2]).then(|| vectors.column(2).into_owned())
}

/// What a flat side leaves free: both shifts along it, and the turn about its normal.
pub(in crate::localise) fn sliding(normal: &Vec3) -> Vec<Vector6<f64>> {
    let along = normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize();
    let across = normal.cross(&along);
    let shift = |v: &Vec3| Vector6::new(0.0, 0.0, 0.0, v.x, v.y, v.z);
    let turn = Vector6::new(normal.x, normal.y, normal.z, 0.0, 0.0, 0.0);
    vec![shift(&along), shift(&across), turn]
}
