//! Edge stamps of skip and trigger as instants, and the count of lost ones.

use umi_core::capture::stamp::Stamper;
use umi_core::units::Cycles;

use crate::capture::pio;
use crate::capture::pio::programs::stamp::{LOST_AT_EDGE, LOST_AT_FALL};
use crate::capture::pio::{PIO_LAG_CYCLES, Started};
use crate::capture::quadrature::{AxisCounts, Gone, Quadrature};
use crate::resources::CYCLES_PER_US;
use crate::time::clock;

/// Bits of time in a stamp; above them is the edge's number.
const TIME_BITS: u32 = 19;
const NUMBER: u32 = u32::MAX >> TIME_BITS;
/// Cycles from one look at the pin to the next.
const STEP_CYCLES: u32 = 2;

/// Which edges of its line a machine stamps.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Stamped {
    /// Rises and falls: every other one is a rise.
    Both,
    /// Rises alone.
    Rises,
}

/// Edges that were lost.
#[derive(Clone, Copy, Default)]
pub struct LostEdges {
    /// Rises among them.
    pub rises: u32,
    /// Falls.
    pub falls: u32,
}

impl LostEdges {
    const fn and(self, more: Self) -> Self {
        Self {
            rises: self.rises.saturating_add(more.rises),
            falls: self.falls.saturating_add(more.falls),
        }
    }
}

/// An edge, and where the axes were at it.
pub struct Edge {
    /// When it was: half a step from what is known of it, at most.
    pub at: Cycles,
    /// The axes.
    pub counts: AxisCounts,
    /// Whether the line rose.
    pub rises: bool,
    /// Edges before it that found no room, or whose positions were gone.
    pub missed: LostEdges,
}

/// Words that the machine's FIFO holds.
const FIFO: usize = 8;

/// What a machine has stamped.
pub struct Stamps {
    machine: usize,
    stamped: Stamped,
    stamper: Stamper<TIME_BITS, STEP_CYCLES>,
    /// The line was low when the machine was started: its first edge is a rise.
    began_low: bool,
    /// The number of the next edge, counted on beyond the bits of a stamp.
    next: u32,
    /// Edges that were told as missed before their number was known.
    told: u32,
    /// A stamp found no room, and none has come since that tells how many.
    suspected: bool,
    /// Edges that were looked at too late, and those that found no room before them.
    gone: LostEdges,
}

impl Stamps {
    /// Of a machine, not started.
    pub const fn new(machine: usize, stamped: Stamped) -> Self {
        Self {
            machine,
            stamped,
            stamper: Stamper::new(Cycles(0), 2 * CYCLES_PER_US),
            began_low: true,
            next: 0,
            told: 0,
            suspected: false,
            gone: LostEdges { rises: 0, falls: 0 },
        }
    }

    /// The machines were started, for the first time or again; whether the line was low then.
    pub fn started(&mut self, start: Started, began_low: bool) {
        // An edge is on average one cycle before the look that finds it.
        let half = u64::from(STEP_CYCLES / 2);
        let first = start.at.after(PIO_LAG_CYCLES).before(half);
        self.stamper = Stamper::new(first, 2 * CYCLES_PER_US);
        self.began_low = began_low;
        self.next = 0;
        self.told = 0;
        self.suspected = false;
    }

    /// The next edge that waits; Gone: the positions at it are not there any more.
    #[inline(always)]
    pub fn take(&mut self, axes: &Quadrature) -> Option<Result<Edge, Gone>> {
        let (word, number) = self.word()?;
        // After it: an edge may come while another is at work, and none is in the future.
        let taken = clock::now_cycles();
        // Where a stamp takes longer than its time counts, the difference is given back.
        let time = (!word).wrapping_add(self.lost_counts(number));
        let at = self.stamper.instant(time, taken).ok_or(Gone);
        let rises = self.rises(number);
        match at.and_then(|at| axes.at(at, taken).map(|counts| (at, counts))) {
            Ok((at, counts)) => Some(Ok(Edge {
                at,
                counts,
                rises,
                missed: core::mem::take(&mut self.gone),
            })),
            Err(Gone) => {
                self.gone = self.gone.and(self.edges(number, 1));
                Some(Err(Gone))
            }
        }
    }

    /// Edges that are gone, and that no other edge has told.
    pub fn gone(&mut self) -> LostEdges {
        core::mem::take(&mut self.gone)
    }

    /// Counts of time that the edges before this one have cost.
    const fn lost_counts(&self, number: u32) -> u32 {
        let stamped = number.wrapping_mul(LOST_AT_EDGE);
        let falls = match self.stamped {
            Stamped::Both => 0,
            // Between two rises there is a fall.
            Stamped::Rises => number.wrapping_add(!self.began_low as u32),
        };
        stamped.wrapping_add(falls.wrapping_mul(LOST_AT_FALL))
    }

    /// Whether the edge of this number is a rise.
    const fn rises(&self, number: u32) -> bool {
        match self.stamped {
            Stamped::Both => number.is_multiple_of(2) == self.began_low,
            Stamped::Rises => true,
        }
    }

    /// So many edges from this one on.
    const fn edges(&self, first: u32, count: u32) -> LostEdges {
        match self.stamped {
            Stamped::Both => {
                let like_first = count.div_ceil(2);
                let others = count / 2;
                if self.rises(first) {
                    LostEdges {
                        rises: like_first,
                        falls: others,
                    }
                } else {
                    LostEdges {
                        rises: others,
                        falls: like_first,
                    }
                }
            }
            Stamped::Rises => LostEdges {
                rises: count,
                falls: 0,
            },
        }
    }

    /// Edges from the next on that found no room, without those that are told already.
    const fn untold(&self, count: u32) -> LostEdges {
        let told = if self.told < count { self.told } else { count };
        self.edges(self.next.wrapping_add(told), count - told)
    }

    /// What is stamped, and its number. What found no room before it, and is not told, is gone.
    #[inline(always)]
    fn word(&mut self) -> Option<(u32, u32)> {
        let word = pio::take_stamp(self.machine)?;
        let missed = (!word >> TIME_BITS).wrapping_sub(self.next) & NUMBER;
        if missed > 0 {
            self.gone = self.gone.and(self.untold(missed));
            self.told = 0;
            self.suspected = false;
            pio::stamps_dropped(self.machine);
        }
        let number = self.next.wrapping_add(missed);
        self.next = number.wrapping_add(1);
        Some((word, number))
    }

    /// Drops every edge that waits: it is gone.
    pub fn drop_all(&mut self) {
        for _ in 0..FIFO {
            let Some((_, number)) = self.word() else {
                break;
            };
            self.gone = self.gone.and(self.edges(number, 1));
        }
    }

    /// Gives up every edge that was counted and not taken, when the machines stand still
    /// before they are started again. Returns how many; one that the machine was at in
    /// that cycle may be left out.
    pub fn give_up(&mut self) -> LostEdges {
        self.drop_all();
        let uncounted = pio::edges_counted(self.machine).wrapping_sub(self.next) & NUMBER;
        let untold = self.untold(uncounted);
        self.gone().and(untold)
    }

    /// To be called each [`crate::resources::EXTEND_US`]. Returns edges that were missed and that
    /// no other edge has told, at least: the second time.
    pub fn look(&mut self, now: Cycles) -> LostEdges {
        self.stamper.advance(now);
        if self.suspected {
            self.suspected = false;
            let lost = self.edges(self.next.wrapping_add(self.told), 1);
            self.told = self.told.saturating_add(1);
            return lost;
        }
        self.suspected = pio::stamps_dropped(self.machine);
        LostEdges::default()
    }
}
