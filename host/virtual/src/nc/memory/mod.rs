//! What a control holds: its settings, offsets, variables, modal words, and what it tells of faults and motions.

pub(super) mod alarm;
pub(super) mod modal;
pub(super) mod motion;
pub(super) mod offsets;
pub(super) mod settings;
pub(super) mod transform;
pub(super) mod variables;
