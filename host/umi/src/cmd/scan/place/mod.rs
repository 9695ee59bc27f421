//! Where the part is, and where the finished part is best placed in it.

pub(super) mod faces;
pub(super) mod localise;
pub(super) mod placed;
pub(super) mod report;
pub(super) mod scans;
pub(super) mod simulate;
pub(super) mod stock;
pub(super) mod stock_page;
pub(super) mod transform;
