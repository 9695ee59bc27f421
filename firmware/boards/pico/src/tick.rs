//! The tick that extends positions and plans pulses: an alarm of the microsecond timer.
//!
//! The tasks' timer has alarm 0 of the same timer, and an interrupt of its own.

use embassy_rp::interrupt;
use embassy_rp::interrupt::InterruptExt;
use embassy_rp::pac;

use crate::latch;
use crate::plan::{CAPTURE, EXTEND_US, TICK_US};

#[cfg(not(feature = "rp2350"))]
const TIMER: pac::timer::Timer = pac::TIMER;
#[cfg(feature = "rp2350")]
const TIMER: pac::timer::Timer = pac::TIMER0;
#[cfg(not(feature = "rp2350"))]
use embassy_rp::interrupt::TIMER_IRQ_1 as ALARM;
#[cfg(feature = "rp2350")]
use embassy_rp::interrupt::TIMER0_IRQ_1 as ALARM;

const NUMBER: usize = 1;

/// Begins to tick.
pub fn start() {
    ALARM.set_priority(CAPTURE);
    // SAFETY: its handler is below; no critical section depends on it being off.
    unsafe { ALARM.enable() };
    critical_section::with(|_| TIMER.inte().modify(|w| w.set_alarm(NUMBER, true)));
    set(EXTEND_US);
}

/// The next tick comes soon.
pub fn soon() {
    set(TICK_US);
}

/// An alarm whose time is already over when it is set would come in an hour; this one is
/// so far ahead that nothing of our priority or above takes as long.
fn set(in_us: u32) {
    critical_section::with(|_| {
        let now = TIMER.timerawl().read();
        TIMER.alarm(NUMBER).write_value(now.wrapping_add(in_us));
    });
}

fn ticked() {
    TIMER.intr().write(|w| w.set_alarm(NUMBER, true));
    set(latch::ticked());
}

#[cfg(not(feature = "rp2350"))]
#[interrupt]
fn TIMER_IRQ_1() {
    ticked();
}

#[cfg(feature = "rp2350")]
#[interrupt]
fn TIMER0_IRQ_1() {
    ticked();
}
