//! Index marks and trigger pulses: changes of their pins, stamped.
//!
//! # Design
//!
//! A machine looks at the pins when the decoders look at theirs, and stamps each change.
//! The position of a rise is that of the sample in which it was seen: half a period from
//! the edge, at most.
//!
//! Noise on one pin can overrun the machine, which then drops stamps of all. A stamp says
//! itself what has risen, so one behind a gap is as true as any other; that there was a gap
//! its flag says, and which index marks may have been in it the pins' own detectors.

use umi_core::capture::stamp::Stamper;
use umi_core::units::Cycles;

use crate::capture::pio;
use crate::capture::pio::{PIO_LAG_CYCLES, Started};
use crate::capture::quadrature::{AxisCounts, Quadrature};
use crate::pins::{INDEX, INDEXED, WATCHED, WATCHED_COUNT, is_among};
use crate::resources::{CYCLES_PER_US, EVENTS_MACHINE, PERIOD_CYCLES};
use crate::time::clock;

/// Bits of time in a stamp; above them are the levels of the look before, and of this one.
const TIME_BITS: u32 = 22;
const LEVELS: u32 = u32::MAX >> (u32::BITS - WATCHED_COUNT as u32);
const _: () = assert!(TIME_BITS + 2 * WATCHED_COUNT as u32 == u32::BITS);
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
    pub at: Option<(Cycles, AxisCounts)>,
}

impl Rises {
    /// The pins, counted from the first that is watched.
    pub fn pins(&self) -> impl Iterator<Item = u8> + use<> {
        let pins = self.pins;
        (0..WATCHED_COUNT).filter(move |pin| is_among(*pin, pins))
    }
}

/// What the machine has stamped.
pub struct EdgePins {
    stamper: Stamper<TIME_BITS, { PERIOD_CYCLES.get() }>,
    /// Index marks that came before the latest look, and after the one before that.
    marks: u32,
}

impl EdgePins {
    /// Not started.
    pub const fn new() -> Self {
        Self {
            stamper: Stamper::new(Cycles(0), 2 * CYCLES_PER_US),
            marks: 0,
        }
    }

    /// The machines were started, for the first time or again.
    pub fn started(&mut self, start: Started) {
        // An edge is on average half a period before the look that finds it.
        let half = u64::from(PERIOD_CYCLES.get() / 2);
        let first = start.at.after(PIO_LAG_CYCLES + FIRST_LOOK_CYCLES);
        let first = first.before(half);
        self.stamper = Stamper::new(first, 2 * CYCLES_PER_US);
    }

    /// The next rises that wait. Falls before them are passed over: a pulse that is longer than
    /// its interrupt takes another one for its end, which must cost little.
    #[inline(always)]
    pub fn take(&self, axes: &Quadrature) -> Option<Rises> {
        for _ in 0..FIFO {
            let word = pio::take_stamp(EVENTS_MACHINE)?;
            let pins = risen(word);
            if pins == 0 {
                continue;
            }
            let now = clock::now_cycles();
            let time = !word & ((1 << TIME_BITS) - 1);
            let at = self.stamper.instant(time, now);
            let at = at.and_then(|at| Some((at, axes.at(at, now).ok()?)));
            return Some(Rises { pins, at });
        }
        None
    }

    /// Gives up every rise that waits, pin by pin.
    pub fn give_up(&self, gone: impl Fn(u8)) {
        for _ in 0..FIFO {
            let Some(word) = pio::take_stamp(EVENTS_MACHINE) else {
                break;
            };
            let pins = risen(word);
            Rises { pins, at: None }.pins().for_each(&gone);
        }
    }

    /// To be called each [`crate::resources::EXTEND_US`]. If stamps found no room meanwhile,
    /// returns the index marks that came: each may have been among them, and nobody knows
    /// how often.
    pub fn look(&mut self, now: Cycles) -> Option<Rises> {
        self.stamper.advance(now);
        // In this order: of a stamp that was dropped before now, the edge is found.
        let dropped = pio::stamps_dropped(EVENTS_MACHINE);
        let pins = (INDEX..).take(INDEXED);
        let marks = pio::edges(pins).rises >> WATCHED;
        // A stamp is dropped some cycles after its edge, which may lie before a look.
        let before = core::mem::replace(&mut self.marks, marks);
        dropped.then_some(Rises {
            pins: marks | before,
            at: None,
        })
    }

    /// Before a start, when the machine stands still: index marks that may have found no
    /// room since the latest look.
    pub fn lost_before_start(&self) -> Rises {
        let all = u32::MAX >> (u32::BITS - INDEXED as u32) << (INDEX - WATCHED);
        let dropped = pio::stamps_dropped(EVENTS_MACHINE);
        Rises {
            pins: if dropped { all } else { 0 },
            at: None,
        }
    }
}

/// Pins that have risen by this stamp.
const fn risen(word: u32) -> u32 {
    let now = word >> (TIME_BITS + WATCHED_COUNT as u32);
    let before = word >> TIME_BITS & LEVELS;
    now & !before
}
