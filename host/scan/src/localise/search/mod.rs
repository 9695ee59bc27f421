//! A search without a first guess: scan and model become oriented points, pairs of which vote for
//! poses.

pub(super) mod field;
pub(super) mod oriented;
pub(super) mod pairs;
pub(super) mod rough;
pub(super) mod scene;
pub(super) mod walls;
