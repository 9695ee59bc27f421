//! What stands in for hardware on a desk.
//!
//! * [`board`]: a virtual openumi board, the application of the firmware images in
//!   a thread of a host process.
//! * [`nc`]: a control's NC interpreter: part programs and custom macros in, motions
//!   and printed text out.
//! * [`cutting`]: what a tool path leaves on a workpiece.
//! * [`machine`]: the machine tool that carries them out: axes, encoders, probe.
//!
//! The control's serial port, the probe's skip line and the encoders of the machine
//! are the inputs of the board ([`machine::Wires`]).

pub mod board;
pub mod cutting;
pub mod machine;
pub mod nc;
pub mod scene;

pub use board::*;
