//! A control's NC interpreter: part programs and custom macros in, motions
//! ([`AxisDrives`]) and printed text out.
//!
//! ```text
//! text ─► program (split, loops paired) ─► run (block by block) ─► moves ─► AxisDrives
//!          cursor, expression, block         codes, calls, words     lines, arcs, cycles
//! ```
//!
//! A [`Control`] holds programs, variables and offsets as the memory of a real one does.
//! [`Control::load`] takes whole texts, also while a program runs: a correction that the
//! control reads replaces the program of its number. [`Control::step`] carries out one
//! block, [`check`] says what a control would complain about without running.
//!
//! What it does not know it refuses with an [`Alarm`]: no word is passed over. There is
//! no look-ahead: a block is complete before the next one is read.

mod check;
mod memory;
mod moves;
mod recorder;
mod run;
mod text;

#[cfg(test)]
mod tests;

pub use check::check;
pub use memory::alarm::{Alarm, Severity};
pub use memory::motion::{AxisDrives, AxisMotion, MotionPath, MotionRate, Skip, Trip};
pub use memory::offsets::{OffsetSystem, Offsets};
pub use memory::settings::{
    ControlFamily, ControlSettings, DecimalPoint, ExecutionLimits, LineEnd,
};
pub use recorder::Recorder;
pub use run::control::{BlockStep, Control, ProgramState};
pub use run::status::ControlStatus;
