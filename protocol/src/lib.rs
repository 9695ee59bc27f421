//! Every message and record that enters or leaves an openumi board.
#![no_std]
#![cfg_attr(
    not(test),
    warn(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[cfg(test)]
extern crate std;

mod cobs;
pub mod decoder;
pub mod envelope;
pub mod fault;
pub mod feature;
pub mod frame;
pub mod head;
pub mod hello;
pub mod immediate;
pub mod job;
pub mod job_error;
pub mod latch;
pub mod line;
pub mod message;
pub mod pattern;
pub mod program;
pub mod reason;
pub mod schema;
pub mod serial;
pub mod verdict;

pub use schema::Schema;
