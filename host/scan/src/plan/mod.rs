//! A scan path on the part's surface, for the machine that will drive it.
//!
//! * [`spec`]: part, sensor, wishes and machine, read from TOML.
//! * [`machine`]: axis values to the sensor's pose on the part, and back with all branches.
//! * [`poses`]: the same for lists of poses, as `umi scan kinematics` gives them.
//! * [`mesh`]: the part as triangles that know their neighbours.
//! * [`map`]: charts, each laid flat by a conformal map.
//! * [`course`]: lines on the surface that the middle ray follows.
//! * [`drive`]: axis values along the lines, and the ways between.
//! * [`proof`]: what a finished path sees.
//! * [`planner`]: all of it, from a mesh to a proved path.
//! * [`program`]: a path as a program for a control.
//! * [`verify`]: any path, proved.

pub mod course;
pub mod drive;
mod laser_run;
pub mod machine;
pub mod map;
pub mod mesh;
pub mod planner;
pub mod poses;
pub mod program;
pub mod proof;
pub mod spec;
#[cfg(test)]
mod tests;
pub mod verify;
