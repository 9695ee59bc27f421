//! Index marks and trigger pulses: changes of their pins, stamped.
//!
//! # Design
//!
//! A machine looks at the pins when the decoders look at theirs, and stamps each change.
//! The position of a rise is that of the sample in which it was seen: half a period from
//! the edge, at most.
//!
//! The first look after a start is stamped, too, and says what the levels are.

use umi_core::encoder::stamp::Stamper;

use crate::clock;
use crate::machines;
use crate::machines::{PIO_LAG_CYCLES, Started};
use crate::pins::WATCHED_COUNT;
use crate::plan::{CYCLES_PER_US, EVENTS_MACHINE, PERIOD_CYCLES};
use crate::quadrature::{Counts, Quadrature};

/// Bits of time in a stamp.
const TIME_BITS: u32 = 27;
/// From the machine's first cycle to its first look.
const FIRST_LOOK_CYCLES: u64 = 1;

/// Words that the machine's FIFO holds.
const FIFO: usize = 8;

/// Pins that rose at once.
pub struct Rises {
    /// One bit each, from the first pin that is watched.
    pins: u32,
    /// When, half a period from what is known of it at most, and where the axes were. None:
    /// it is gone.
    pub at: Option<(u64, Counts)>,
}

impl Rises {
    /// The pins, counted from the first that is watched.
    pub fn pins(&self) -> impl Iterator<Item = u8> + use<> {
        let pins = self.pins;
        (0..WATCHED_COUNT).filter(move |pin| pins & 1 << pin != 0)
    }
}

/// What the machine has stamped.
pub struct Watched {
    stamper: Stamper<TIME_BITS, { PERIOD_CYCLES.get() }>,
    /// The pins' levels at the latest stamp since the start.
    levels: Option<u32>,
    /// Pins that have changed lately.
    busy: u32,
}

impl Watched {
    /// Not started.
    pub const fn new() -> Self {
        Self {
            stamper: Stamper::new(0, 2 * CYCLES_PER_US),
            levels: None,
            busy: 0,
        }
    }

    /// The machines were started, for the first time or again.
    pub fn started(&mut self, start: Started) {
        // An edge is on average half a period before the look that finds it.
        let half = u64::from(PERIOD_CYCLES.get() / 2);
        let first = start.at_cycles + PIO_LAG_CYCLES + FIRST_LOOK_CYCLES - half;
        self.stamper = Stamper::new(first, 2 * CYCLES_PER_US);
        self.levels = None;
        self.busy = 0;
    }

    /// The next change that waits; if pins fell, none rises.
    #[inline(always)]
    pub fn take(&mut self, axes: &Quadrature) -> Option<Rises> {
        let word = machines::stamp(EVENTS_MACHINE)?;
        let now_cycles = clock::now_cycles();
        let pins = self.risen(word);
        let mut at = None;
        if pins != 0 {
            let time = !word & ((1 << TIME_BITS) - 1);
            at = self.stamper.instant(time, now_cycles);
        }
        let at = at.and_then(|at| Some((at, axes.at(at, now_cycles).ok()?)));
        Some(Rises { pins, at })
    }

    /// Pins that have risen by this stamp.
    fn risen(&mut self, word: u32) -> u32 {
        let levels = word >> TIME_BITS;
        let before = self.levels.replace(levels).unwrap_or(levels);
        self.busy |= levels ^ before;
        levels & !before
    }

    /// Gives up every rise that waits, pin by pin.
    pub fn give_up(&mut self, gone: impl Fn(u8)) {
        for _ in 0..FIFO {
            let Some(word) = machines::stamp(EVENTS_MACHINE) else {
                break;
            };
            let pins = self.risen(word);
            Rises { pins, at: None }.pins().for_each(&gone);
        }
    }

    /// To be called each [`crate::plan::EXTEND_US`]. If changes found no room meanwhile,
    /// returns the pins that have changed: each may have risen again, and nobody knows how
    /// often.
    pub fn look(&mut self, now_cycles: u64) -> Rises {
        self.stamper.advance(now_cycles);
        let busy = core::mem::take(&mut self.busy);
        let dropped = machines::stamps_dropped(EVENTS_MACHINE);
        Rises {
            pins: if dropped { busy } else { 0 },
            at: None,
        }
    }
}
