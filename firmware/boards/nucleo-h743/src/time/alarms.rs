//! The tasks' timer: who waits for a time is woken by TIM12.
//!
//! # Design
//!
//! As the Pico's, and for the same reason: the handler of `embassy-stm32` can panic where two have the
//! queue at once. Time is that of the captures' clock. TIM12 runs once for what is left until then, or for
//! the longest that it can, and is set again.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use critical_section::{CriticalSection, Mutex};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::timer::TimGp16;
use embassy_stm32::pac::timer::vals::Urs;
use embassy_stm32::{pac, peripherals, rcc};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use crate::axes;
use crate::resources::TIMER_HZ;

// SAFETY: the registers that are used here are at the same places in both (RM0433, 39 and 40).
const TIMER: TimGp16 = unsafe { TimGp16::from_ptr(pac::TIM12.as_ptr()) };

/// Until the queue is looked at again if somebody has it.
const SOON_US: u64 = 100;
/// The timer has 16 bits.
const LONGEST_US: u64 = u16::MAX as u64;

const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000, "microseconds");

struct Alarms {
    queue: Mutex<RefCell<Queue>>,
    due_us: Mutex<Cell<u64>>,
}

embassy_time_driver::time_driver_impl!(static ALARMS: Alarms = Alarms {
    queue: Mutex::new(RefCell::new(Queue::new())),
    due_us: Mutex::new(Cell::new(u64::MAX)),
});

/// Lets the alarm interrupt. The captures' clock runs already.
pub fn start() {
    rcc::enable_and_reset::<peripherals::TIM12>();
    const PRESCALER: u32 = TIMER_HZ / 1_000_000;
    TIMER.psc().write_value((PRESCALER - 1) as u16);
    // One turn, and only its end interrupts: not that it is set.
    TIMER.cr1().write(|w| {
        w.set_opm(true);
        w.set_urs(Urs::COUNTER_ONLY);
    });
    TIMER.dier().write(|w| w.set_uie(true));
    // SAFETY: its handler is below; no critical section depends on it being off.
    unsafe { interrupt::TIM8_BRK_TIM12.enable() };
}

impl Driver for Alarms {
    fn now(&self) -> u64 {
        axes::now_ns() / 1_000
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
        let left_us = at_us.saturating_sub(self.now());
        if left_us == 0 {
            return false;
        }
        TIMER.cr1().modify(|w| w.set_cen(false));
        // From 0 to this, and one more to its end: never early.
        TIMER
            .arr()
            .write(|w| w.set_arr(left_us.min(LONGEST_US) as u16));
        TIMER.egr().write(|w| w.set_ug(true));
        TIMER.sr().write(|w| w.set_uif(false));
        TIMER.cr1().modify(|w| w.set_cen(true));
        true
    }

    fn rang(&self) {
        critical_section::with(|section| {
            TIMER.sr().write(|w| w.set_uif(false));
            let due_us = self.due_us.borrow(section).get();
            if self.now() < due_us && self.set(section, due_us) {
                return;
            }
            self.set_next(section);
        });
    }
}

#[interrupt]
fn TIM8_BRK_TIM12() {
    ALARMS.rang();
}
