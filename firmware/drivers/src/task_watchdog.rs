//! Task watchdog: every priority level must check in within its own time-out.
//!
//! # Design
//!
//! A board's highest interrupt feeds the watchdog of its chip, as long as each level of
//! priority below has checked in within a time-out of its own. What spins at a level keeps that
//! level and all below from checking in, and nothing else. The chip's counter runs on from the
//! last time that it was fed: it adds to every patience.
//!
//! Instants are the low word of a timer of microseconds, which comes round after 71 minutes:
//! far beyond any patience, at which all is over.

use core::sync::atomic::{AtomicU32, Ordering};

/// The longest patience: half of what the timer can tell.
const LONGEST_US: u32 = 1 << 31;

/// A level of priority.
pub struct TaskWatchdog {
    checked_in_us: AtomicU32,
    patience_us: u32,
}

impl TaskWatchdog {
    /// Must check in at least so often.
    #[must_use]
    pub const fn new(patience_us: u32) -> Self {
        assert!(patience_us < LONGEST_US, "the timer comes round");
        Self {
            checked_in_us: AtomicU32::new(0),
            patience_us,
        }
    }

    /// It has run.
    pub fn check_in(&self, now_us: u32) {
        self.checked_in_us.store(now_us, Ordering::Relaxed);
    }

    /// Whether it checked in within its time-out. To be asked by nobody whom it could
    /// interrupt.
    #[must_use]
    pub fn is_alive(&self, now_us: u32) -> bool {
        now_us.wrapping_sub(self.checked_in_us.load(Ordering::Relaxed)) < self.patience_us
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u32 = 1_000_000;
    /// As on the Pico: host's tasks, measuring, and the chip's counter.
    const HOST_US: u32 = 8 * S;
    const MEASURING_US: u32 = 120 * S;
    const COUNTER_US: u32 = S;
    /// The highest interrupt.
    const TICK_US: u32 = 500;

    /// Runs a board from an instant of its timer until its watchdog resets it: after how long,
    /// and none if it does not within 200 s. The levels are heard each quarter of a second
    /// while they can run at this time.
    fn reset_after(start_us: u32, runs: impl Fn(u32) -> (bool, bool)) -> Option<u32> {
        let (host, measuring) = (TaskWatchdog::new(HOST_US), TaskWatchdog::new(MEASURING_US));
        host.check_in(start_us);
        measuring.check_in(start_us);
        let mut fed = 0;
        for since in (0..200 * S).step_by(TICK_US as usize) {
            let now_us = start_us.wrapping_add(since);
            if since % (S / 4) == 0 {
                let (host_runs, measuring_runs) = runs(since);
                if host_runs {
                    host.check_in(now_us);
                }
                if measuring_runs {
                    measuring.check_in(now_us);
                }
            }
            if host.is_alive(now_us) && measuring.is_alive(now_us) {
                fed = since;
            }
            if since - fed >= COUNTER_US {
                return Some(since);
            }
        }
        None
    }

    /// Instants at which the timer is at its beginning, and about to come round.
    const STARTS: [u32; 3] = [0, u32::MAX - 5 * S, u32::MAX - 125 * S];

    /// A fit of just less than two minutes is waited for, over and over.
    #[test]
    fn a_long_fit_is_waited_for() {
        for start in STARTS {
            let long_fit = |since| (true, since % (119 * S) == 0);
            assert_eq!(reset_after(start, long_fit), None);
            assert_eq!(reset_after(start, |_| (true, true)), None);
        }
    }

    /// Measuring that hangs at 20 s is given its two minutes and the counter's eight seconds.
    #[test]
    fn measuring_that_hangs_is_reset_after_its_patience() {
        for start in STARTS {
            let after = reset_after(start, |since| (true, since < 20 * S)).unwrap();
            let hung = after - 20 * S;
            let expected = MEASURING_US + COUNTER_US;
            assert!((expected - S..=expected).contains(&hung), "{hung}");
        }
    }

    /// A task of the host's level, or above, that spins keeps measuring from running, too: it
    /// is reset by the counter and a second, not after two minutes.
    #[test]
    fn a_level_that_spins_is_reset_soon() {
        for start in STARTS {
            let after = reset_after(start, |since| (since < 20 * S, since < 20 * S)).unwrap();
            let hung = after - 20 * S;
            assert!(
                (COUNTER_US..=COUNTER_US + HOST_US).contains(&hung),
                "{hung}"
            );
            // What blocks it for seven seconds, as a long write to the flash, does not count.
            let busy = |since| {
                let runs = since % (20 * S) > 7 * S;
                (runs, runs)
            };
            assert_eq!(reset_after(start, busy), None);
        }
    }
}
