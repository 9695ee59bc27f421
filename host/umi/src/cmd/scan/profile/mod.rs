//! From a line scanner and a board to points.

pub(super) mod merge;
pub(super) mod pair;
pub(super) mod pose;
pub(super) mod record;
