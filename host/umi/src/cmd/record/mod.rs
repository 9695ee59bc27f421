//! What was kept, and its proof.

pub(super) mod events;
pub(super) mod key;
pub(super) mod log;
pub(super) mod replay;
