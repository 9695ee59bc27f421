//! Cutting: the surface that a tool leaves on a workpiece.
//!
//! The workpiece is a height field in a frame of its own ([`Workpiece`]); where that
//! frame stands in the machine is its pose, which changes from clamping to clamping.
//! A [`Cutter`] is a machine with workpiece: it passes every motion on to the machine
//! under it and takes away what a ball-nose tool sweeps on the way. Afterwards the
//! surface is compared with the nominal one ([`SurfaceDeviations`]), as a scan of the
//! finished part is.
//!
//! A swept ball is a capsule, and a capsule's lower side above a point of the grid is
//! known in closed form ([`Capsule`]): heights are exact at the nodes, nothing is
//! sampled along the path. Arcs are cut as chords that leave them by no more than
//! [`CHORD_ERROR_MM`].
//!
//! Not modelled: forces, deflection, the tool's run-out and its shank (only the ball
//! cuts), undercuts (a height field has none).

mod capsule;
mod cutter;
mod deviation;
mod sweep;
mod wander;
mod workpiece;

pub use capsule::Capsule;
pub use cutter::{BallNose, Crash, CrashCause, Cutter};
pub use deviation::{DeviationStatistics, SurfaceDeviations, laid_on};
pub use sweep::CHORD_ERROR_MM;
pub use wander::Wander;
pub use workpiece::{CylinderArc, Grid, GridFault, Removed, Workpiece};

#[cfg(test)]
mod tests;
