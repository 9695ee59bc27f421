//! Every message and record that enters or leaves an openumi board.
#![no_std]

pub mod fault;
pub mod pattern;
