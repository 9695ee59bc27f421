//! A program as it is written: characters to words, expressions with their values, blocks, programs.

pub(super) mod block;
pub(super) mod cursor;
pub(super) mod dprnt;
pub(super) mod evaluate;
pub(super) mod expression;
pub(super) mod oword;
pub(super) mod program;
