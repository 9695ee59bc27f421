//! Clouds: made smaller, carried to another format, held against the nominal.

pub(super) mod compare;
pub(super) mod convert;
pub(super) mod crop;
pub(super) mod filter;
pub(super) mod sample;
pub(super) mod thin;
