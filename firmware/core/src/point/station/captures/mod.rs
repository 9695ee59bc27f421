//! Captures joined with their latches, and what they come to: at rest, and in the cells of a way.

pub(super) mod collect;
mod noise;
pub(super) mod pairing;
pub(super) mod sweep;
