//! A point sensor in the spindle.

pub(super) mod digitize;
pub(super) mod points;
pub(super) mod serve;
