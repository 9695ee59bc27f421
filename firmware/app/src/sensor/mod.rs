//! A distance sensor in the spindle: its line, its captures and its commands, joined.
//!
//! ```text
//! SensorPort ─► readings ─┐
//! latch ─────► captures ──┼─► sense ─► CaptureStation ─► records ─► measure: journal, host
//! measure ───► commands ──┘     └─► SensorPort: trigger, skip line    └─► answer ─► control
//! ```
//!
//! # Design
//!
//! Optional: a board that has a second port gives the application a [`PointStation`], a static
//! of its own; others pay for none of it. One task has the captures and works on what the others
//! leave in an inbox of a few instructions each. So a fit that holds all that was measured
//! delays an entry in the journal, and no capture.
//!
//! Records wait for the journal in a queue; what finds no room in it is counted, and the count
//! is a record, too.
//!
//! # Limitations
//!
//! Answers are served to controls that write 7- or 8-bit ASCII (ISO): EIA has no `#`.

mod inbox;
#[cfg(test)]
mod overload;
mod sense;

pub use inbox::PointStation;
pub(crate) use inbox::Told;
pub(crate) use sense::sense;
