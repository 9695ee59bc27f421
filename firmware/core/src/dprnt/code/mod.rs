//! Characters: the codes in which a control writes.

pub(super) mod code_table;
pub(super) mod coding;
pub(super) mod encode;
