//! Boards: the same behaviour on the virtual one, in QEMU and on the emulated Pico.
//!
//! What all of them are asked is in [`conformance`]; the others are about one of them.

mod chatter;
mod conformance;
mod owner;
mod pico;
mod point_sensor;
mod qemu;
mod soak;
mod speeds;
mod virtual_board;
