//! Captures on their way from an interrupt to the application.
//!
//! # Design
//!
//! A queue. What does not fit, or was lost before, is counted for each cause, and
//! the count travels with the next capture of that cause; if the queue runs empty
//! before there is one, it is told by a report without counts.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use heapless::{Deque, Vec};
use umi_app::board::LatchSource;
use umi_core::units::Counts;
use umi_protocol::latch::{LatchCause, LatchReport, MAX_AXES};

/// Captures that can wait: the application takes them at a high priority.
pub const WAITING: usize = 64;

/// Skip, trigger, output, the ends of skips, and the index marks.
const CAUSES: usize = 4 + MAX_AXES;

/// How many of a cause came.
#[derive(Clone, Copy)]
struct Count {
    captured: u32,
    /// Not told yet.
    missed: u32,
}

struct State {
    queue: Deque<LatchReport, WAITING>,
    counts: [Count; CAUSES],
    /// The clock at the latest event.
    latest_ns: u64,
}

/// Captures between an interrupt and the application.
pub struct Latches {
    state: Mutex<CriticalSectionRawMutex, RefCell<State>>,
    /// There is something to take.
    came: Signal<CriticalSectionRawMutex, ()>,
}

impl Default for Latches {
    fn default() -> Self {
        Self::new()
    }
}

impl Latches {
    /// None came.
    #[must_use]
    pub const fn new() -> Self {
        let none = Count {
            captured: 0,
            missed: 0,
        };
        Self {
            state: Mutex::new(RefCell::new(State {
                queue: Deque::new(),
                counts: [none; CAUSES],
                latest_ns: 0,
            })),
            came: Signal::new(),
        }
    }

    /// An edge with its instant, and where the axes were at it. `missed` edges of the
    /// same cause before it are lost.
    pub fn captured(
        &self,
        cause: LatchCause,
        t_ns: u64,
        counts: impl IntoIterator<Item = Counts>,
        missed: u32,
    ) {
        // No board has more axes than a report.
        let mut known = Vec::new();
        for axis in counts {
            if known.push(axis.0).is_err() {
                break;
            }
        }
        let mut counts = Some(known);
        self.with(cause, |state, index| {
            state.latest_ns = t_ns;
            let Some(count) = state.counts.get_mut(index) else {
                return;
            };
            let latch = LatchReport {
                number: count.captured,
                cause,
                counts: counts.take().unwrap_or_default(),
                t_ns,
                missed: count.missed.saturating_add(missed),
            };
            match state.queue.push_back(latch) {
                Ok(()) => {
                    count.captured = count.captured.wrapping_add(1);
                    count.missed = 0;
                }
                // It is told behind what is in the queue.
                Err(_) => count.missed = count.missed.saturating_add(missed).saturating_add(1),
            }
        });
    }

    /// So many edges came by `t_ns`, and where the axes were at them is not known.
    pub fn lost(&self, cause: LatchCause, t_ns: u64, missed: u32) {
        self.with(cause, |state, index| {
            state.latest_ns = t_ns;
            if let Some(count) = state.counts.get_mut(index) {
                count.missed = count.missed.saturating_add(missed);
            }
        });
    }

    fn with(&self, cause: LatchCause, change: impl FnOnce(&mut State, usize)) {
        let index = match cause {
            LatchCause::Skip => 0,
            LatchCause::Trigger => 1,
            LatchCause::Output => 2,
            LatchCause::SkipEnd => 3,
            LatchCause::Index { axis } => 4 + usize::from(axis),
        };
        self.state.lock(|state| {
            // Nobody can have it, in a critical section; and no interrupt has a way to a panic.
            if let Ok(mut state) = state.try_borrow_mut() {
                change(&mut state, index);
            }
        });
        self.came.signal(());
    }

    /// The oldest capture, or if there is none, what was lost.
    fn take(&self) -> Option<LatchReport> {
        self.state.lock(|state| {
            let mut state = state.try_borrow_mut().ok()?;
            state.queue.pop_front().or_else(|| state.untold())
        })
    }
}

