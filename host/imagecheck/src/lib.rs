//! What a linked Arm image takes: flash, static RAM, the worst stack, calls of panics.
//!
//! The figures come from the linked code itself, not from the source: what was inlined is
//! gone, and what the linker added is there. `cargo xtask size` prints them and holds them
//! against the budget of each board.

pub mod image;
pub mod load;
mod memory;
mod program;
pub mod reach;
pub mod stack;
mod thumb;
