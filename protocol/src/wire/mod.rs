//! Messages as bytes on a pipe, and back.

mod cobs;
pub mod decoder;
pub mod envelope;
pub mod frame;
pub mod hello;
pub mod immediate;
