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

use core::cell::RefCell;

use critical_section::Mutex;
use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt;
use umi_app::board::{self, Unsupported};
use umi_core::capture::join_timers::{Capture, Pairing};
use umi_core::capture::stamp::Rate;
use umi_core::capture::unwrap::Extender;
use umi_core::units::{Counts, Cycles};
use umi_drivers::latches::Latches;
use umi_protocol::latch::{LatchCause, Positions, TriggerOut, TriggerRefusal};

use crate::resources::{AXES, COUNTS_PER_S, LOOK_US, TIMER_HZ, TIMERS};
use crate::timers::{self, CaptureLine};

/// Captures on their way to the application.
pub static LATCHES: Latches = Latches::new();

static STATE: Mutex<RefCell<State>> = Mutex::new(RefCell::new(State {
    axes: [Extender::new(0); AXES],
    clock: Extender::new(0),
    skip: Pairing::new(),
    trigger: Pairing::new(),
}));

// A look may be late by as much again as it is long, and a capture that waits for it is
// still extended rightly.
const _: () = assert!(Extender::<16>::longest_gap_us(COUNTS_PER_S) > 3 * LOOK_US);
const _: () = assert!(Extender::<32>::longest_gap_us(TIMER_HZ) > 3 * LOOK_US);

/// Captures that are read in one interrupt.
const AT_ONCE: usize = 4;

struct State {
    axes: [Extender<16>; AXES],
    clock: Extender<32>,
    skip: Pairing<TIMERS>,
    trigger: Pairing<TIMERS>,
}

impl State {
    /// Notes where the counters are.
    fn look(&mut self) {
        for (axis, count) in self.axes.iter_mut().zip(timers::counts()) {
            axis.look(count);
        }
        self.clock.look(timers::clock());
    }

    /// Reads what a line has captured.
    fn read(&mut self, mut line: CaptureLine) {
        let cause = match line {
            CaptureLine::Skip => LatchCause::Skip,
            CaptureLine::Trigger => LatchCause::Trigger,
        };
        for _ in 0..AT_ONCE {
            let pairing = match line {
                CaptureLine::Skip => &mut self.skip,
                CaptureLine::Trigger => &mut self.trigger,
            };
            match pairing.read(&mut line) {
                Capture::Nothing => return,
                Capture::Captured { values, missed } => {
                    let [.., clock] = values;
                    let counts = self.axes.iter().zip(values);
                    let counts = counts.map(|(axis, raw)| axis.captured(raw));
                    LATCHES.captured(cause, ns(self.clock.captured(clock)), counts, missed);
                }
                Capture::Lost { missed, silent } => {
                    LATCHES.lost(cause, self.now_ns(), missed);
                    if silent == 0 {
                        break;
                    }
                    defmt::warn!("{} of {} timers do not see the line", silent, TIMERS);
                }
            }
        }
        // They come too fast: the rest waits for the next look.
        timers::pause(line, true);
    }

    fn now_ns(&self) -> u64 {
        ns(self.clock.captured(timers::clock()))
    }
}

/// The clock's counter goes up once each cycle.
fn ns(Counts(cycles): Counts) -> u64 {
    Rate::<TIMER_HZ>::ns(Cycles(cycles.max(0).cast_unsigned()))
}

fn with<R>(work: impl FnOnce(&mut State) -> R) -> R {
    critical_section::with(|cs| work(&mut STATE.borrow(cs).borrow_mut()))
}

/// Time since the timers were started.
pub fn now_ns() -> u64 {
    with(|state| state.now_ns())
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
    /// The counters are read one after the other, within some 0.2 µs.
    fn positions(&mut self) -> Positions {
        with(|state| {
            state.look();
            Positions {
                counts: state.axes.iter().map(|axis| axis.position().0).collect(),
                t_ns: state.now_ns(),
                // The timers do not tell illegal transitions.
                illegal: heapless::Vec::new(),
                lost_samples: 0,
            }
        })
    }
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
