//! The tasks' timer: who waits for a time is woken by alarm 0 of the microsecond timer.
//!
//! # Design
//!
//! That of `embassy-rp`, whose handler can panic where two have the queue at once. Both are in a
//! critical section here, so nobody can; and if somebody could, a task would be woken too often
//! rather than the board be reset from an interrupt.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use cortex_m_rt::interrupt;
use critical_section::{CriticalSection, Mutex};
use embassy_rp::interrupt;
use embassy_rp::interrupt::{InterruptExt, Priority};
use embassy_rp::pac;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

#[cfg(not(feature = "rp2350"))]
use embassy_rp::interrupt::TIMER_IRQ_0 as ALARM;
#[cfg(feature = "rp2350")]
use embassy_rp::interrupt::TIMER0_IRQ_0 as ALARM;

/// Of microseconds.
#[cfg(not(feature = "rp2350"))]
pub const TIMER: pac::timer::Timer = pac::TIMER;
/// Of microseconds.
#[cfg(feature = "rp2350")]
pub const TIMER: pac::timer::Timer = pac::TIMER0;

const NUMBER: usize = 0;
/// Until the queue is looked at again if somebody has it.
const SOON_US: u64 = 100;

const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000, "microseconds");

struct Alarms {
    queue: Mutex<RefCell<Queue>>,
    /// When the alarm is due; its register has the lower half only.
    due_us: Mutex<Cell<u64>>,
}

embassy_time_driver::time_driver_impl!(static ALARMS: Alarms = Alarms {
    queue: Mutex::new(RefCell::new(Queue::new())),
    due_us: Mutex::new(Cell::new(u64::MAX)),
});

/// Lets the alarm interrupt.
#[allow(dead_code, reason = "the boot loader lets nothing interrupt")]
pub fn start(priority: Priority) {
    ALARM.set_priority(priority);
    critical_section::with(|_| TIMER.inte().modify(|w| w.set_alarm(NUMBER, true)));
    // SAFETY: its handler is below; no critical section depends on it being off.
    unsafe { ALARM.enable() };
}

impl Driver for Alarms {
    fn now(&self) -> u64 {
        loop {
            let high = TIMER.timerawh().read();
            let low = TIMER.timerawl().read();
            if high == TIMER.timerawh().read() {
                return u64::from(high) << 32 | u64::from(low);
            }
        }
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|section| {
            let Ok(mut queue) = self.queue.borrow(section).try_borrow_mut() else {
                // It looks at the clock itself, and asks again.
                return waker.wake_by_ref();
            };
            // Where the alarm comes before that anyway, it looks for the next one then.
            if queue.schedule_wake(at, waker) && at < self.due_us.borrow(section).get() {
                drop(queue);
                self.set_next(section);
            }
        });
    }
}

impl Alarms {
    /// Wakes whose time has come, and sets the alarm for the next.
    fn set_next(&self, section: CriticalSection<'_>) {
        loop {
            let now = self.now();
            let next = match self.queue.borrow(section).try_borrow_mut() {
                Ok(mut queue) => queue.next_expiration(now),
                Err(_) => now.saturating_add(SOON_US),
            };
            if self.set(section, next) {
                return;
            }
        }
    }

    /// Sets the alarm. False: that time has passed.
    fn set(&self, section: CriticalSection<'_>, at_us: u64) -> bool {
        self.due_us.borrow(section).set(at_us);
        // One that is more than 72 minutes ahead comes early, and is set again.
        TIMER.alarm(NUMBER).write_value(at_us as u32);
        let is_ahead = self.now() < at_us;
        if !is_ahead {
            TIMER.armed().write(|w| w.set_armed(1 << NUMBER));
        }
        is_ahead
    }

    fn rang(&self) {
        critical_section::with(|section| {
            TIMER.intr().write(|w| w.set_alarm(NUMBER, true));
            let due_us = self.due_us.borrow(section).get();
            if self.now() < due_us && self.set(section, due_us) {
                return;
            }
            self.set_next(section);
        });
    }
}

#[cfg(not(feature = "rp2350"))]
#[interrupt]
fn TIMER_IRQ_0() {
    ALARMS.rang();
}

#[cfg(feature = "rp2350")]
#[interrupt]
fn TIMER0_IRQ_0() {
    ALARMS.rang();
}
