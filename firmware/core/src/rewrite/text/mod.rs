//! A program as text: words, lengths, line ends, and a block that is written back.

pub(super) mod emit;
pub(super) mod length;
pub(super) mod line_ends;
pub(super) mod words;
