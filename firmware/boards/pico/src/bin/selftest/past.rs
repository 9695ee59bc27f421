//! What happened before: a panic, a hard fault and a stack that overflows, all on purpose, whether they were noted, and
//! whether the outputs were low then.
//!
//! # Design
//!
//! Before each of them laser and lamps are set where the pins' outputs are not switched on yet: the register shows whether
//! the handler clears them, and no laser is switched by a test. A core that stops where it has no memory for its stack is
//! started anew by the watchdog: that is a start without a note, and its row fails.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_rp::Peri;
use embassy_rp::pac;
use embassy_rp::peripherals::WATCHDOG;
use embassy_rp::watchdog::Watchdog;

use crate::pins::SWITCHED;
use crate::safety::{crash_note, guard};

/// Says that the two words behind it are ours.
const OURS: u32 = 0x5E1F_7E58;

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
    /// That the stack has overflowed was.
    pub overflow_is_noted: bool,
    /// How often laser and lamps were low behind one of the three.
    pub times_dark: u32,
    /// Starts that nobody has asked for.
    pub more_starts: u32,
}

const PANIC: u32 = 1 << 0;
const FAULT: u32 = 1 << 1;
const OVERFLOW: u32 = 1 << 2;
/// How often it was dark, from this bit on.
const DARK: u32 = 1 << 8;
/// Starts that are planned: with the power, after the panic, after the fault, after the overflow.
const PLANNED: u32 = 4;

/// Panics at the first start, faults at the second, overflows the stack at the third; returns at the fourth.
#[allow(clippy::panic, reason = "on purpose")]
pub fn go_through(watchdog: Peri<'static, WATCHDOG>) -> Past {
    // A reset may leave it running.
    pac::WATCHDOG.ctrl().modify(|w| w.set_enable(false));
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
    if number < PLANNED {
        pac::SIO.gpio_out(0).value_set().write_value(SWITCHED);
    }
    match number {
        1 => panic!("on purpose"),
        2 => {
            if note.contains("past.rs") {
                also(PANIC);
            }
            cortex_m::asm::udf()
        }
        3 => {
            if note.starts_with("hard fault") {
                also(FAULT);
            }
            guard::watch(&mut Watchdog::new(watchdog));
            overflow()
        }
        PLANNED if note == crash_note::OVERFLOWED => also(OVERFLOW),
        _ => {}
    }
    let noted = noted.load(Ordering::Relaxed);
    Past {
        panic_is_noted: noted & PANIC != 0,
        fault_is_noted: noted & FAULT != 0,
        overflow_is_noted: noted & OVERFLOW != 0,
        times_dark: noted / DARK,
        more_starts: number.saturating_sub(PLANNED),
    }
}

/// To be called where the board goes dark because it cannot go on: counts it, if it is dark.
pub fn note_dark() {
    if pac::SIO.gpio_out(0).value().read() & SWITCHED == 0 {
        let [_, _, noted] = &KEPT;
        noted.store(
            noted.load(Ordering::Relaxed).wrapping_add(DARK),
            Ordering::Relaxed,
        );
    }
}

/// Puts onto the stack what it has no room for.
fn overflow() -> ! {
    // SAFETY: nothing that it overwrites is used again: what is beyond the stack is a fault.
    unsafe { core::arch::asm!("2:", "push {{r0}}", "b 2b", options(noreturn)) }
}
