//! Index marks and trigger pulses, found in the samples of their pins.
//!
//! # Design
//!
//! The machine that samples says that something has changed; when, stands in its ring. A
//! look goes back from the latest sample to the one before which nothing has changed for
//! a while, or which has been looked at.

use heapless::Vec;

use crate::machines::{PIO_LAG_CYCLES, Started};
use crate::pins::WATCHED_COUNT;
use crate::plan::{EVENTS_RING, PERIOD_CYCLES, SLOTS};
use crate::quadrature::Grid;
use crate::{clock, machines, rings};

/// Samples without a change after which nothing older is looked for: 5 us.
const QUIET: u32 = 64;
/// Samples that are surely not overwritten meanwhile.
const OLDEST: u32 = SLOTS as u32 - 64;
/// Edges found in one look, at most.
pub const EDGES: usize = 8;

/// A rising edge.
#[derive(Clone, Copy)]
pub struct Rise {
    /// Of this pin, counted from the first that is watched.
    pub pin: u8,
    /// Half a period from what is known of it, at most.
    pub at_cycles: u64,
}

/// What has been looked at.
pub struct Watched {
    grid: Grid,
    /// Everything up to this instant.
    seen_cycles: u64,
}

impl Watched {
    /// Not started.
    pub const fn new() -> Self {
        Self {
            grid: Grid::new(0),
            seen_cycles: 0,
        }
    }

    /// The machines were started, for the first time or again.
    pub fn started(&mut self, start: Started) {
        let first = start.at_cycles + PIO_LAG_CYCLES;
        self.grid = Grid::new(first);
        self.seen_cycles = first;
    }

    /// Keeps differences small. To be called now and then.
    pub fn advance(&mut self, now_cycles: u64) {
        self.grid.advance(now_cycles);
    }

    /// Rising edges since the latest look, the latest first. Err: something has
    /// changed, but so long ago that its samples are overwritten, or too often.
    pub fn look(&mut self) -> Result<Vec<Rise, EDGES>, TooLate> {
        let mut rises = Vec::new();
        if !machines::changed() {
            return Ok(rises);
        }
        let newest = rings::write_slot(EVENTS_RING).wrapping_sub(1);
        let newest_cycles = self
            .grid
            .instant(newest % SLOTS as u32, clock::now_cycles());
        let unseen = newest_cycles.saturating_sub(self.seen_cycles) as u32 / PERIOD_CYCLES;
        let mut later = rings::read(EVENTS_RING, newest);
        let mut found = false;
        let mut quiet = 0;
        for back in 0..unseen.min(OLDEST) {
            let earlier = rings::read(EVENTS_RING, newest.wrapping_sub(back + 1));
            let changed = (earlier ^ later) & ((1 << WATCHED_COUNT) - 1);
            if changed != 0 {
                found = true;
                quiet = 0;
                let half = u64::from(PERIOD_CYCLES.get() / 2);
                let taken = u64::from(back * PERIOD_CYCLES.get());
                let at_cycles = newest_cycles.saturating_sub(taken + half);
                for pin in 0..WATCHED_COUNT {
                    if changed & later & 1 << pin != 0 {
                        rises.push(Rise { pin, at_cycles }).map_err(|_| TooLate)?;
                    }
                }
            } else {
                quiet += 1;
                if found && quiet >= QUIET {
                    break;
                }
            }
            later = earlier;
        }
        let late = !found && unseen > OLDEST;
        self.seen_cycles = newest_cycles;
        if late { Err(TooLate) } else { Ok(rises) }
    }
}

/// Nobody looked in time.
#[derive(Clone, Copy, Debug)]
pub struct TooLate;
