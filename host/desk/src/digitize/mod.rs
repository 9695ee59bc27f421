//! A part digitized with a distance sensor: a program is written, and run on the virtual machine
//! with the station of the firmware between sensor and control.
//!
//! * `question`: what is asked for, each letter of the macro checked.
//! * [`program`]: the program for the control, as a shop would load it.
//! * [`run`]: the run, and what came of it.

mod program;
mod question;
mod run;
#[cfg(test)]
mod tests;

pub use program::program;
pub use question::{DigitizeQuestion, DigitizeRefusal, HeardBy, Strategy};
pub use run::{Digitized, DigitizedPlace, run};
