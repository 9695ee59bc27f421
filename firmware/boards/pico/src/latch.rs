//! Captures: the axes at the instant of an edge.
//!
//! ```text
//! edge ──► PIO: stamp ──► interrupt ──► instant ──► slot of the rings ──► capture ──► task
//!                              └─ may be 80 us late: the samples of the edge are still there
//! ```
//!
//! # Design
//!
//! One state, in one critical section at a time: the two interrupts of the highest
//! priority have it nearly always, tasks for a moment. Captures wait in the queue that
//! all boards have ([`umi_drivers::latches`]), which also counts what was missed.
//!
//! # Tradeoffs
//!
//! Whoever holds a critical section delays captures, but none is lost by it as long as
//! it is shorter than a ring: 80 us. Nothing here holds one for longer than a few.

use core::cell::RefCell;

use critical_section::Mutex;
use embassy_rp::interrupt;
use embassy_rp::interrupt::InterruptExt;
use umi_app::board::{Axes, Scanner, Unsupported};
use umi_protocol::latch::{LatchCause, Positions, TriggerOut};

use crate::pins::{AXES, INDEX, INDEXED, TRIGGER_OUT, WATCHED};
use crate::plan::{
    CAPTURE, Cycles, EXTEND_US, PERIOD_CYCLES, SKIP_MACHINE, TICK_US, TRIGGER_MACHINE,
};
use crate::quadrature::Quadrature;
use crate::stamps::Stamps;
use crate::trigger_out::Pulses;
use crate::watched::Watched;
use crate::{clock, machines, rings, tick};

/// Captures on their way to the application.
pub static CAPTURES: umi_drivers::latches::Latches = umi_drivers::latches::Latches::new();

/// Stamps taken in one interrupt, of each line: what a FIFO holds.
const STAMPS_AT_ONCE: usize = 8;
/// In which the FIFO of a decoder that nobody reads is full: eight words, and two more.
const FULL_CYCLES: u32 = 10 * PERIOD_CYCLES.get();

struct Latches {
    axes: Quadrature,
    skip: Stamps,
    trigger: Stamps,
    watched: Watched,
    pulses: Pulses,
    /// Ticks until the positions are looked at.
    until_look: u32,
}

static LATCHES: Mutex<RefCell<Latches>> = Mutex::new(RefCell::new(Latches {
    axes: Quadrature::new(),
    skip: Stamps::new(SKIP_MACHINE),
    trigger: Stamps::new(TRIGGER_MACHINE),
    watched: Watched::new(),
    pulses: Pulses::Off,
    until_look: 0,
}));

/// Starts counting and capturing. The pins are inputs by now.
pub fn start() {
    machines::prepare();
    with(Latches::start);
    tick::start();
    interrupt::PIO1_IRQ_0.set_priority(CAPTURE);
    // SAFETY: its handler is below; no critical section depends on it being off.
    unsafe { interrupt::PIO1_IRQ_0.enable() };
}

/// The state, if nobody has it: nobody can, in a critical section.
fn with<R>(work: impl FnOnce(&mut Latches) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut latches = LATCHES.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut latches))
    })
}

/// A stamp or an event has come.
#[interrupt]
fn PIO1_IRQ_0() {
    with(Latches::capture);
}

/// To be called each time the tick's timer is over. Returns when it should be again.
pub fn ticked() -> u32 {
    with(Latches::tick).unwrap_or(EXTEND_US)
}

impl Latches {
    /// Starts all machines, for the first time or after a loss.
    fn start(&mut self) {
        // Without transfers the FIFOs fill, and each decoder stands still at its next push:
        // there what it has counted is whole. Anywhere else it may be half an increment.
        rings::abort();
        cortex_m::asm::delay(FULL_CYCLES);
        machines::stop();
        rings::arm();
        let start = machines::start();
        self.axes.started(start);
        self.skip.started(start);
        self.trigger.started(start);
        self.watched.started(start);
    }

