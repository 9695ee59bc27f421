//! The experiment of A. Sawula's thesis (2013, chapters 4 and 5) on a desk: a plate
//! with three spheres and a workpiece is clamped five times, probed, registered, and
//! a fifth of the workpiece's surface finished in each clamping; then the whole
//! surface is measured.
//!
//! | file | idea |
//! | --- | --- |
//! | `part`, `path` | the workpiece, and its finishing path as an NC program |
//! | `cases` | how the plate stands in the five clampings |
//! | `scene.toml`, `*.nc` | the machine with its errors; the probing programs |
//! | `ear` | where the machine's wires lead |
//! | `run` | one run, from the ring gauge to the measured surface |
//! | `outcome` | what it gives |
//! | `thesis` | what the thesis prints, for comparison |

pub mod cases;
mod ear;
pub mod outcome;
pub mod part;
pub mod path;
pub mod run;
pub mod thesis;
