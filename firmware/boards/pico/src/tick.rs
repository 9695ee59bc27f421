//! The tick that extends positions and plans pulses: an alarm of the microsecond timer.
//!
//! The tasks' timer has alarm 0 of the same timer, and an interrupt of its own.

use embassy_rp::interrupt;
use embassy_rp::interrupt::InterruptExt;
use embassy_rp::pac;

use crate::guard;
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

/// The low word of the timer.
pub fn now_us() -> u32 {
    TIMER.timerawl().read()
}

/// What a tick leaves to everybody else before the next, at least, however late it is.
const LEAST_US: u32 = 20;

/// An alarm whose time is already over when it is set would come in an hour; this one is
/// so far ahead that nothing of our priority or above takes as long.
fn set(in_us: u32) {
    critical_section::with(|_| {
        let now = TIMER.timerawl().read();
        TIMER.alarm(NUMBER).write_value(now.wrapping_add(in_us));
    });
}

/// The next tick counts from when this one was due, not from when it was served: so they
/// keep their period whatever delays one of them.
fn ticked() {
    TIMER.intr().write(|w| w.set_alarm(NUMBER, true));
    let due = TIMER.alarm(NUMBER).read();
    guard::ticked(now_us());
    let in_us = latch::ticked();
    critical_section::with(|_| {
        let late = TIMER.timerawl().read().wrapping_sub(due);
        set(in_us.saturating_sub(late).max(LEAST_US));
    });
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
