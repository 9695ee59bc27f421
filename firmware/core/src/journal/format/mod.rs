//! How the journal lies in flash: sectors with a header, entries behind it, each with its link of
//! the chain.

pub(crate) mod chain;
pub(super) mod entry;
pub(super) mod layout;
pub(crate) mod sector;
