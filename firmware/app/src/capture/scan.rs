//! Triggers and trigger pulses of a scan: counted, streamed to the host while it
//! listens, summed up in the journal.
//!
//! # Design
//!
//! Ten thousand in a second are too many for a journal in NOR flash and for a lock
//! that a fit may hold. So they have a queue of their own, a lock of a few
//! instructions, and go to the host in batches: full ones if they come fast, what there
//! is after [`PATIENCE_US`] if not. A message for each would cost more than to capture it.
//! The journal gets one record for each scan: how many there were, and what was lost.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use heapless::{Deque, Vec};
use umi_core::units::Micros;
use umi_core::zero_option::ZeroOption;
use umi_protocol::latch::{
    LatchBatch, LatchCause, LatchCounters, LatchReport, LatchStep, MAX_AXES, MAX_STEPS, Scan,
};

/// Latches that can wait for the host: 25 ms at 10 kHz.
const WAITING: usize = 256;

/// Latches that fill a message.
const FULL: usize = 1 + MAX_STEPS;

/// A latch waits for others to fill its message for so long.
pub(crate) const PATIENCE_US: u64 = 5_000;

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
    /// So many of them have waited for long enough.
    due: usize,
    counters: LatchCounters,
    /// The scans under way: by triggers, by pulses of the board's own.
    under_way: [ZeroOption<Scan>; 2],
}

