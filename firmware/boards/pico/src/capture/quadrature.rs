//! Axis positions at an instant, in 64 bits.
//!
//! # Design
//!
//! The samples hold the lowest bits of positions. A look each half millisecond extends
//! them, and any sample that is younger than a ring is extended from that look: an edge
//! and the interrupt that follows it need not agree on anything but the clock.
//!
//! The position of an edge is that of the sample nearest to it: at most half a period
//! away, 40 ns.

use umi_core::capture::sample_ring::SampleRing;
use umi_core::capture::unwrap::{Tally, nearest};
use umi_core::units::{Counts, Cycles};

use crate::capture::pio::{FIRST_SAMPLE_CYCLES, Started};
use crate::capture::{pio, rings};
use crate::pins::AXES;
use crate::resources::{CADENCE, CYCLES_PER_US, ILLEGAL_BITS, PERIOD_CYCLES, POSITION_BITS, SLOTS};
use crate::time::clock;

/// Positions of the axes at one instant.
pub type AxisCounts = [Counts; AXES];

/// The positions of that instant are gone.
#[derive(Clone, Copy, Debug)]
pub struct Gone;

/// The axes.
pub struct Quadrature {
    /// At the latest look.
    positions: AxisCounts,
    illegal: [Tally<ILLEGAL_BITS>; AXES],
    ring: SampleRing,
    grid: SampleGrid,
    /// A whole ring has been written since the machines were started.
    is_full: bool,
    /// Times at which samples were lost.
    lost: u32,
}

/// Where one axis was seen, for who foresees it.
#[derive(Clone, Copy)]
pub struct AxisSeen {
    /// At the latest sample.
    pub position: Counts,
    /// When that was taken.
    pub at: Cycles,
    /// Where it is.
    slot: u32,
}

impl AxisSeen {
    /// Cycles since that sample was taken, less than a ring's.
    #[inline(always)]
    pub fn age_cycles(&self) -> u32 {
        let samples = latest_slot().wrapping_sub(self.slot) % SLOTS as u32;
        samples * PERIOD_CYCLES.get() + LATEST_AGE_CYCLES
    }
}

/// From the pins to what [`latest_slot`] finds: two cycles of the synchroniser, two samples
/// and a half, and the way to the memory.
const LATEST_AGE_CYCLES: u32 = 28;

impl Quadrature {
    /// All axes at 0, not started.
    pub const fn new() -> Self {
        Self {
            positions: [Counts(0); AXES],
            illegal: [Tally::new(0); AXES],
            ring: SampleRing::new(CADENCE, Cycles(0)),
            grid: SampleGrid::new(Cycles(0)),
            is_full: false,
            lost: 0,
        }
    }

    /// The machines were started, for the first time or again.
    pub fn started(&mut self, start: Started) {
        let first = start.at.before(FIRST_SAMPLE_CYCLES);
        self.ring.restart(first, 0);
        self.grid = SampleGrid::new(first);
        self.is_full = false;
    }

    /// The axes at an instant that is past now.
    pub fn at(&self, instant: Cycles, now: Cycles) -> Result<AxisCounts, Gone> {
        let half = u64::from(PERIOD_CYCLES.get() / 2);
        let sample = self
            .ring
            .sample_at(instant.after(half), surely_past(now))
            .map_err(|_| Gone)?;
        let mut counts = self.positions;
        for (axis, position) in counts.iter_mut().enumerate() {
            *position = nearest::<POSITION_BITS>(*position, rings::read(axis, sample.slot));
        }
        // A sample that was lost moves all behind it: the next look starts anew.
        let is_there = surely_past(clock::now_cycles()) < sample.good_until;
        if is_there && !pio::stalled() {
            Ok(counts)
        } else {
            Err(Gone)
        }
    }

