//! Reset: its cause, and the board's last act when it cannot go on.

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use embassy_stm32::pac::{GPIOF, GPIOG, RCC};
use umi_protocol::message::ResetReason;

use crate::ram_note::{RamNote, keep, kept, nothing_kept};

/// Says that a panic or a fault was the reason. Any other value, as RAM has after power-up, does
/// not.
const PANICKED: u64 = 0x554D_4921_6B65_7074;

/// Outside of what is cleared at the start.
#[unsafe(link_section = ".uninit.panicked")]
static NOTES: RamNote = nothing_kept();

/// Whether a panic or a fault was noted. Once.
fn take_note() -> bool {
    let found = kept(&NOTES);
    keep(&NOTES, 0);
    found == PANICKED
}

/// Laser, lamps and what the sensor tells the control go off, whatever else is broken: before anything that takes time. The pins are
/// those of `main`. Before their clocks run, the pins float and this does nothing.
fn dark() {
    GPIOG.bsrr().write(|w| {
        for pin in 0..=3 {
            w.set_br(pin, true);
        }
    });
    GPIOF.bsrr().write(|w| {
        for pin in 12..=15 {
            w.set_br(pin, true);
        }
    });
}

/// Says that the board cannot go on, and starts it anew; laser and lamps first.
pub fn reset_now() -> ! {
    cortex_m::interrupt::disable();
    dark();
    keep(&NOTES, PANICKED);
    SCB::sys_reset()
}

/// Starts the board anew because its host has asked for it; laser and lamps first.
#[allow(dead_code, reason = "only the application is asked")]
pub fn start_anew() -> ! {
    cortex_m::interrupt::disable();
    dark();
    SCB::sys_reset()
}

/// Why the board started, by the flags of RM0433, 8.7.37 (RCC_RSR), of which several are
/// set at once: the pin is pulled by every reset. Once: the flags are cleared.
pub fn reason() -> ResetReason {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    let panicked = take_note();
    if flags.porrstf() {
        ResetReason::PowerOn
    } else if flags.borrstf() {
        ResetReason::BrownOut
    } else if flags.iwdg1rstf() || flags.wwdg1rstf() {
        ResetReason::Watchdog
    } else if flags.sftrstf() && panicked {
        ResetReason::Panic
    } else if flags.sftrstf() {
        ResetReason::Software
    } else if flags.pinrstf() {
        ResetReason::Pin
    } else {
        ResetReason::Unknown
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    // A slow debug probe may hold the log.
    dark();
    if let Some(place) = info.location() {
        defmt::error!("panic at {}:{}", place.file(), place.line());
    }
    reset_now()
}

/// The core cannot go on: from `fault_entry`. Memory, bus and usage faults come here, too: they are not enabled.
#[unsafe(no_mangle)]
extern "C" fn on_fault(_: u32) -> ! {
    reset_now()
}

/// An exception or an interrupt that nothing here has asked for.
#[exception]
unsafe fn DefaultHandler(_: i16) -> ! {
    reset_now()
}
