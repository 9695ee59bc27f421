//! A laser line scanner on a machine with a tilting and turning table, as S2's (Paludo, "Laser
//! line scanner on a machine tool"): what is scanned is measured, and held against the truth.
//!
//! * [`station`]: the machine, its sensor and the board: stops of the axes to profiles to points.
//! * [`mount`]: the sensor's place, calibrated on a ball.
//! * [`washer`]: S2's washer in its three tests, tables 11 to 16.
//! * [`workpiece`]: the thesis' five-clamping workpiece, tables 5.1, 6.2 and 6.3.
//! * [`ball`]: a ball of 25.4 mm.
//! * [`edge`]: a block's edge, and where it is at several speeds.
//! * [`drive`]: a planned path over the virtual machine, to profiles and latches.

pub mod ball;
pub mod drive;
pub mod edge;
pub mod mount;
pub mod station;
#[cfg(test)]
mod tests;
pub mod washer;
pub mod workpiece;
