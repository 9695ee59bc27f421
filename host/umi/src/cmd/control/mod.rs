//! What goes to a control: programs, corrections, and by what they are rewritten.

pub(super) mod basis;
pub(super) mod correction;
pub(super) mod dialects;
pub(super) mod nc;
pub(super) mod offsets;
pub(super) mod options;
pub(super) mod program;
pub(super) mod stated;
