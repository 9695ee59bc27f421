//! Axes: positions of 64 bits, and captures at an edge.
//!
//! # Design
//!
//! Hardware does what must be quick: each encoder has a timer, and one edge captures all
//! timers and the clock in the same cycle. What is late here is only the reading. Which
//! captures belong together, and which of the positions with these 16 bits is meant, is
//! computed in `umi_core::capture`, where it is tested.
//!
//! Only the lower 16 bits of TIM2 are used, as of the other axes: one rule for all.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicUsize, Ordering};

use critical_section::Mutex;
use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt;
use umi_app::board::{self, Unsupported};
use umi_core::capture::direction::{DirectedEdge, Directions, LostByDirection};
use umi_core::capture::join_timers::{Capture, Pairing};
use umi_core::capture::stamp::Rate;
use umi_core::capture::unwrap::Extender;
use umi_core::units::{Counts, Cycles};
use umi_drivers::latches::Latches;
use umi_protocol::latch::{LatchCause, Positions, TriggerOut, TriggerRefusal};

use crate::resources::{AXES, COUNTS_PER_S, LOOK_US, TIMER_HZ, TIMERS};
use crate::timers::{self, CaptureLine};

/// Captures on their way to the application.
#[unsafe(link_section = ".dtcm")]
pub static LATCHES: Latches = Latches::new();

#[unsafe(link_section = ".dtcm")]
static STATE: Mutex<RefCell<State>> = Mutex::new(RefCell::new(State {
    axes: [Extender::new(0); AXES],
    skip: Pairing::new(),
    directions: Directions::new(),
    trigger: Pairing::new(),
}));

/// The clock, which everybody may read at any time.
#[unsafe(link_section = ".dtcm")]
static CLOCK: Mutex<Cell<Extender<32>>> = Mutex::new(Cell::new(Extender::new(0)));

/// Timers that have not seen an edge which others saw, until it is told.
#[unsafe(link_section = ".dtcm")]
static SILENT: AtomicUsize = AtomicUsize::new(0);

// A look may be late by as much again as it is long, and a capture that waits for it is
// still extended rightly.
const _: () = assert!(Extender::<16>::longest_gap_us(COUNTS_PER_S) > 3 * LOOK_US);
const _: () = assert!(Extender::<32>::longest_gap_us(TIMER_HZ) > 3 * LOOK_US);

/// Captures that are read in one interrupt.
const AT_ONCE: usize = 4;

struct State {
    axes: [Extender<16>; AXES],
    skip: Pairing<TIMERS>,
    directions: Directions,
    trigger: Pairing<TIMERS>,
}

impl State {
    /// Notes where the counters are.
    fn look(&mut self) {
        for (axis, count) in self.axes.iter_mut().zip(timers::counts()) {
            axis.look(count);
        }
        critical_section::with(|section| {
            let clock = CLOCK.borrow(section);
            let mut extended = clock.get();
            extended.look(timers::clock());
            clock.set(extended);
        });
    }

    /// Reads what a line has captured.
    fn read(&mut self, mut line: CaptureLine) {
        for _ in 0..AT_ONCE {
            let pairing = match line {
                CaptureLine::Skip => &mut self.skip,
                CaptureLine::Trigger => &mut self.trigger,
            };
            match pairing.read(&mut line) {
                Capture::Nothing => {
                    if matches!(line, CaptureLine::Skip)
                        && let Some(high) = timers::skip_level()
                    {
                        self.directions.rests(high);
                    }
                    return;
                }
                Capture::Captured { values, missed } => {
                    let [.., clock] = values;
                    let t_ns = ns(extended(clock));
                    let Some((cause, missed)) = self.cause(line, t_ns, missed) else {
                        continue;
                    };
                    let counts = self.axes.iter().zip(values);
                    let counts = counts.map(|(axis, raw)| axis.captured(raw));
                    LATCHES.captured(cause, t_ns, counts, missed);
                }
                Capture::Lost { missed, silent } => {
                    match line {
                        CaptureLine::Skip => skips_lost(now_ns(), self.directions.lost(missed)),
                        CaptureLine::Trigger => LATCHES.lost(LatchCause::Trigger, now_ns(), missed),
                    }
                    if silent == 0 {
                        break;
                    }
                    SILENT.store(silent, Ordering::Relaxed);
                }
            }
        }
        // They come too fast: the rest waits for the next look.
        timers::pause(line, true);
    }

