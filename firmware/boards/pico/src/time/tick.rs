//! The tick that extends positions and plans pulses: an alarm of the microsecond timer.
//! Its interrupt is served in `latch`.
//!
//! The tasks' timer has alarm 0 of the same timer, and an interrupt of its own.

use embassy_rp::interrupt::InterruptExt;

use crate::resources::{CAPTURE, EXTEND_US, TICK_US};
use crate::time::alarms::TIMER;

#[cfg(not(feature = "rp2350"))]
use embassy_rp::interrupt::TIMER_IRQ_1 as ALARM;
#[cfg(feature = "rp2350")]
use embassy_rp::interrupt::TIMER0_IRQ_1 as ALARM;

const NUMBER: usize = 1;

/// Begins to tick.
pub fn start() {
    ALARM.set_priority(CAPTURE);
    // SAFETY: its handler is in `latch`; no critical section depends on it being off.
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

/// Minimum gap between ticks, so that a late tick cannot starve lower priorities.
const LEAST_US: u32 = 20;

/// An alarm whose time is already over when it is set would come in an hour; this one is
/// so far ahead that nothing of our priority or above takes as long.
fn set(in_us: u32) {
    critical_section::with(|_| {
        let now = TIMER.timerawl().read();
        TIMER.alarm(NUMBER).write_value(now.wrapping_add(in_us));
    });
}

/// Takes note of a tick. Returns when it was due.
pub fn acknowledge() -> u32 {
    TIMER.intr().write(|w| w.set_alarm(NUMBER, true));
    TIMER.alarm(NUMBER).read()
}

/// Sets the next tick so long after this one was due, not after it was served: ticks keep
/// their period whatever delays one of them.
pub fn again(due_us: u32, in_us: u32) {
    critical_section::with(|_| {
        let late = TIMER.timerawl().read().wrapping_sub(due_us);
        set(in_us.saturating_sub(late).max(LEAST_US));
    });
}
