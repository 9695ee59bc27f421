//! Points to shapes and motions, without a board.

pub(super) mod fit;
pub(super) mod register;
mod suspect;
