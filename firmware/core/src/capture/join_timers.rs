//! Captures of several timers, joined by the edge that made them.
//!
//! One line goes to a capture input of every timer. An edge on it captures all of
//! them in the same moment, in hardware, each into a register of its own. They
//! are read one after the other, and edges may come before, between and behind
//! the reads, so the values in hand may be of different edges. Here they are
//! sorted out, with nothing but what each timer says of itself: *captured since
//! the last read*, and *captured again before it was read*.
//!
//! # Design
//!
//! While no timer has been captured twice between two reads, each value is the
//! next edge of its timer, so one value of each is one edge: that is a set at
//! once, and an edge that comes while it is read waits in the registers.
//!
//! Once a timer says *captured again*, it has skipped an edge, and it cannot say
//! how many. Then all are read, again and again, until a pass after which none
//! has been captured. In that pass nothing came, so the latest values are of one
//! edge, and everything is in order again.
//!
//! # Limitations
//!
//! A timer that is overwritten twice between two reads tells one, so `missed` is
//! the least number of edges that were lost; it is exact as long as no third edge
//! comes within the latency. It is never zero when an edge was lost.

/// The capture registers of `N` timers.
pub trait Captures<const N: usize> {
    /// Whether this timer has been captured since its value was last read.
    fn is_captured(&mut self, timer: usize) -> bool;

    /// The captured value. Reading it makes room for the next capture.
    fn value(&mut self, timer: usize) -> u32;

    /// Whether the timer was captured while a value was still there, since this
    /// was last asked. It is asked after the value is read, so that a capture
    /// between the two does not escape.
    fn take_overcapture(&mut self, timer: usize) -> bool;
}

/// What a read of the registers gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capture<const N: usize> {
    /// No edge has come.
    Nothing,
    /// One edge, captured in all timers.
    Captured {
        /// The values of the timers.
        values: [u32; N],
        /// Edges before this one that are lost, at least.
        missed: u32,
    },
    /// Edges came, and their values cannot be told apart or are not complete.
    Lost {
        /// Edges that are lost, at least one.
        missed: u32,
        /// How many timers have captured nothing; not 0: not all timers see the line.
        silent: usize,
    },
}

/// Passes over the registers until edges are said to come faster than they can be read.
const PASSES: usize = 4;

/// Sorts out the captures of `N` timers by the edges of one line.
#[derive(Clone, Copy, Debug)]
pub struct Pairing<const N: usize> {
    /// Values read, of an edge that is not complete yet.
    hand: [Option<u32>; N],
    /// Edges that each timer has lost since the last set.
    lost: [u32; N],
    /// How many of these were told already.
    told: u32,
    /// Each value in hand is the first capture since the last set.
    in_order: bool,
}

