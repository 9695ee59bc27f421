//! Triggers and trigger pulses of a scan: counted, streamed to the host while it
//! listens, summed up in the journal.
//!
//! # Design
//!
//! Ten thousand in a second are too many for a journal in NOR flash and for a lock
//! that a fit may hold. So they have a queue of their own, a lock of a few
//! instructions, and go to the host in batches. The journal gets one record for each
//! scan: how many there were, and what was lost.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use heapless::{Deque, Vec};
use umi_core::place::Place;
use umi_core::units::Micros;
use umi_protocol::latch::{
    LatchBatch, LatchCause, LatchCounters, LatchReport, LatchStep, MAX_AXES, Scan,
};

/// Latches that can wait for the host: 25 ms at 10 kHz.
const WAITING: usize = 256;

/// A scan is over when nothing came for this long.
const QUIET_NS: u64 = 1_000_000_000;

/// Trigger latches on their way to the host.
pub(crate) struct Scans {
    state: Mutex<CriticalSectionRawMutex, RefCell<State>>,
    /// There is something to tell the host.
    came: Signal<CriticalSectionRawMutex, ()>,
}

struct State {
    /// The host listens.
    on: bool,
    waiting: Deque<LatchReport, WAITING>,
    counters: LatchCounters,
    /// The scans under way: by triggers, by pulses of the board's own.
    under_way: [Place<Scan>; 2],
}

impl Scans {
    /// No scan.
    pub const fn new() -> Self {
        let state = State {
            on: false,
            waiting: Deque::new(),
            counters: LatchCounters {
                skips: 0,
                triggers: 0,
                outputs: 0,
                indices: 0,
                missed: 0,
                untold: 0,
            },
            under_way: [Place::empty(), Place::empty()],
        };
        Self {
            state: Mutex::new(RefCell::new(state)),
            came: Signal::new(),
        }
    }

    fn with<T>(&self, work: impl FnOnce(&mut State) -> T) -> T {
        self.state.lock(|state| work(&mut state.borrow_mut()))
    }

    /// Begins or stops to keep latches for the host.
    pub fn switch(&self, on: bool) {
        self.with(|state| {
            state.on = on;
            state.waiting.clear();
        });
    }

    /// What has been captured and lost.
    pub fn counters(&self) -> LatchCounters {
        self.with(|state| state.counters)
    }

    /// Counts a latch of any cause.
    pub fn count(&self, latch: &LatchReport) {
        self.with(|state| state.count(latch));
    }

    /// Takes in the latch of a scan. Never waits.
    pub fn take(&self, latch: LatchReport) {
        self.with(|state| {
            state.count(&latch);
            let untold = state.tell(&latch);
            let Some(place) = state.under_way.get_mut(place(latch.cause)) else {
                return;
            };
            if !place.is_some() {
                place.put(Scan {
                    cause: latch.cause,
                    captured: 0,
                    missed: 0,
                    untold: 0,
                    first: latch.number,
                    from_ns: latch.t_ns,
                    to_ns: latch.t_ns,
                });
            }
            if let Some(scan) = place.get_mut() {
                let captured = u32::from(!latch.counts.is_empty());
                scan.captured = scan.captured.saturating_add(captured);
                scan.missed = scan.missed.saturating_add(latch.missed);
                scan.untold = scan.untold.saturating_add(u32::from(untold));
                scan.to_ns = latch.t_ns;
            }
        });
        self.came.signal(());
    }

    /// Waits until there is something to tell the host.
    pub async fn came(&self) {
        self.came.wait().await;
    }

    /// When [`Self::over`] is due: none if no scan is under way.
    pub fn deadline(&self) -> Option<Micros> {
        self.with(|state| {
            let ends = state.under_way.iter().filter_map(Place::get);
            let ends = ends.map(|scan| scan.to_ns.saturating_add(QUIET_NS) / 1000 + 1);
            ends.min().map(Micros)
        })
    }

    /// A scan that is over at this time.
    pub fn over(&self, now: Micros) -> Option<Scan> {
        let now_ns = now.0.saturating_mul(1000);
        self.with(|state| {
            let over = |scan: &Scan| scan.to_ns.saturating_add(QUIET_NS) <= now_ns;
            let mut scans = state.under_way.iter_mut();
            scans.find(|scan| scan.get().is_some_and(over))?.take()
        })
    }

    /// The oldest latches that wait, as many as go into one message.
    pub fn batch(&self) -> Option<LatchBatch> {
        let first = self.with(|state| state.waiting.pop_front())?;
        let mut last = (first.number, first.t_ns, first.counts.clone());
        let cause = first.cause;
        let mut batch = LatchBatch {
            first,
            steps: Vec::new(),
        };
        // One lock for each: nothing else waits longer than for one.
        while !batch.steps.is_full() {
            let next = self.with(|state| {
                let step = state
                    .waiting
                    .front()
                    .filter(|next| next.cause == cause)
                    .and_then(|next| step(&last, next))?;
                Some((step, state.waiting.pop_front()?))
            });
            let Some((step, next)) = next else {
                break;
            };
            last = (next.number, next.t_ns, next.counts);
            // There is room: just looked.
            let _ = batch.steps.push(step);
        }
        Some(batch)
    }
}

impl State {
    fn count(&mut self, latch: &LatchReport) {
        let counters = &mut self.counters;
        let counter = match latch.cause {
            LatchCause::Skip => &mut counters.skips,
            LatchCause::Trigger => &mut counters.triggers,
            LatchCause::Output => &mut counters.outputs,
            LatchCause::Index { .. } => &mut counters.indices,
        };
        *counter = counter.saturating_add(u32::from(!latch.counts.is_empty()));
        counters.missed = counters.missed.saturating_add(latch.missed);
    }

    /// Keeps a latch for the host. True if it listens and there was no room.
    fn tell(&mut self, latch: &LatchReport) -> bool {
        let untold = self.on && self.waiting.push_back(latch.clone()).is_err();
        self.counters.untold = self.counters.untold.saturating_add(u32::from(untold));
        untold
    }
}

/// Where the scan of a cause is.
const fn place(cause: LatchCause) -> usize {
    match cause {
        LatchCause::Output => 1,
        _ => 0,
    }
}

/// One latch as its difference from the one before; none if it does not follow it
/// directly or is too far away.
fn step(last: &(u32, u64, Vec<i64, MAX_AXES>), next: &LatchReport) -> Option<LatchStep> {
    let (number, t_ns, counts) = last;
    if next.missed > 0 || next.number != number.wrapping_add(1) {
        return None;
    }
    if next.counts.len() != counts.len() {
        return None;
    }
    let mut dcounts = Vec::new();
    for (to, from) in next.counts.iter().zip(counts) {
        let difference = i32::try_from(to.checked_sub(*from)?).ok()?;
        dcounts.push(difference).ok()?;
    }
    let dt_ns = u32::try_from(next.t_ns.checked_sub(*t_ns)?).ok()?;
    Some(LatchStep { dt_ns, dcounts })
}
