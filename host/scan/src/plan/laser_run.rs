//! A piece of a course as it is driven: what courses make, and drives follow.

use nalgebra::Vector3;

/// A point for the middle ray.
#[derive(Debug, Clone, Copy)]
pub struct RunPoint {
    /// On the surface.
    pub at: Vector3<f64>,
    /// Outward, smoothed along the run.
    pub normal: Vector3<f64>,
    /// Direction of the run, smoothed, across the normal.
    pub along: Vector3<f64>,
}

/// A piece of a course, driven with the laser on.
#[derive(Debug, Clone)]
pub struct LaserRun {
    /// At least two.
    pub points: Vec<RunPoint>,
    /// Direction of the border at its beginning and end.
    pub borders: [Vector3<f64>; 2],
}
