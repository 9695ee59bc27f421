//! Serial NOR flash (W25Q and its like) as storage of the journal.
//!
//! # Design
//!
//! ```text
//!            areas()       ┌─ Area: journal ──► umi_core::journal::Journal
//!  SpiNor ──► Shared ──────┤
//!  one chip                └─ Area: settings ─► the application's settings
//! ```
//!
//! * A chip is known by its JEDEC id, or it is refused: its capacity, and that it
//!   understands the commands used here, follow from the id ([`FAMILIES`]).
//! * Every wait has a bound, about twice the longest time of the data sheets, and
//!   ends in [`FlashFault::Busy`]. A chip that is torn off answers all ones, which
//!   reads as busy; one that a reset of the processor has caught in the middle of
//!   an erase is waited for.
//! * Before each program and erase the write enable latch is read back, and after
//!   it the protection bits: a chip ignores what it may not do without a word.
//!   Whether the cells took it is read back by the journal itself.
//! * Areas lie one behind the other and cannot overlap: [`Shared::areas`] gives
//!   them all at once. They share the chip by a lock that nobody waits for: the
//!   application uses one area at a time, and [`FlashFault::InUse`] would say so if not.
//!
//! # Tradeoffs
//!
//! Crates exist, and none fits (looked at in 2026): `w25q32jv` 0.5 is maintained
//! and blocking, but its waits have no bound (a broken line would stop a board),
//! its capacity is a feature instead of what the chip says, and it wants the WP
//! and HOLD pins; `w25q` and `spi-memory` are for embedded-hal 0.2; `w25q-async`
//! and `is25lp128f` are async, which the journal's `Flash` is not. What is needed
//! here are ten commands.
//!
//! Commands with one data line and three address bytes only: what every chip of
//! every maker understands, at up to 33 MHz. A page takes 70 µs to transfer and
//! up to 3 ms to program, so more lines would not help.
//!
//! # Limitations
//!
//! * Of a chip larger than 16 MiB the first 16 MiB are used.
//! * Reading is `03h`: the bus must not be faster than the chip allows for that
//!   (33 MHz for most, 50 MHz for W25Q-JV).
//! * Erasing keeps the caller: 4 KiB typically 45 ms, at most 1 s until it is
//!   refused; 64 KiB 150 ms and 4 s. A watchdog must be more patient than that.

mod area;
mod chip;
mod fault;
#[cfg(test)]
mod model;
#[cfg(test)]
mod tests;

pub use area::{Area, Shared, Wanted};
pub use chip::{FAMILIES, Family, SectorSize, SpiNor};
pub use fault::FlashFault;
