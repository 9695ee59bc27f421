//! Edge stamps of skip and trigger as instants, and the count of lost ones.

use umi_core::capture::stamp::Stamper;
use umi_core::units::Cycles;

use crate::clock;
use crate::pio;
use crate::pio::{PIO_LAG_CYCLES, Started};
use crate::quadrature::{AxisCounts, Gone, Quadrature};
use crate::resources::CYCLES_PER_US;

/// Bits of time in a stamp; above them is the edge's number.
const TIME_BITS: u32 = 19;
const NUMBER: u32 = u32::MAX >> TIME_BITS;
/// Cycles from one look at the pin to the next.
const STEP_CYCLES: u32 = 2;

/// An edge, and where the axes were at it.
pub struct Edge {
    /// When it was: half a step from what is known of it, at most.
    pub at: Cycles,
    /// The axes.
    pub counts: AxisCounts,
    /// Edges before it that found no room, or whose positions were gone.
    pub missed: u32,
}

/// An edge as it was stamped.
struct Stamp {
    at: Option<Cycles>,
    /// When it was taken.
    taken: Cycles,
    /// Edges before it that found no room.
    missed: u32,
}

/// Words that the machine's FIFO holds.
const FIFO: usize = 8;

/// What a machine has stamped.
pub struct Stamps {
    machine: usize,
    stamper: Stamper<TIME_BITS, STEP_CYCLES>,
    /// The number of the next edge.
    next: u32,
    /// Edges that were told as missed before their number was known.
    told: u32,
    /// A stamp found no room, and none has come since that tells how many.
    suspected: bool,
    /// Edges that were looked at too late, and those that found no room before them.
    gone: u32,
}

impl Stamps {
    /// Of a machine, not started.
    pub const fn new(machine: usize) -> Self {
        Self {
            machine,
            stamper: Stamper::new(Cycles(0), 2 * CYCLES_PER_US),
            next: 0,
            told: 0,
            suspected: false,
            gone: 0,
        }
    }

    /// The machines were started, for the first time or again.
    pub fn started(&mut self, start: Started) {
        // An edge is on average one cycle before the look that finds it.
        let half = u64::from(STEP_CYCLES / 2);
        let first = start.at.after(PIO_LAG_CYCLES).before(half);
        self.stamper = Stamper::new(first, 2 * CYCLES_PER_US);
        self.next = 0;
        self.told = 0;
        self.suspected = false;
    }

    /// The next edge that waits; Gone: the positions at it are not there any more.
    #[inline(always)]
    pub fn take(&mut self, axes: &Quadrature) -> Option<Result<Edge, Gone>> {
        let stamp = self.stamp()?;
        self.gone = self.gone.saturating_add(stamp.missed);
        let at = stamp.at.ok_or(Gone);
        match at.and_then(|at| axes.at(at, stamp.taken).map(|counts| (at, counts))) {
            Ok((at, counts)) => Some(Ok(Edge {
                at,
                counts,
                missed: core::mem::take(&mut self.gone),
            })),
            Err(Gone) => {
                self.gone = self.gone.saturating_add(1);
                Some(Err(Gone))
            }
        }
    }

    /// Edges that are gone, and that no other edge has told.
    pub fn gone(&mut self) -> u32 {
        core::mem::take(&mut self.gone)
    }

    fn stamp(&mut self) -> Option<Stamp> {
        let (word, missed) = self.word()?;
        // After it: an edge may come while another is at work, and none is in the future.
        let taken = clock::now_cycles();
        let time = !word & ((1 << TIME_BITS) - 1);
        Some(Stamp {
            at: self.stamper.instant(time, taken),
            taken,
            missed,
        })
    }

    /// What is stamped, and how many edges before it found no room and are not told.
    #[inline(always)]
    fn word(&mut self) -> Option<(u32, u32)> {
        let word = pio::stamp(self.machine)?;
        let number = !word >> TIME_BITS;
        let missed = number.wrapping_sub(self.next) & NUMBER;
        self.next = number.wrapping_add(1);
        let untold = missed.saturating_sub(self.told);
        if missed > 0 {
            self.told = 0;
            self.suspected = false;
            pio::stamps_dropped(self.machine);
        }
        Some((word, untold))
    }

    /// Drops every edge that waits: it is gone.
    pub fn drop_all(&mut self) {
        for _ in 0..FIFO {
            let Some((_, missed)) = self.word() else {
                break;
            };
            self.gone = self.gone.saturating_add(missed).saturating_add(1);
        }
    }

    /// Gives up every edge that was counted and not taken, when the machines stand still
    /// before they are started again. Returns how many; one that the machine was at in
    /// that cycle may be left out.
    pub fn give_up(&mut self) -> u32 {
        self.drop_all();
        let uncounted = pio::edges_counted(self.machine).wrapping_sub(self.next) & NUMBER;
        self.gone()
            .saturating_add(uncounted.saturating_sub(self.told))
    }

    /// To be called each [`crate::resources::EXTEND_US`]. Returns edges that were missed and that
    /// no other edge has told, at least: the second time.
    pub fn look(&mut self, now: Cycles) -> u32 {
        self.stamper.advance(now);
        if self.suspected {
            self.suspected = false;
            self.told += 1;
            return 1;
        }
        self.suspected = pio::stamps_dropped(self.machine);
        0
    }
}
