//! Stamps of skip and trigger edges: to instants, and how many found no room.

use umi_core::encoder::stamp::Stamper;

use crate::clock;
use crate::machines;
use crate::machines::{PIO_LAG_CYCLES, Started};
use crate::plan::CYCLES_PER_US;

/// Bits of time in a stamp.
const TIME_BITS: u32 = 24;
/// Cycles from one look at the pin to the next.
const STEP_CYCLES: u32 = 2;

/// An edge.
pub struct Edge {
    /// When it was: half a step from what is known of it, at most.
    pub at_cycles: Option<u64>,
    /// Edges before it that found no room.
    pub missed: u32,
}

/// What a machine has stamped.
pub struct Stamps {
    machine: usize,
    stamper: Stamper<TIME_BITS, STEP_CYCLES>,
    /// The number of the next edge.
    next: u8,
    /// Edges that were told as missed before their number was known.
    told: u32,
    /// A stamp found no room, and none has come since that tells how many.
    suspected: bool,
}

impl Stamps {
    /// Of a machine, not started.
    pub const fn new(machine: usize) -> Self {
        Self {
            machine,
            stamper: Stamper::new(0, CYCLES_PER_US),
            next: 0,
            told: 0,
            suspected: false,
        }
    }

    /// The machines were started, for the first time or again.
    pub fn started(&mut self, start: Started) {
        // An edge is on average one cycle before the look that finds it.
        let half = u64::from(STEP_CYCLES / 2);
        let first = start.at_cycles + PIO_LAG_CYCLES - half;
        self.stamper = Stamper::new(first, 2 * CYCLES_PER_US);
        self.next = 0;
        self.told = 0;
        self.suspected = false;
    }

    /// The next edge that waits.
    #[inline(always)]
    pub fn take(&mut self) -> Option<Edge> {
        let word = machines::stamp(self.machine)?;
        // After it: an edge may come while another is at work, and none is in the future.
        let now_cycles = clock::now_cycles();
        let number = !(word >> TIME_BITS) as u8;
        let missed = u32::from(number.wrapping_sub(self.next));
        self.next = number.wrapping_add(1);
        let untold = missed.saturating_sub(self.told);
        if missed > 0 {
            self.told = 0;
            self.suspected = false;
            machines::stamps_dropped(self.machine);
        }
        let time = !word & ((1 << TIME_BITS) - 1);
        Some(Edge {
            at_cycles: self.stamper.instant(time, now_cycles),
            missed: untold,
        })
    }

    /// Edges that were missed and that no other edge has told, at least. To be called
    /// now and then: what is missed is told the second time.
    pub fn untold(&mut self) -> u32 {
        if self.suspected {
            self.suspected = false;
            self.told += 1;
            return 1;
        }
        self.suspected = machines::stamps_dropped(self.machine);
        0
    }
}