impl Scans {
    /// No scan.
    pub const fn new() -> Self {
        let state = State {
            on: false,
            waiting: Deque::new(),
            due: 0,
            counters: LatchCounters {
                skips: 0,
                triggers: 0,
                outputs: 0,
                indices: 0,
                missed: 0,
                untold: 0,
            },
            under_way: [ZeroOption::empty(), ZeroOption::empty()],
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
            state.due = 0;
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

    /// Takes in the latch of a scan. Never waits. True: it is the first of a scan or of a
    /// message, and [`Self::due`] is to be called within [`PATIENCE_US`].
    pub fn take(&self, latch: LatchReport) -> bool {
        let (first, full) = self.with(|state| {
            state.count(&latch);
            let began = state.note(&latch);
            let waited = !state.waiting.is_empty();
            state.tell(latch);
            (began || !waited, state.waiting.len() >= FULL)
        });
        if full {
            self.came.signal(());
        }
        first
    }

    /// What waits is told although it does not fill a message. True if there is something:
    /// more may come before it is gone, and this is to be called again.
    pub fn due(&self) -> bool {
        let waits = self.with(|state| {
            state.due = state.waiting.len();
            state.due > 0
        });
        if waits {
            self.came.signal(());
        }
        waits
    }

    /// Waits until there is something to tell the host.
    pub async fn came(&self) {
        self.came.wait().await;
    }

    /// When [`Self::over`] is due: none if no scan is under way.
    pub fn deadline(&self) -> Option<Micros> {
        self.with(|state| {
            let ends = state.under_way.iter().filter_map(ZeroOption::get);
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

    /// The oldest latches that wait, as many as go into one message; none if they are
    /// to wait for more. [`Self::came`] says if there is another message.
    pub fn batch(&self) -> Option<LatchBatch> {
        let first = self.with(State::first_due)?;
        let (cause, mut number, mut t_ns) = (first.cause, first.number, first.t_ns);
        let mut counts = first.counts.clone();
        let mut batch = LatchBatch {
            first,
            steps: Vec::new(),
        };
        // One lock for each: nothing else waits longer than for one.
        while !batch.steps.is_full() {
            let step = self.with(|state| {
                let next = state.waiting.front().filter(|next| next.cause == cause)?;
                let step = step((number, t_ns, &counts), next)?;
                (number, t_ns) = (next.number, next.t_ns);
                counts.clone_from(&next.counts);
                state.pop();
                Some(step)
            });
            let Some(step) = step else {
                break;
            };
            // There is room: just looked.
            let _ = batch.steps.push(step);
        }
        if self.with(|state| state.is_due()) {
            self.came.signal(());
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
            // The end of what counted when it began, also where it was missed.
            LatchCause::SkipEnd => return,
        };
        *counter = counter.saturating_add(u32::from(!latch.counts.is_empty()));
        counters.missed = counters.missed.saturating_add(latch.missed);
    }

    /// Sums a latch up in its scan. True if it is the first of one.
    fn note(&mut self, latch: &LatchReport) -> bool {
        let captured = !latch.counts.is_empty();
        let untold = captured && self.on && self.waiting.is_full();
        let Some(place) = self.under_way.get_mut(place(latch.cause)) else {
            return false;
        };
        let began = !place.is_some();
        if began {
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
            scan.captured = scan.captured.saturating_add(u32::from(captured));
            scan.missed = scan.missed.saturating_add(latch.missed);
            scan.untold = scan.untold.saturating_add(u32::from(untold));
            scan.to_ns = latch.t_ns;
        }
        began
    }

    /// Keeps a latch for the host, if it listens and there is room.
    fn tell(&mut self, latch: LatchReport) {
        let captured = !latch.counts.is_empty();
        let untold = self.on && self.waiting.push_back(latch).is_err() && captured;
        self.counters.untold = self.counters.untold.saturating_add(u32::from(untold));
    }

    /// The oldest latch that waits, if it is to be told now.
    fn first_due(&mut self) -> Option<LatchReport> {
        self.is_due().then(|| self.pop()).flatten()
    }

    const fn is_due(&self) -> bool {
        self.due > 0 || self.waiting.len() >= FULL
    }

    fn pop(&mut self) -> Option<LatchReport> {
        self.due = self.due.saturating_sub(1);
        self.waiting.pop_front()
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
fn step(
    (number, t_ns, counts): (u32, u64, &Vec<i64, MAX_AXES>),
    next: &LatchReport,
) -> Option<LatchStep> {
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
    let dt_ns = u32::try_from(next.t_ns.checked_sub(t_ns)?).ok()?;
    Some(LatchStep { dt_ns, dcounts })
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec as StdVec;

    use proptest::prelude::*;

    use super::*;
    use crate::test_board::{report, trigger};

    /// All that waits for the host, unfolded; and in how many messages.
    fn told(scans: &Scans) -> (StdVec<LatchReport>, usize) {
        scans.due();
        told_now(scans)
    }

    /// What is to be told without waiting any longer.
    fn told_now(scans: &Scans) -> (StdVec<LatchReport>, usize) {
        let batches: StdVec<_> = core::iter::from_fn(|| scans.batch()).collect();
        let reports = batches.iter().flat_map(LatchBatch::reports).collect();
        (reports, batches.len())
    }

    fn listening() -> Scans {
        let scans = Scans::new();
        scans.switch(true);
        scans
    }

    /// Latches as no board would give them: any numbers, times, counts of any axes, two
    /// causes; mostly such that one follows the other.
    fn latches() -> impl Strategy<Value = StdVec<LatchReport>> {
        let count = prop_oneof![8 => -5_i64..5, 1 => any::<i64>()];
        let one = (
            prop_oneof![8 => Just(1), 1 => any::<u32>()],
            prop_oneof![8 => Just(LatchCause::Trigger), 1 => Just(LatchCause::Output)],
            prop_oneof![
                8 => proptest::collection::vec(count.clone(), 3),
                1 => proptest::collection::vec(count, 0..=MAX_AXES),
            ],
            prop_oneof![8 => 0..200_000_u64, 1 => any::<u64>()],
            prop_oneof![8 => Just(0), 1 => any::<u32>()],
        );
        let first = prop_oneof![Just(0), Just(u32::MAX - 3), any::<u32>()];
        let all = proptest::collection::vec(one, 0..WAITING);
        (first, all).prop_map(|(first, all)| {
            let (mut number, mut t_ns) = (first, 0_u64);
            let mut at = [0_i64; MAX_AXES];
            let latch = |(onward, cause, moved, dt_ns, missed): (u32, _, StdVec<i64>, _, _)| {
                number = number.wrapping_add(onward);
                t_ns = t_ns.wrapping_add(dt_ns);
                for (at, moved) in at.iter_mut().zip(&moved) {
                    *at = at.wrapping_add(*moved);
                }
                LatchReport {
                    number,
                    cause,
                    counts: at.into_iter().take(moved.len()).collect(),
                    t_ns,
                    missed,
                }
            };
            all.into_iter().map(latch).collect()
        })
    }

    proptest! {
        /// Whatever goes in for a host that listens, comes out of the batches: all of it,
        /// in order, to the last bit.
        #[test]
        fn batches_unfold_to_what_went_in(latches in latches()) {
            let scans = listening();
            for latch in &latches {
                scans.take(latch.clone());
            }
            prop_assert_eq!(told(&scans).0, latches);
            prop_assert_eq!(scans.counters().untold, 0);
        }
    }

    /// A steady scan needs one message for sixteen triggers, also where the numbers begin
    /// anew.
    #[test]
    fn steady_triggers_share_messages() {
        let scans = listening();
        let mut given: StdVec<_> = (0..64).map(trigger).collect();
        for latch in &mut given {
            latch.number = latch.number.wrapping_sub(20);
            scans.take(latch.clone());
        }
        assert_eq!(told(&scans), (given, 4));
    }

    /// A message goes when it is full; what does not fill one goes when it is due, and who
    /// takes latches in is told when to see to that.
    #[test]
    fn messages_are_full_or_due() {
        let scans = listening();
        assert!(scans.take(trigger(0)), "the first of a message");
        for number in 1..20 {
            assert!(!scans.take(trigger(number)));
        }
        let full = FULL as u32;
        assert!(told_now(&scans).0.into_iter().eq((0..full).map(trigger)));
        assert_eq!(told_now(&scans).0, [], "four do not fill a message");
        assert!(scans.due());
        assert!(told_now(&scans).0.into_iter().eq((full..20).map(trigger)));
        assert!(!scans.due());
        assert!(scans.take(trigger(20)), "the first again");
        assert_eq!(told_now(&scans).0, [], "it waits for others");
    }

    /// What the host does not take in time is counted as untold, and as captured; the
    /// host sees the gap in the numbers. Without a host nothing is untold.
    #[test]
    fn what_finds_no_room_is_untold() {
        let scans = Scans::new();
        scans.take(trigger(0));
        assert_eq!(told(&scans).0, []);
        scans.switch(true);
        let last = 1 + WAITING as u32 + 7;
        for latch in (1..last).map(trigger) {
            scans.take(latch);
        }
        let counters = scans.counters();
        assert_eq!((counters.triggers, counters.untold), (last, 7));
        let (reports, _) = told(&scans);
        assert!(reports.into_iter().eq((1..=WAITING as u32).map(trigger)));
        scans.take(trigger(last));
        assert_eq!(told(&scans).0, [trigger(last)]);
        // A report that captures nothing is no capture that is not told.
        for latch in (last + 1..last + 1 + WAITING as u32).map(trigger) {
            scans.take(latch);
        }
        scans.take(LatchReport {
            counts: Vec::new(),
            missed: 3,
            ..trigger(0)
        });
        let counters = scans.counters();
        assert_eq!((counters.missed, counters.untold), (3, 7));
        let scan = scans.over(Micros(10_000_000)).unwrap();
        assert_eq!((scan.captured, scan.untold), (counters.triggers, 7));
    }

    /// A report without counts tells what was missed, and captures nothing.
    #[test]
    fn a_report_without_counts_is_no_capture() {
        let scans = listening();
        let gone = LatchReport {
            counts: Vec::new(),
            missed: 9,
            ..trigger(1)
        };
        let all = [trigger(0), gone, trigger(1)];
        for latch in &all {
            scans.take(latch.clone());
        }
        assert_eq!(told(&scans), (all.to_vec(), 3));
        let counters = scans.counters();
        assert_eq!((counters.triggers, counters.missed), (2, 9));
        let scan = scans.over(Micros(10_000_000)).unwrap();
        assert_eq!((scan.captured, scan.missed), (2, 9));
    }

    /// Triggers and pulses at once are two scans: each is summed up a second after its
    /// own last one, once.
    #[test]
    fn two_scans_at_once_are_told_apart() {
        let scans = listening();
        for n in 0..100 {
            scans.take(trigger(n));
            if n < 50 {
                scans.take(report(LatchCause::Output, n));
            }
        }
        let ends = |n: u64| Micros(100 * n + 1_000_000);
        assert_eq!(scans.over(Micros(ends(49).0 - 1)), None);
        assert_eq!(scans.deadline(), Some(Micros(ends(49).0 + 1)));
        let pulses = scans.over(ends(49)).unwrap();
        assert_eq!((pulses.cause, pulses.captured), (LatchCause::Output, 50));
        assert_eq!((pulses.from_ns, pulses.to_ns), (0, 4_900_000));
        assert_eq!(scans.over(Micros(ends(99).0 - 1)), None);
        let triggers = scans.over(ends(99)).unwrap();
        assert_eq!(
            (triggers.cause, triggers.captured),
            (LatchCause::Trigger, 100)
        );
        assert_eq!(scans.over(ends(1000)), None);
        assert_eq!(scans.deadline(), None);
        scans.take(trigger(100));
        assert_eq!(scans.over(ends(1000)).unwrap().first, 100);
    }
}
