//! Axes along the runs: branches, poles, limits, what is touched, and the ways between.
//!
//! * [`axes`]: the axis values of a run, chosen over the whole run.
//! * [`realise`]: runs to passes that keep stand-off, tilt and clearance.
//! * [`links`]: safe ways between passes, over what is in the way.
//! * [`around`]: the same round its sides, and ways to the top of Z.
//! * [`order`]: in which order and sense passes are driven, and by which of their ways.
//! * [`price`]: what ways of the axes cost.
//! * `winding`: which way round each is driven and by how many whole turns, in that order.

pub mod around;
pub mod axes;
pub mod deadline;
pub mod links;
pub mod order;
pub mod price;
pub mod realise;
#[cfg(test)]
mod tests;
pub mod touch;
mod winding;
