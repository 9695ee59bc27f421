//! Clouds: made smaller, carried to another format, held against the nominal, in figures and as a page.

pub(super) mod compare;
pub(super) mod convert;
pub(super) mod crop;
pub(super) mod deviation_page;
pub(super) mod filter;
mod limits;
pub(super) mod merged;
pub(super) mod report;
pub(super) mod sample;
pub(super) mod thin;

pub(super) use deviation_page::spread;
