//! Drivers that boards share.
//!
//! They know no board: what they need of one comes through traits, as those of
//! `embedded-hal`, so each is tested on the host, with a model of its chip.
//!
//! | file | idea |
//! | --- | --- |
//! | [`latches`] | captures between an interrupt and the application |
//! | [`spi_nor`] | serial NOR flash for the journal and the settings |
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

pub mod latches;
pub mod spi_nor;
