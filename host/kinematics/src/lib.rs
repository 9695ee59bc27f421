//! A machine's axes as chains, and where they hold a sensor over a workpiece.
//!
//! ```text
//! p_workpiece = W⁻¹ · T_workpiece(q)⁻¹ · T_sensor(q) · X · p_sensor
//! ```
//!
//! * [`Pose`]: a rotation and a shift.
//! * [`Joint`]: one axis, linear or rotary, as a line in space; no Denavit-Hartenberg parameters.
//! * [`AxisChain`]: two chains of joints from the machine's base outwards, one carries the
//!   sensor, one the workpiece; with the sensor's mount X and the workpiece's W.
//! * [`branches`]: all angles that point a sensor along a beam and a line.
//! * [`AxisChain::parse`]: the machine file (TOML).
//!
//! Lengths are millimetres, rotary joint values degrees.

pub mod branches;
mod error;
mod file;
mod joint;
mod machine;
mod pose;

pub use error::MachineError;
pub use joint::{COLUMNS, Drive, Joint, JointKind};
pub use machine::AxisChain;
pub use pose::Pose;