    /// Takes in what the machines have stamped.
    fn capture(&mut self) {
        for _ in 0..STAMPS_AT_ONCE {
            let Some(edge) = self.skip.take() else {
                break;
            };
            self.edge(LatchCause::Skip, edge.at_cycles, edge.missed);
        }
        for _ in 0..STAMPS_AT_ONCE {
            let Some(edge) = self.trigger.take() else {
                break;
            };
            self.edge(LatchCause::Trigger, edge.at_cycles, edge.missed);
        }
        // A line that goes on must not keep the processor: it waits for the next tick, and
        // its machine counts what finds no room.
        machines::leave_busy_stamps();
        match self.watched.look() {
            Ok(rises) => {
                for rise in rises.iter().rev() {
                    if let Some(cause) = cause_of(rise.pin) {
                        self.edge(cause, Some(rise.at_cycles), 0);
                    }
                }
            }
            Err(_) => self.axes.too_late(),
        }
    }

    /// An edge; `missed` others came before it.
    #[inline(always)]
    fn edge(&self, cause: LatchCause, at_cycles: Option<u64>, missed: u32) {
        let t_ns = Cycles::ns(at_cycles.unwrap_or_else(clock::now_cycles));
        match at_cycles.map(|at| self.axes.at(at)) {
            Some(Ok(counts)) => {
                CAPTURES.captured(cause, t_ns, counts.into_iter().collect(), missed);
            }
            _ => CAPTURES.lost(cause, t_ns, missed.saturating_add(1)),
        }
    }

    /// What must be done regularly. Returns when the next tick should come.
    fn tick(&mut self) -> u32 {
        let skipped = self.pulses.tick(&self.axes);
        missed(LatchCause::Output, skipped);
        if self.until_look == 0 {
            self.look();
        }
        let tick_us = if self.pulses.is_on() {
            TICK_US
        } else {
            EXTEND_US
        };
        let ticks = EXTEND_US / tick_us;
        self.until_look = match self.until_look {
            0 => ticks - 1,
            waiting => (waiting - 1).min(ticks - 1),
        };
        tick_us
    }

    fn look(&mut self) {
        machines::listen();
        self.watched.advance(clock::now_cycles());
        if !self.axes.look() {
            self.start();
        }
        missed(LatchCause::Skip, self.skip.untold());
        missed(LatchCause::Trigger, self.trigger.untold());
    }

    fn set_pulses(&mut self, spec: TriggerOut) -> Result<(), Unsupported> {
        let (counts, _) = self.axes.latest();
        let pulses = Pulses::new(spec, &counts)?;
        machines::stop_pulses();
        self.pulses = pulses;
        self.until_look = 0;
        Ok(())
    }

    fn positions(&self) -> Positions {
        let (counts, taken_cycles) = self.axes.latest();
        Positions {
            counts: counts.into_iter().collect(),
            t_ns: Cycles::ns(taken_cycles),
            illegal: self.axes.illegal().into_iter().collect(),
            lost_samples: self.axes.lost(),
        }
    }
}

/// Edges that came without a capture.
fn missed(cause: LatchCause, edges: u32) {
    if edges > 0 {
        CAPTURES.lost(cause, Cycles::ns(clock::now_cycles()), edges);
    }
}

/// What a rise of a watched pin means.
fn cause_of(pin: u8) -> Option<LatchCause> {
    const FIRST_INDEX: u8 = INDEX - WATCHED;
    const PULSE_PIN: u8 = TRIGGER_OUT - WATCHED;
    match pin {
        PULSE_PIN => Some(LatchCause::Output),
        _ => {
            let axis = pin.checked_sub(FIRST_INDEX)?;
            (usize::from(axis) < INDEXED).then_some(LatchCause::Index { axis })
        }
    }
}

/// The axes now, and what a scanner is told: for the task that serves the host.
pub struct Station {
    laser: embassy_rp::gpio::Output<'static>,
}

impl Station {
    /// With the output that enables the laser, which is off.
    pub fn new(laser: embassy_rp::gpio::Output<'static>) -> Self {
        Self { laser }
    }
}

impl Axes for Station {
    fn positions(&mut self) -> Positions {
        with(|latches| latches.positions()).unwrap_or_default()
    }
}

impl Scanner for Station {
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), Unsupported> {
        let set = with(|latches| latches.set_pulses(when)).unwrap_or(Err(Unsupported));
        tick::soon();
        set
    }

    fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
        self.laser.set_level(on.into());
        Ok(())
    }
}

const _: () = assert!(AXES <= umi_protocol::latch::MAX_AXES);