impl State {
    /// What was lost and has not been told, as a report without counts.
    fn untold(&mut self) -> Option<LatchReport> {
        let mut all = self.counts.iter_mut().enumerate();
        let (index, count) = all.find(|(_, count)| count.missed > 0)?;
        Some(LatchReport {
            number: count.captured,
            cause: match index {
                0 => LatchCause::Skip,
                1 => LatchCause::Trigger,
                2 => LatchCause::Output,
                3 => LatchCause::SkipEnd,
                // There are no more than MAX_AXES.
                axis => LatchCause::Index {
                    axis: (axis - 4) as u8,
                },
            },
            counts: Vec::new(),
            t_ns: self.latest_ns,
            missed: core::mem::take(&mut count.missed),
        })
    }
}

impl LatchSource for &Latches {
    async fn next(&mut self) -> LatchReport {
        loop {
            if let Some(latch) = self.take() {
                return latch;
            }
            self.came.wait().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::future::Future;
    use core::pin::pin;
    use core::task::{Context, Poll, Waker};

    fn next(mut latches: &Latches) -> Option<LatchReport> {
        let future = pin!(latches.next());
        match future.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(latch) => Some(latch),
            Poll::Pending => None,
        }
    }

    fn capture(latches: &Latches, t_ns: u64, missed: u32) {
        let counts = [t_ns as i64, -1].map(Counts);
        latches.captured(LatchCause::Trigger, t_ns, counts, missed);
    }

    /// In order, numbered without gaps, with what was missed before each.
    #[test]
    fn captures_arrive_in_order() {
        let latches = Latches::new();
        assert_eq!(next(&latches), None);
        for t_ns in 0..10 {
            capture(&latches, t_ns, u32::from(t_ns == 4) * 3);
        }
        for t_ns in 0..10 {
            let latch = next(&latches).unwrap();
            assert_eq!(latch.number, t_ns as u32);
            assert_eq!(latch.t_ns, t_ns);
            assert_eq!(latch.counts[0], t_ns as i64);
            assert_eq!(latch.missed, u32::from(t_ns == 4) * 3);
        }
        assert_eq!(next(&latches), None);
    }

    /// More than fit: those that came first stay, the rest is counted, and the sum is
    /// what came.
    #[test]
    fn what_does_not_fit_is_counted() {
        let latches = Latches::new();
        for t_ns in 0..100 {
            capture(&latches, t_ns, 0);
        }
        let mut told = 0;
        for t_ns in 0..WAITING as u64 {
            let latch = next(&latches).unwrap();
            assert_eq!((latch.t_ns, latch.missed), (t_ns, 0));
            told += 1;
        }
        let latch = next(&latches).unwrap();
        assert!(latch.counts.is_empty(), "no other came to tell it");
        assert_eq!(latch.cause, LatchCause::Trigger);
        assert_eq!(latch.missed + told, 100);
        assert_eq!(latch.t_ns, 99);
        assert_eq!(next(&latches), None);
        capture(&latches, 200, 0);
        assert_eq!(
            next(&latches).map(|latch| latch.number),
            Some(WAITING as u32)
        );
    }

    /// Edges without positions are told at once, each cause by itself.
    #[test]
    fn losses_are_told() {
        let latches = Latches::new();
        latches.lost(LatchCause::Index { axis: 5 }, 7, 2);
        latches.lost(LatchCause::Skip, 8, 1);
        let skip = next(&latches).unwrap();
        assert_eq!((skip.cause, skip.missed), (LatchCause::Skip, 1));
        let index = next(&latches).unwrap();
        assert_eq!(
            (index.cause, index.missed),
            (LatchCause::Index { axis: 5 }, 2)
        );
        assert_eq!(next(&latches), None);
        // An axis that no board has is ignored.
        latches.lost(LatchCause::Index { axis: 200 }, 9, 1);
        assert_eq!(next(&latches), None);
    }
}
