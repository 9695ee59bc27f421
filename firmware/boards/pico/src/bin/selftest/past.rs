//! What happened before: a panic and a hard fault, both on purpose, and whether they were noted.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::safety::crash_note;

/// Says that the two words behind it are ours.
const OURS: u32 = 0x5E1F_7E57;

/// In RAM that a reset leaves: the mark, how often the board has started, and what was noted.
#[unsafe(link_section = ".uninit.PAST")]
static KEPT: [AtomicU32; 3] = [const { AtomicU32::new(0) }; 3];

/// What is known of the starts so far.
#[derive(Clone, Copy)]
pub struct Past {
    /// The panic was noted, with its place.
    pub panic_is_noted: bool,
    /// The hard fault was.
    pub fault_is_noted: bool,
    /// Starts that nobody has asked for.
    pub more_starts: u32,
}

const PANIC: u32 = 1 << 0;
const FAULT: u32 = 1 << 1;
/// Starts that are planned: with the power, after the panic, after the fault.
const PLANNED: u32 = 3;

/// Panics at the first start and faults at the second; returns at the third.
#[allow(clippy::panic, reason = "on purpose")]
pub fn go_through() -> Past {
    let note = crash_note::take();
    let note = note.as_deref().unwrap_or_default();
    let [mark, starts, noted] = &KEPT;
    if mark.load(Ordering::Relaxed) != OURS {
        mark.store(OURS, Ordering::Relaxed);
        starts.store(0, Ordering::Relaxed);
        noted.store(0, Ordering::Relaxed);
    }
    let number = starts.load(Ordering::Relaxed).saturating_add(1);
    starts.store(number, Ordering::Relaxed);
    let also = |what| noted.store(noted.load(Ordering::Relaxed) | what, Ordering::Relaxed);
    match number {
        1 => panic!("on purpose"),
        2 => {
            if note.contains("past.rs") {
                also(PANIC);
            }
            cortex_m::asm::udf()
        }
        PLANNED if note.starts_with("hard fault") => also(FAULT),
        _ => {}
    }
    let noted = noted.load(Ordering::Relaxed);
    Past {
        panic_is_noted: noted & PANIC != 0,
        fault_is_noted: noted & FAULT != 0,
        more_starts: number.saturating_sub(PLANNED),
    }
}
