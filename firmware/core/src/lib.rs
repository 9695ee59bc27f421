//! The brain of openumi: what a board knows, without any board.
//!
//! No I/O, no clock, no heap: bytes and time come in as values, records go out
//! as values. The same code runs on every board and in `umi replay`, and gives
//! the same bits there (all transcendental functions come from `libm`).
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

pub mod brain;
pub mod button;
pub mod capture;
pub mod control;
pub mod correction;
mod decimal;
pub mod dprnt;
pub mod fit;
pub mod job;
pub mod journal;
pub mod point;
pub mod programs;
pub mod registration;
pub mod rewrite;
#[cfg(test)]
mod sentences;
pub mod trigger;
pub mod trust;
pub mod units;
pub mod zero_option;
