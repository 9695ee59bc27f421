//! What the control and the sensor write, and what the control is answered.

mod answer;
mod buffer;
mod command;
pub(super) mod text;

pub use answer::{ANSWER_BYTES, ANSWER_PROGRAM, CommandAnswer};
pub use command::{CommandFault, CommandLine, SensorCommand, SensorConfiguration, check_value};
pub use text::{NumberedReading, ReadingText, SignalLoss};
