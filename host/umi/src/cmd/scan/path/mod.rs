//! A scan path planned on the part, and the machine that drives it.

pub(super) mod drive;
pub(super) mod kinematics;
pub(super) mod plan;
mod plan_page;
pub(super) mod verify;
