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

pub mod access;
pub mod config;
pub mod job;
pub mod latch;
pub mod message;
pub mod point_sensor;
pub mod records;
pub mod schema;
pub mod update;
pub mod wire;

pub use job::{job_error, pattern, serial};
pub use records::{fault, feature, head, line, program, reason, verdict};
pub use schema::Schema;
pub use wire::{decoder, envelope, frame, hello, immediate};
