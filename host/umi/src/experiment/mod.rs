//! The experiment of A. Sawula's thesis (2013, chapters 4 and 5) on a desk: a plate
//! with three spheres and a workpiece is clamped five times, probed, registered, and
//! a fifth of the workpiece's surface finished in each clamping; then the whole
//! surface is measured.

pub mod cases;
mod ear;
pub mod outcome;
pub mod part;
pub mod path;
pub mod run;
pub mod thesis;
