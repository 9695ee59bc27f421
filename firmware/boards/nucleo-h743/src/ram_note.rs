//! A number in the RAM that a reset leaves.

use core::cell::UnsafeCell;

/// As wide as the widest check value of the chip's memories is for (RM0433, 2.4 and 3.3): a narrower
/// write is read, changed and kept in a buffer until another is written, and a reset meanwhile loses
/// it. In the DTCM (`memory.x`), which no cache stands before.
#[repr(C, align(8))]
pub struct KeptNumber(UnsafeCell<u64>);

// SAFETY: every access is volatile and of a plain number. There is one core; a note that an
// interrupt writes is followed by a reset.
unsafe impl Sync for KeptNumber {}

/// A number that a reset leaves, in `.uninit`. The second place is there to be written behind the first.
pub type RamNote = [KeptNumber; 2];

/// One that keeps nothing yet.
#[allow(dead_code, reason = "the boot loader's has a place of its own")]
pub const fn nothing_kept() -> RamNote {
    [const { KeptNumber(UnsafeCell::new(0)) }; 2]
}

/// Keeps a number.
pub fn keep(notes: &RamNote, value: u64) {
    // Twice: the second write pushes the first out of the buffer.
    for _ in 0..2 {
        for place in notes {
            // SAFETY: the place is in RAM and aligned; see `Sync`.
            unsafe { place.0.get().write_volatile(value) };
            cortex_m::asm::dsb();
        }
    }
}

/// What was kept; behind the power, anything.
pub fn kept(notes: &RamNote) -> u64 {
    let [place, _] = notes;
    // SAFETY: as above; any bits are a number.
    unsafe { place.0.get().read_volatile() }
}
