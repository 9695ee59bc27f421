//! Where the sensor sits on the machine, and how a rotary axis lies, with their uncertainty.
//!
//! * [`observations`]: what was seen of planes and balls.
//! * [`sensor`]: the mount of the sensor; [`bar`]: ball bars beside their certificates.
//! * [`observe`]: what was seen, straight from a scan.
//! * [`poses`]: poses that determine a mount, and what to expect of them.
//! * [`misfit`]: whether the poses agree with one another, and what would bring them together.
//! * [`axis`]: the line of a rotary axis, from centres of balls that turn with it; [`observe::centres`]: these, straight
//!   from a scan.
//!
//! Before there is an answer, the solver asks whether the data determine it: a motion of the
//! mount that changes no residual is refused by name (`solve`), however small the residuals
//! are.

pub mod axis;
pub mod bar;
mod features;
pub mod misfit;
mod naming;
pub mod observations;
pub mod observe;
pub mod poses;
pub mod sensor;
mod shapes;
mod solve;
