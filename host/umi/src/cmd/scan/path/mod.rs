//! A scan path planned on the part, and the machine that drives it.

pub(super) mod kinematics;
pub(super) mod plan;
pub(super) mod verify;
