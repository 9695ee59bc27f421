//! One line: what it is, what it carries, and the doubts that its digits raise.

pub mod checked;
pub(super) mod fields;
pub(super) mod number;
pub(super) mod pattern;
pub(super) mod raw_line;
pub(super) mod request;
pub(super) mod template;
