//! Bytes to lines, and lines to hits.

pub(super) mod block;
pub(super) mod hit;
pub(super) mod line_reader;
pub(super) mod line_splitter;
pub(super) mod program;
pub(super) mod sequence;
pub(super) mod sink;
