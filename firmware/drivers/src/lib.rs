//! Drivers that boards share.
//!
//! They know no board: what they need of one comes through traits, as those of
//! `embedded-hal`, so they are tested on the host, with models of the chips (but for
//! USB, which has none).
//!
//! | file | idea |
//! | --- | --- |
//! | [`task_watchdog`] | every priority level must check in within its own time-out |
//! | [`latches`] | captures between an interrupt and the application |
//! | [`collector`] | the control's bytes by the line of text, from an interrupt |
//! | [`received`] | bytes between an interrupt and the application, losses in their place |
//! | [`selftest`] | what self-tests of boards share |
//! | [`spi_nor`] | serial NOR flash for the journal and the settings |
//! | [`usb_plug`] | when a board shows itself to a host |
//! | [`usb_serial`] | the host's port over USB |
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

pub mod collector;
pub mod latches;
pub mod received;
pub mod selftest;
pub mod spi_nor;
pub mod task_watchdog;
pub mod usb_plug;
pub mod usb_serial;
