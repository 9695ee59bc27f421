//! What moves: each kind of motion carried by the transform and rounded.

pub(super) mod arc;
pub(super) mod curve;
pub(super) mod cycle;
pub(super) mod motion;
pub(super) mod plain;
pub(super) mod plan;
