//! A path as it stands in its file, row by row.

use super::super::machine::SensorPose;

/// A row of the path. Between rows all axes move linearly together.
#[derive(Debug, Clone)]
pub struct PathRow {
    /// Number of the pass, -1 for a link.
    pub pass: i32,
    /// Scanning.
    pub laser: bool,
    /// Values of the axes.
    pub axes: Vec<f64>,
    /// Pose of the sensor on the part.
    pub pose: SensorPose,
}
