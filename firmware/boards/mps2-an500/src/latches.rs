//! Captures on their way to the application: a queue that counts what it cannot take.

use core::cell::RefCell;

use critical_section::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use heapless::Vec;
use umi_app::board::LatchSource;
use umi_protocol::latch::{LatchCause, LatchReport, MAX_AXES};

use crate::path::Counts;

/// Captures that can wait: the application takes them at a high priority.
const WAITING: usize = 64;

/// Skip, trigger, output, and the index marks.
const CAUSES: usize = 3 + MAX_AXES;

/// How many of a cause came.
#[derive(Clone, Copy)]
struct Count {
    captured: u32,
    /// Not told yet.
    missed: u32,
}

/// Captures between the interrupt and the application.
pub struct Latches {
    queue: Channel<CriticalSectionRawMutex, LatchReport, WAITING>,
    counts: Mutex<RefCell<[Count; CAUSES]>>,
}

fn index(cause: LatchCause) -> usize {
    match cause {
        LatchCause::Skip => 0,
        LatchCause::Trigger => 1,
        LatchCause::Output => 2,
        LatchCause::Index { axis } => 3 + usize::from(axis),
    }
}

fn cause(index: usize) -> LatchCause {
    match index {
        0 => LatchCause::Skip,
        1 => LatchCause::Trigger,
        2 => LatchCause::Output,
        axis => LatchCause::Index {
            // There are no more than MAX_AXES.
            axis: (axis - 3) as u8,
        },
    }
}

impl Latches {
    /// None came.
    pub const fn new() -> Self {
        let none = Count {
            captured: 0,
            missed: 0,
        };
        Self {
            queue: Channel::new(),
            counts: Mutex::new(RefCell::new([none; CAUSES])),
        }
    }

    /// An edge, and where the axes were if that is still known.
    pub fn capture(&self, cause: LatchCause, t_ns: u64, counts: Option<Counts>) {
        critical_section::with(|cs| {
            let mut all = self.counts.borrow(cs).borrow_mut();
            let Some(count) = all.get_mut(index(cause)) else {
                return;
            };
            let taken = counts.is_some_and(|counts| {
                let latch = LatchReport {
                    number: count.captured,
                    cause,
                    counts: counts.into_iter().collect(),
                    t_ns,
                    missed: count.missed,
                };
                self.queue.try_send(latch).is_ok()
            });
            if taken {
                count.captured = count.captured.wrapping_add(1);
                count.missed = 0;
            } else {
                count.missed = count.missed.saturating_add(1);
            }
        });
    }

    /// What was missed and has not been told, as a capture without counts.
    fn untold(&self) -> Option<LatchReport> {
        critical_section::with(|cs| {
            let mut all = self.counts.borrow(cs).borrow_mut();
            let (index, count) = all.iter_mut().enumerate().find(|(_, c)| c.missed > 0)?;
            Some(LatchReport {
                number: count.captured,
                cause: cause(index),
                counts: Vec::new(),
                t_ns: crate::clock::now_ns(),
                missed: core::mem::take(&mut count.missed),
            })
        })
    }
}

/// How long a loss waits for a capture to be told with.
const PATIENCE_US: u64 = 10_000;

impl LatchSource for &Latches {
    async fn next(&mut self) -> LatchReport {
        use embassy_futures::select::{Either, select};
        loop {
            let soon = embassy_time::Timer::after_micros(PATIENCE_US);
            match select(self.queue.receive(), soon).await {
                Either::First(latch) => return latch,
                Either::Second(()) => {
                    if let Some(latch) = self.untold() {
                        return latch;
                    }
                }
            }
        }
    }
}