    /// What a captured edge of a line means, and how many like it are lost before it. None: it is
    /// not known which way the line went, and the edge is told as lost.
    fn cause(&mut self, line: CaptureLine, t_ns: u64, missed: u32) -> Option<(LatchCause, u32)> {
        if matches!(line, CaptureLine::Trigger) {
            return Some((LatchCause::Trigger, missed));
        }
        match self.directions.edge(missed, timers::skip_level()) {
            DirectedEdge::Known { rises, lost } => {
                let (cause, missed, others) = match rises {
                    true => (
                        LatchCause::Skip,
                        lost.rises,
                        LostByDirection { rises: 0, ..lost },
                    ),
                    false => (
                        LatchCause::SkipEnd,
                        lost.falls,
                        LostByDirection { falls: 0, ..lost },
                    ),
                };
                skips_lost(t_ns, others);
                Some((cause, missed))
            }
            DirectedEdge::Unknown { lost } => {
                skips_lost(t_ns, lost);
                None
            }
        }
    }
}

/// Edges of the skip line that are told without positions.
fn skips_lost(t_ns: u64, lost: LostByDirection) {
    for (cause, missed) in [
        (LatchCause::Skip, lost.rises),
        (LatchCause::SkipEnd, lost.falls),
    ] {
        if missed > 0 {
            LATCHES.lost(cause, t_ns, missed);
        }
    }
}

/// What the clock's counter was, or is.
fn extended(raw: u32) -> Counts {
    critical_section::with(|section| CLOCK.borrow(section).get().captured(raw))
}

/// The clock's counter goes up once each cycle.
fn ns(Counts(cycles): Counts) -> u64 {
    Rate::<TIMER_HZ>::ns(Cycles(cycles.max(0).cast_unsigned()))
}

/// The state, if nobody has it: nobody can, in a critical section.
fn with<R>(work: impl FnOnce(&mut State) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut state = STATE.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut state))
    })
}

/// Time since the timers were started.
pub fn now_ns() -> u64 {
    critical_section::with(|_| ns(extended(timers::clock())))
}

/// An edge has captured the clock.
#[interrupt]
fn TIM5() {
    with(|state| {
        state.read(CaptureLine::Skip);
        state.read(CaptureLine::Trigger);
    });
}

/// It is time to look.
#[interrupt]
fn TIM7() {
    timers::looked();
    with(|state| {
        // What was captured before the look, against the look before.
        for line in [CaptureLine::Skip, CaptureLine::Trigger] {
            state.read(line);
            timers::pause(line, false);
        }
        state.look();
    });
}

/// Positions and outputs for the application.
pub struct Station {
    /// Enables the laser.
    pub laser: Output<'static>,
}

impl board::Axes for Station {
    fn positions(&mut self) -> Positions {
        positions()
    }
}

/// Where the axes are. The counters are read one after the other, within some 0.2 µs.
pub fn positions() -> Positions {
    let silent = SILENT.swap(0, Ordering::Relaxed);
    if silent > 0 {
        // Here, as a log that nobody fetches would hold an interrupt up.
        defmt::warn!("{} of {} timers do not see the line", silent, TIMERS);
    }
    with(|state| {
        state.look();
        Positions {
            counts: state.axes.iter().map(|axis| axis.position().0).collect(),
            t_ns: now_ns(),
            // The timers do not tell illegal transitions.
            illegal: heapless::Vec::new(),
            lost_samples: 0,
        }
    })
    .unwrap_or_default()
}

impl board::Scanner for Station {
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), TriggerRefusal> {
        match when {
            TriggerOut::Off => Ok(()),
            // Every capture channel is taken: a pulse could not be latched.
            TriggerOut::Time { .. } | TriggerOut::Distance { .. } => Err(TriggerRefusal::NoOutput),
        }
    }

    fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
        self.laser.set_level(on.into());
        Ok(())
    }
}