impl<const N: usize> Default for Pairing<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Pairing<N> {
    /// Nothing has been captured.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            hand: [None; N],
            lost: [0; N],
            told: 0,
            in_order: true,
        }
    }

    /// Reads the registers, at most four times. To be called when a timer was
    /// captured, until it returns [`Capture::Nothing`].
    ///
    /// `Lost` with `silent` 0 says that edges come faster than they are read: a
    /// board does well to leave the line alone for a while.
    pub fn read(&mut self, timers: &mut impl Captures<N>) -> Capture<N> {
        for _ in 0..PASSES {
            self.pass(timers);
            let complete = self.hand.iter().all(Option::is_some);
            if self.in_order && complete {
                return self.set();
            }
            if (0..N).any(|timer| timers.is_captured(timer)) {
                continue;
            }
            // Every timer was read after the latest edge, so what is in hand is of that.
            self.in_order = true;
            if complete {
                return self.set();
            }
            if self.hand.iter().all(Option::is_none) {
                return Capture::Nothing;
            }
            return self.incomplete();
        }
        self.in_order = false;
        if self.hand.iter().any(Option::is_none) {
            return self.incomplete();
        }
        // What is in hand may still turn out to be a set.
        let missed = self.news();
        self.told = self.told.saturating_add(missed);
        Capture::Lost { missed, silent: 0 }
    }

    /// Reads every timer once; in order, only those that are still missing.
    fn pass(&mut self, timers: &mut impl Captures<N>) {
        let mut in_order = self.in_order;
        // Counted by a range, which cannot overrun: an interrupt has no way to a panic.
        let places = self.hand.iter_mut().zip(&mut self.lost);
        for (timer, (hand, lost)) in (0..N).zip(places) {
            if in_order && hand.is_some() || !timers.is_captured(timer) {
                continue;
            }
            let before = hand.replace(timers.value(timer));
            let over = timers.take_overcapture(timer);
            *lost = lost
                .saturating_add(u32::from(before.is_some()))
                .saturating_add(u32::from(over));
            in_order &= !over;
        }
        self.in_order = in_order;
    }

    /// The values in hand are of one edge.
    fn set(&mut self) -> Capture<N> {
        let values = self.hand.map(Option::unwrap_or_default);
        let missed = self.news();
        *self = Self::new();
        Capture::Captured { values, missed }
    }

    /// Some timers do not see the line, so what the others hold is lost as well.
    fn incomplete(&mut self) -> Capture<N> {
        let missed = self.news().saturating_add(1);
        let silent = self.hand.iter().fold(0_usize, |silent, value| {
            silent.saturating_add(usize::from(value.is_none()))
        });
        *self = Self {
            in_order: self.in_order,
            ..Self::new()
        };
        Capture::Lost { missed, silent }
    }

    /// Losses that were not told yet. No timer can have lost more than there were.
    fn news(&self) -> u32 {
        let lost = self.lost.iter().copied().max().unwrap_or(0);
        lost.saturating_sub(self.told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[derive(Clone, Copy, Default)]
    struct Timer {
        value: u32,
        captured: bool,
        over: bool,
        /// Does not see the line.
        cut_off: bool,
    }

    /// Timers as in the reference manual (RM0433, "Input capture mode"), and edges
    /// that come before given accesses to their registers. Edge `n` captures `n`.
    struct World<const N: usize> {
        timers: [Timer; N],
        /// Before which access each edge comes, in order.
        schedule: Vec<usize>,
        edges: u32,
        accesses: usize,
        /// A value was overwritten where one had been overwritten before.
        lost_count: bool,
    }

    impl<const N: usize> World<N> {
        fn new(schedule: &[usize]) -> Self {
            Self {
                timers: [Timer::default(); N],
                schedule: schedule.to_vec(),
                edges: 0,
                accesses: 0,
                lost_count: false,
            }
        }

        fn remaining(&self) -> Option<usize> {
            self.schedule.get(self.edges as usize).copied()
        }

        fn edge(&mut self) {
            self.edges += 1;
            for timer in self.timers.iter_mut().filter(|timer| !timer.cut_off) {
                self.lost_count |= timer.over && timer.captured;
                timer.over |= timer.captured;
                timer.captured = true;
                timer.value = self.edges;
            }
        }

        fn access(&mut self, timer: usize) -> &mut Timer {
            while self.remaining().is_some_and(|at| at <= self.accesses) {
                self.edge();
            }
            self.accesses += 1;
            &mut self.timers[timer]
        }
    }

    impl<const N: usize> Captures<N> for World<N> {
        fn is_captured(&mut self, timer: usize) -> bool {
            self.access(timer).captured
        }

        fn value(&mut self, timer: usize) -> u32 {
            let timer = self.access(timer);
            timer.captured = false;
            timer.value
        }

        fn take_overcapture(&mut self, timer: usize) -> bool {
            core::mem::take(&mut self.access(timer).over)
        }
    }

    /// Reads until all edges have come and nothing is left; holds every answer
    /// against what happened. Returns how many sets came, and how many losses.
    fn run<const N: usize>(schedule: &[usize]) -> (u32, u32) {
        let mut world = World::<N>::new(schedule);
        let mut pairing = Pairing::<N>::new();
        let (mut last, mut told, mut sets, mut all_told) = (0, 0, 0, 0);
        loop {
            match pairing.read(&mut world) {
                Capture::Captured { values, missed } => {
                    let id = values[0];
                    assert_eq!(values, [id; N], "of one edge, {schedule:?}");
                    assert!(id > last, "each edge once, {schedule:?}");
                    told += missed;
                    let gap = id - last - 1;
                    assert!(told <= gap, "{told} told, {gap} lost, {schedule:?}");
                    assert_eq!(told > 0, gap > 0, "no loss is silent, {schedule:?}");
                    if !world.lost_count {
                        assert_eq!(told, gap, "exact, {schedule:?}");
                    }
                    all_told += told;
                    (last, told) = (id, 0);
                    sets += 1;
                }
                Capture::Lost { missed, silent } => {
                    assert_eq!(silent, 0, "{schedule:?}");
                    assert!(missed > 0);
                    told += missed;
                }
                Capture::Nothing => match world.remaining() {
                    // Quiet until the next edge.
                    Some(at) => world.accesses = world.accesses.max(at),
                    None => break,
                },
            }
        }
        assert_eq!(last as usize, schedule.len(), "the last one stays");
        (sets, all_told)
    }

    /// Every way in which `edges` edges can fall on the first `places` accesses.
    fn every_interleaving(places: usize, edges: usize, run: &mut impl FnMut(&[usize])) {
        fn place(
            schedule: &mut Vec<usize>,
            left: usize,
            places: usize,
            run: &mut impl FnMut(&[usize]),
        ) {
            if left == 0 {
                return run(schedule);
            }
            for at in schedule.last().copied().unwrap_or(0)..places {
                schedule.push(at);
                place(schedule, left - 1, places, run);
                schedule.pop();
            }
        }
        place(&mut Vec::new(), edges, places, run);
    }

    /// All interleavings of up to four edges with the accesses of two and of three
    /// timers: whatever the latency, a set is of one edge, none comes twice, none
    /// is lost in silence, and the last one is always there.
    #[test]
    fn every_interleaving_of_edges_and_reads() {
        let mut count = 0_u32;
        let (mut sets, mut lost) = (0, 0);
        let mut note = |(new, missed): (u32, u32)| {
            count += 1;
            sets += new;
            lost += missed;
        };
        for edges in 1..=4 {
            every_interleaving(24, edges, &mut |schedule| note(run::<2>(schedule)));
            every_interleaving(32, edges, &mut |schedule| note(run::<3>(schedule)));
        }
        assert!(count > 70_000, "{count}");
        assert!(sets > count && lost > count, "both happen: {sets} {lost}");
    }

    proptest! {
        /// Six timers as on a board, edges in clusters and storms.
        #[test]
        fn storms(gaps in prop::collection::vec(
            prop_oneof![0_usize..4, 0_usize..40, 0_usize..200], 1..200,
        )) {
            let mut at = 0;
            let schedule: Vec<usize> = gaps
                .iter()
                .map(|gap| {
                    at += gap;
                    at
                })
                .collect();
            run::<6>(&schedule);
        }
    }

    /// Edges with time to read each: all are sets, nothing is missed.
    #[test]
    fn edges_with_time_in_between() {
        let schedule: Vec<usize> = (0..1_000).map(|n| n * 40).collect();
        assert_eq!(run::<6>(&schedule), (1_000, 0));
    }

    /// A second edge while the first is read waits: two sets.
    #[test]
    fn back_to_back() {
        assert_eq!(run::<3>(&[0, 9]), (2, 0));
        assert_eq!(run::<3>(&[0, 0]), (1, 1));
        assert_eq!(run::<3>(&[0, 4]), (1, 1), "in the middle of the reads");
    }

    /// A storm without an end is told as such in a bounded number of accesses.
    #[test]
    fn a_storm_without_an_end() {
        let schedule: Vec<usize> = (0..1_000).collect();
        let mut world = World::<6>::new(&schedule);
        let mut pairing = Pairing::<6>::new();
        for _ in 0..8 {
            let before = world.accesses;
            let capture = pairing.read(&mut world);
            assert!(matches!(
                capture,
                Capture::Lost {
                    missed: 1..,
                    silent: 0
                }
            ));
            assert!(world.accesses - before <= PASSES * 6 * 4);
        }
    }

    /// A timer whose input is not connected is named, each time, and it is never
    /// filled in.
    #[test]
    fn a_timer_that_does_not_see_the_line() {
        let mut world = World::<3>::new(&[0, 50, 100, 101, 102, 103]);
        world.timers[1].cut_off = true;
        let mut pairing = Pairing::<3>::new();
        let mut lost = 0;
        while world.remaining().is_some() || world.timers[0].captured {
            match pairing.read(&mut world) {
                Capture::Lost { missed, silent: 1 } => lost += missed,
                Capture::Nothing => world.accesses += 1,
                other => panic!("{other:?}"),
            }
        }
        assert!((3..=6).contains(&lost), "{lost}");
    }
}
