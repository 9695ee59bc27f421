//! Courses: the lines on the surface that the middle ray follows.
//!
//! * [`field`]: a height over a chart whose level lines are the courses, and how far apart they may lie.
//! * [`along_line`]: heights for machines whose line follows from the beam.
//! * [`level`]: level lines as polylines on the surface.
//! * [`run`]: polylines as points with normals, as close as the steps must be.

pub mod along_line;
pub mod field;
pub mod level;
pub mod run;

pub use super::laser_run::{LaserRun, RunPoint};
pub use field::{HeightField, Spacing};
