//! Every message and record that enters or leaves an openumi board.
#![no_std]

#[cfg(test)]
extern crate std;

mod cobs;
pub mod decoder;
pub mod fault;
pub mod feature;
pub mod frame;
pub mod hello;
pub mod job;
pub mod line;
pub mod message;
pub mod pattern;
pub mod reason;
pub mod refusal;
pub mod schema;
pub mod verdict;

pub use schema::Schema;
