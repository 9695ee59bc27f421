//! Stand-ins for hardware on a desk.
//!
//! * [`board`]: a virtual openumi board, the application of the firmware images in
//!   a thread of a host process.
//! * [`nc`]: a control's NC interpreter: part programs and custom macros in, motions
//!   and printed text out.
//! * [`machine`]: the machine tool that carries them out: axes, encoders, probe.
//! * [`sensor`]: a distance sensor in its spindle.
//! * [`scanner`]: a laser line scanner on its axes.
//! * [`station`]: the board between that sensor and the control.
//! * [`scene`]: what stands on the machine's table.
//! * [`cutting`]: what a tool path leaves on a workpiece.
//! * [`cell`]: a control in front of its machine.
//!
//! The control's serial port, the probe's skip line and the encoders of the machine
//! are the inputs of the board ([`machine::Wires`]).

pub mod board;
pub mod cell;
pub mod cutting;
pub mod machine;
pub mod nc;
pub mod random;
pub mod scanner;
pub mod scene;
pub mod sensor;
pub mod station;

pub use board::*;
