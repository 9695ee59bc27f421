//! The finished path, scanned: rays, boxes and planes, not assumptions.
//!
//! * [`samples`]: points of equal area.
//! * [`cells`]: points by where they lie.
//! * [`row`]: the path, row by row.
//! * [`see`]: which of them a path sees, and why not the others.
//! * [`on_machine`]: the scene in the frame in which it is looked at.
//! * [`figures`]: coverage, overlap, stand-off, tilt, clearance, limits of the rows as they are written.

pub mod cells;
pub mod figures;
pub mod on_machine;
pub mod row;
pub mod samples;
pub mod see;
