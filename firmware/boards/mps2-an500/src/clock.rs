//! The clock: 64 bits of 40 ns, and the alarms of everybody who waits.
//!
//! # Design
//!
//! Timer 0 counts down over all 32 bits, for ever; its interrupt counts the wraps, which
//! come every 171 s. A wrap that the interrupt has not counted yet shows in the timer's
//! own flag. Timer 1 is the alarm of the earliest who waits.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use critical_section::{CriticalSection, Mutex};
use embassy_time::{Instant, Timer};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;
use umi_app::board::Clock;
use umi_core::units::Micros;

use crate::chip::{CLOCK_HZ, Register, peripheral};

/// Nanoseconds of a tick of the counter.
const TICK_NS: u64 = 1_000_000_000 / CLOCK_HZ as u64;
/// Ticks of a microsecond.
const TICKS_PER_US: u64 = CLOCK_HZ as u64 / 1_000_000;
/// Until the queue is looked at again if somebody has it.
const SOON_US: u64 = 100;
const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000, "microseconds");

const ENABLE: u32 = 1 << 0;
const INTERRUPT: u32 = 1 << 3;

struct Counter {
    control: Register,
    value: Register,
    reload: Register,
    flag: Register,
}

impl Counter {
    const fn new(base: usize) -> Self {
        Self {
            control: Register::new(base, 0x0),
            value: Register::new(base, 0x4),
            reload: Register::new(base, 0x8),
            flag: Register::new(base, 0xC),
        }
    }
}

const COUNTER: Counter = Counter::new(peripheral::TIMER_0);
const ALARM: Counter = Counter::new(peripheral::TIMER_1);

struct Time {
    wraps: Mutex<Cell<u32>>,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static TIME: Time = Time {
    wraps: Mutex::new(Cell::new(0)),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the counter.
pub fn start() {
    COUNTER.reload.write(u32::MAX);
    COUNTER.value.write(u32::MAX);
    COUNTER.control.write(ENABLE | INTERRUPT);
}

/// Ticks since the start.
fn ticks() -> u64 {
    critical_section::with(|cs| {
        let mut wraps = TIME.wraps.borrow(cs).get();
        let mut value = COUNTER.value.read();
        if COUNTER.flag.read() != 0 {
            // It has wrapped, before this value or after it: this one is after it.
            value = COUNTER.value.read();
            wraps = wraps.wrapping_add(1);
        }
        u64::from(wraps) << 32 | u64::from(u32::MAX - value)
    })
}

/// Time since the start.
pub fn now_ns() -> u64 {
    ticks() * TICK_NS
}

/// The counter has wrapped.
pub extern "C" fn on_wrap() {
    critical_section::with(|cs| {
        COUNTER.flag.write(1);
        let wraps = TIME.wraps.borrow(cs);
        wraps.set(wraps.get().wrapping_add(1));
    });
}

/// Somebody has waited long enough.
pub extern "C" fn on_alarm() {
    critical_section::with(|cs| {
        ALARM.control.write(0);
        ALARM.flag.write(1);
        // Who has the queue has masked this interrupt; if not, it is looked at again soon.
        let next = match TIME.queue.borrow(cs).try_borrow_mut() {
            Ok(mut queue) => queue.next_expiration(TIME.now()),
            Err(_) => TIME.now().saturating_add(SOON_US),
        };
        TIME.arm(cs, next);
    });
}

impl Time {
    /// Sets the alarm. A time that has passed is due at once; one that is too far away for
    /// the counter is looked at again on the way.
    fn arm(&self, _: CriticalSection<'_>, at_us: u64) {
        let wait_us = at_us.saturating_sub(self.now()).max(1);
        let wait = u32::try_from(wait_us.saturating_mul(TICKS_PER_US)).unwrap_or(u32::MAX);
        ALARM.control.write(0);
        ALARM.flag.write(1);
        ALARM.reload.write(wait);
        ALARM.value.write(wait);
        ALARM.control.write(ENABLE | INTERRUPT);
    }
}

impl Driver for Time {
    fn now(&self) -> u64 {
        ticks() / TICKS_PER_US
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            let mut queue = self.queue.borrow(cs).borrow_mut();
            if queue.schedule_wake(at, waker) {
                let next = queue.next_expiration(self.now());
                self.arm(cs, next);
            }
        });
    }
}

/// The application's clock.
pub struct BoardClock;

impl Clock for BoardClock {
    fn now(&self) -> Micros {
        Micros(Instant::now().as_micros())
    }

    async fn wait_until(&self, time: Micros) {
        Timer::at(Instant::from_micros(time.0)).await;
    }
}