    /// The latest sample, and when it was taken.
    pub fn latest(&self) -> (AxisCounts, Cycles) {
        let slot = latest_slot();
        let taken = self.grid.instant(slot, clock::now_cycles());
        let mut counts = self.positions;
        for (axis, position) in counts.iter_mut().enumerate() {
            *position = nearest::<POSITION_BITS>(*position, rings::read(axis, slot));
        }
        (counts, taken)
    }

    /// Where an axis is. None: not yet known since the machines were started.
    pub fn seen(&self, axis: usize) -> Option<AxisSeen> {
        let slot = latest_slot();
        let known = self.positions.get(axis).filter(|_| self.is_full)?;
        Some(AxisSeen {
            position: nearest::<POSITION_BITS>(*known, rings::read(axis, slot)),
            at: self.grid.instant(slot, clock::now_cycles()),
            slot,
        })
    }

    /// Extends the positions, and holds the rings against the clock. False: samples
    /// were lost, and all machines must be started again.
    pub fn look(&mut self) -> bool {
        let before = clock::now_cycles();
        let slot = rings::write_slot(AXES - 1);
        let after = surely_past(clock::now_cycles());
        let in_step = self.ring.check(before, slot, after).is_ok() && !pio::stalled();
        let slot = latest_slot();
        // Counted by a range, which cannot overrun.
        let axes = self.positions.iter_mut().zip(&mut self.illegal);
        for (axis, (position, illegal)) in (0..AXES).zip(axes) {
            let word = rings::read(axis, slot);
            *position = nearest::<POSITION_BITS>(*position, word);
            illegal.look(!word >> POSITION_BITS);
        }
        self.grid.advance(before);
        if !in_step {
            self.lost = self.lost.saturating_add(1);
        }
        self.is_full = in_step;
        in_step
    }

    /// Transitions of each axis in which both signals changed at once.
    pub fn illegal(&self) -> [u32; AXES] {
        self.illegal.map(|tally| tally.total())
    }

    /// Times at which samples were lost.
    pub const fn lost(&self) -> u32 {
        self.lost
    }
}

/// An instant that is not before now: the timer is behind by up to a microsecond.
fn surely_past(now: Cycles) -> Cycles {
    now.after(CYCLES_PER_US.into())
}

/// Of the ring that is served last, and one more is left alone: its word may be on its
/// way to the memory.
fn latest_slot() -> u32 {
    rings::write_slot(AXES - 1).wrapping_sub(2) % SLOTS as u32
}

/// When the samples of a ring were taken.
#[derive(Clone, Copy)]
pub struct SampleGrid {
    /// When the sample of some slot 0 was taken.
    lap: Cycles,
}

impl SampleGrid {
    const LAP: u32 = CADENCE.lap_cycles() as u32;

    /// The sample of slot 0 was or will be taken at this instant.
    pub const fn new(first: Cycles) -> Self {
        Self { lap: first }
    }

    /// When the latest sample of a slot was taken. `now` may be off by a third of a lap.
    pub fn instant(&self, slot: u32, now: Cycles) -> Cycles {
        let since = now.before(self.lap.0).0 as u32;
        let number = since / PERIOD_CYCLES;
        // Slots are few: the difference has a sign in its lowest bits.
        let unused = u32::BITS - SLOTS.trailing_zeros();
        let ahead = (slot.wrapping_sub(number) << unused).cast_signed() >> unused;
        let cycles = i64::from(number).wrapping_add(ahead.into());
        let cycles = cycles.wrapping_mul(PERIOD_CYCLES.get().into());
        Cycles(self.lap.0.saturating_add_signed(cycles))
    }

    /// Keeps differences to the lap small. To be called at least each 2³¹ cycles.
    pub fn advance(&mut self, now: Cycles) {
        let since = now.before(self.lap.0).0 as u32;
        let laps = (since / Self::LAP).saturating_sub(1);
        self.lap = self.lap.after(u64::from(laps.wrapping_mul(Self::LAP)));
    }
}
