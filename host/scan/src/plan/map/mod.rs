//! The surface laid flat: charts, and a conformal map of each.
//!
//! * [`chart`]: pieces without sharp edges that do not fold over.
//! * [`flatten`]: least squares conformal map with a free border, and how true it is.
//! * `overlap`: whether a map lies over itself.

pub mod chart;
pub mod flatten;
mod overlap;

pub use chart::Chart;
pub use flatten::FlatMap;
