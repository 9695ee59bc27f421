//! What happened before: a panic, a hard fault and a stack that overflows, all on purpose, and whether they were noted.

use embassy_stm32::Peri;
use embassy_stm32::peripherals::IWDG1;
use embassy_stm32::wdg::IndependentWatchdog;
use umi_protocol::message::ResetReason;

use crate::ram_note::{RamNote, keep, kept, nothing_kept};
use crate::resources::WATCHDOG_US;

/// Says that the rest of the number is ours.
const OURS: u64 = 0x5E1F_7E58 << 32;
const OURS_MASK: u64 = 0xFFFF_FFFF << 32;

/// The panic was noted.
const PANIC: u64 = 1 << 16;
/// The fault was.
const FAULT: u64 = 1 << 17;
/// That the stack has overflowed was.
const OVERFLOW: u64 = 1 << 18;
const STARTS: u64 = 0xFFFF;
/// Starts that are planned behind the first: behind the panic, the fault, the overflow.
const PLANNED: u64 = 3;

/// In RAM that a reset leaves: the mark, what was noted, and how often the board has started behind the
/// first time.
#[unsafe(link_section = ".uninit.PAST")]
static PAST: RamNote = nothing_kept();

/// What is known of the starts so far.
#[derive(Clone, Copy)]
pub struct Past {
    /// The panic was noted.
    pub panic_is_noted: bool,
    /// The hard fault was.
    pub fault_is_noted: bool,
    /// The overflow was, which this board notes as any other fault.
    pub overflow_is_noted: bool,
    /// Starts that nobody has asked for.
    pub more_starts: u32,
}

/// Panics at the first start, faults at the second, overflows the stack at the third; returns at the fourth. The first
/// one is by the power or by the reset button: what else starts the board counts on. What is below the stack must be
/// guarded by now.
#[allow(clippy::panic, reason = "on purpose")]
pub fn go_through(reason: ResetReason, watchdog: Peri<'static, IWDG1>) -> Past {
    let kept = kept(&PAST);
    let is_first = matches!(
        reason,
        ResetReason::PowerOn | ResetReason::BrownOut | ResetReason::Pin
    );
    let is_noted = reason == ResetReason::Panic;
    let (starts, mut noted) = match kept & OURS_MASK == OURS && !is_first {
        true => (
            (kept & STARTS).saturating_add(1).min(STARTS),
            kept & (PANIC | FAULT | OVERFLOW),
        ),
        false => (0, 0),
    };
    match starts {
        1 if is_noted => noted |= PANIC,
        2 if is_noted => noted |= FAULT,
        PLANNED if is_noted => noted |= OVERFLOW,
        _ => {}
    }
    keep(&PAST, OURS | noted | starts);
    match starts {
        0 => panic!("on purpose"),
        1 => cortex_m::asm::udf(),
        2 => {
            // If nothing faults, or the core stops: a start without a note.
            IndependentWatchdog::new(watchdog, WATCHDOG_US).unleash();
            overflow()
        }
        _ => Past {
            panic_is_noted: noted & PANIC != 0,
            fault_is_noted: noted & FAULT != 0,
            overflow_is_noted: noted & OVERFLOW != 0,
            more_starts: u32::try_from(starts.saturating_sub(PLANNED)).unwrap_or(u32::MAX),
        },
    }
}

/// Puts onto the stack what it has no room for.
fn overflow() -> ! {
    // SAFETY: nothing that it overwrites is used again: what is beyond the stack is a fault.
    unsafe { core::arch::asm!("2:", "push {{r0}}", "b 2b", options(noreturn)) }
}
