//! A control's NC interpreter: part programs and custom macros in, motions
//! ([`AxisDrives`]) and printed text out.
//!
//! ```text
//! text ─► program (split, loops paired) ─► block (statement) ─► execute ─► Axes
//!          cursor, expression, oword        evaluate, words       motion, print
//! ```
//!
//! A [`Control`] holds programs, variables and offsets as the memory of a real one does.
//! [`Control::load`] takes whole texts, also while a program runs: a correction that the
//! control reads replaces the program of its number. [`Control::step`] carries out one
//! block, [`check`] says what a control would complain about without running.
//!
//! What it does not know it refuses with an [`Alarm`]: no word is passed over. There is
//! no look-ahead: a block is complete before the next one is read.

mod alarm;
mod arcs;
mod block;
mod calls;
mod check;
mod codes;
mod control;
mod coordinates;
mod cursor;
mod cycles;
mod dprnt;
mod evaluate;
mod execute;
mod expression;
mod linuxcnc;
mod modal;
mod motion;
mod offsets;
mod oword;
mod position;
mod probing;
mod program;
mod recorder;
mod settings;
mod statement;
mod status;
mod system;
mod transform;
mod variables;
mod words;

#[cfg(test)]
mod tests;

pub use alarm::{Alarm, Severity};
pub use check::check;
pub use control::{BlockStep, Control, ProgramState};
pub use motion::{AxisDrives, AxisMotion, MotionPath, MotionRate, Skip, Trip};
pub use offsets::{OffsetSystem, Offsets};
pub use recorder::Recorder;
pub use settings::{ControlFamily, ControlSettings, DecimalPoint, ExecutionLimits, LineEnd};
pub use status::ControlStatus;
