//! Captures: the axes at the instant of an edge.
//!
//! ```text
//! edge ──► PIO: stamp ──► interrupt ──► instant ──► slot of the rings ──► lower interrupt ──► task
//!                              └─ may be 75 us late: the samples of the edge are still there
//! ```
//!
//! # Design
//!
//! One state, in one critical section at a time: the two interrupts of the highest
//! priority have it nearly always, others for a moment. Captures read positions and no more,
//! a few at a time, between which the control's UART has its turn. A lower interrupt puts
//! them into the queue that all boards have ([`umi_drivers::latches`]), which also counts
//! what was missed.
//!
//! # Tradeoffs
//!
//! Whoever holds a critical section delays captures, but none is lost by it as long as
//! it is shorter than a ring, 82 us. Nothing here holds one for longer than a few.
//!
//! A start after a loss takes 0.1 ms, by code from the flash. An edge that comes close to the stop,
//! or to the start, counts once too often rather than not at all; of many edges of a line that come
//! in it one of each kind is told at least.

use core::cell::RefCell;

use cortex_m_rt::interrupt;
use critical_section::Mutex;
use embassy_rp::interrupt;
use embassy_rp::interrupt::{Interrupt, InterruptExt};
use heapless::Deque;
use umi_app::board::{Axes, Scanner, Unsupported};
use umi_core::units::Cycles;
use umi_protocol::latch::{LatchCause, Positions, TriggerOut, TriggerRefusal};

use crate::capture::edge_pins::EdgePins;
use crate::capture::quadrature::{AxisCounts, Quadrature};
use crate::capture::rate_limit::RateLimit;
use crate::capture::stamps::{LostEdges, Stamped, Stamps};
use crate::capture::trigger_out::Pulses;
use crate::capture::{pio, rings, stamps, trigger_out};
use crate::pins::{AXES, INDEX, INDEXED, SKIP, TRIGGER_IN, TRIGGER_OUT, WATCHED, is_among};
use crate::resources::{
    CAPTURE, CONTROL_TASKS, CYCLES_PER_US, EXTEND_US, MOST_PULSE_CYCLES, PERIOD_CYCLES,
    SCANS_AT_ONCE, SCANS_PER_S, SERIAL, SKIP_MACHINE, SKIPS_AT_ONCE, SKIPS_PER_S, SystemClock,
    TICK_US, TRIGGER_MACHINE,
};
use crate::safety::guard;
use crate::time::clock;
use crate::time::tick;

/// Captures on their way to the application.
pub static CAPTURES: umi_drivers::latches::Latches = umi_drivers::latches::Latches::new();

/// Stamps taken in one interrupt: with more of them, a character from the control would be too late
/// out of the UART.
const AT_ONCE: usize = 2;
/// Edges that wait to be told.
const WAITING: usize = 32;
/// Its interrupt lets captures go on when the UART has had its turn.
const RESUME: Interrupt = Interrupt::SWI_IRQ_2;
/// Its interrupt puts captures into the queue. It has the priority of the tasks that take them out, and a
/// lower number, so that it comes first where these have no pause.
const TELL: Interrupt = Interrupt::SWI_IRQ_0;
/// Pins whose edges are captured, but not those of our own pulses.
#[allow(
    clippy::indexing_slicing,
    reason = "by the compiler: an index out of bounds does not compile"
)]
const INPUTS: [u8; 2 + INDEXED] = {
    let mut pins = [0; 2 + INDEXED];
    let mut index = 0;
    while index < INDEXED {
        pins[index] = INDEX + index as u8;
        index += 1;
    }
    pins[INDEXED] = SKIP;
    pins[INDEXED + 1] = TRIGGER_IN;
    pins
};
/// In which the FIFO of a decoder that nobody reads is full: eight words, and two more.
const FULL_CYCLES: u32 = 10 * PERIOD_CYCLES.get();

/// An edge that was captured.
struct Edge {
    cause: LatchCause,
    at: Cycles,
    counts: AxisCounts,
    /// Before it.
    missed: u32,
}

/// What a line causes when it rises, and when it falls: of triggers only rises are stamped.
#[derive(Clone, Copy)]
struct Causes {
    rise: LatchCause,
    fall: LatchCause,
}

const SKIPS: Causes = Causes {
    rise: LatchCause::Skip,
    fall: LatchCause::SkipEnd,
};
const TRIGGERS: Causes = Causes {
    rise: LatchCause::Trigger,
    fall: LatchCause::Trigger,
};

impl Edge {
    /// An edge; the other kind of those that were missed before it is told by itself.
    #[inline(always)]
    fn of(causes: Causes, edge: stamps::Edge) -> Self {
        let stamps::Edge {
            at,
            counts,
            rises,
            missed: before,
        } = edge;
        let (cause, before, other, others) = match rises {
            true => (causes.rise, before.rises, causes.fall, before.falls),
            false => (causes.fall, before.falls, causes.rise, before.rises),
        };
        missed(other, others);
        Self {
            cause,
            at,
            counts,
            missed: before,
        }
    }
}

struct Latches {
    axes: Quadrature,
    skip: Stamps,
    trigger: Stamps,
    watched: EdgePins,
    /// With their positions.
    edges: Deque<Edge, WAITING>,
    /// Captures of the probe that may still be made, and of a scanner's or of index marks.
    skips: RateLimit<SKIPS_AT_ONCE, SKIPS_PER_S>,
    scans: RateLimit<SCANS_AT_ONCE, SCANS_PER_S>,
    pulses: Pulses,
    /// There may have been pulses since the latest look.
    pulsed: bool,
    /// Ticks until the positions are looked at.
    until_look: u32,
}

static LATCHES: Mutex<RefCell<Latches>> = Mutex::new(RefCell::new(Latches {
    axes: Quadrature::new(),
    skip: Stamps::new(SKIP_MACHINE, Stamped::Both),
    trigger: Stamps::new(TRIGGER_MACHINE, Stamped::Rises),
    watched: EdgePins::new(),
    edges: Deque::new(),
    skips: RateLimit::new(),
    scans: RateLimit::new(),
    pulses: Pulses::Off,
    pulsed: false,
    until_look: 0,
}));

/// Starts counting and capturing. The pins are inputs by now.
pub fn start() {
    pio::prepare();
    rings::clear();
    with(Latches::start);
    tick::start();
    interrupt::PIO1_IRQ_0.set_priority(CAPTURE);
    RESUME.set_priority(SERIAL);
    TELL.set_priority(CONTROL_TASKS);
    // SAFETY: their handlers are below; no critical section depends on them being off.
    unsafe {
        RESUME.enable();
        TELL.enable();
        interrupt::PIO1_IRQ_0.enable();
    }
}

/// Starts all machines again, as after a loss of samples.
#[allow(dead_code, reason = "the self-test does it, ten thousand times")]
pub fn restart() {
    with(Latches::start_again);
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

/// There were more stamps than one interrupt may take.
#[interrupt]
fn SWI_IRQ_2() {
    with(|latches| latches.listen());
}

/// Edges have been taken in: they go to the application one by one.
#[interrupt]
fn SWI_IRQ_0() {
    while let Some(edge) = with(|latches| latches.edges.pop_front()).flatten() {
        let t_ns = SystemClock::ns(edge.at);
        CAPTURES.captured(edge.cause, t_ns, edge.counts, edge.missed);
    }
}

/// Serves the tick: the guard, then positions and pulses.
fn ticked() {
    let due_us = tick::acknowledge();
    guard::ticked(tick::now_us());
    tick::again(due_us, with(Latches::tick).unwrap_or(EXTEND_US));
}

#[cfg(not(feature = "rp2350"))]
#[interrupt]
fn TIMER_IRQ_1() {
    ticked();
}

#[cfg(feature = "rp2350")]
#[interrupt]
fn TIMER0_IRQ_1() {
    ticked();
}

impl Latches {
    /// Starts all machines.
    fn start(&mut self) {
        pio::halt();
        let high = pio::reset();
        rings::arm();
        let start = pio::start();
        self.axes.started(start);
        self.skip.started(start, high & 1 << SKIP == 0);
        self.trigger.started(start, high & 1 << TRIGGER_IN == 0);
        self.watched.started(start);
    }

    /// Starts all machines again after a loss. Every edge meanwhile is missed: where the
    /// axes were at it is not known.
    fn start_again(&mut self) {
        // Without transfers the FIFOs fill, and each decoder stands still at its next push:
        // there what it has counted is whole. Anywhere else it may be half an increment.
        rings::abort();
        cortex_m::asm::delay(FULL_CYCLES);
        pio::edges(INPUTS.into_iter());
        pio::halt();
        all_missed(SKIPS, self.skip.give_up());
        all_missed(TRIGGERS, self.trigger.give_up());
        self.watched.give_up(watched_missed);
        let lost = self.watched.lost_before_start();
        lost.pins().for_each(watched_missed);
        if self.pulses.is_on() {
            missed(LatchCause::Output, 1);
        }
        self.start();
        let edges = pio::edges(INPUTS.into_iter());
        missed(SKIPS.fall, is_among(SKIP, edges.falls).into());
        for pin in INPUTS.into_iter().filter(|pin| is_among(*pin, edges.rises)) {
            match pin {
                SKIP => missed(SKIPS.rise, 1),
                TRIGGER_IN => missed(LatchCause::Trigger, 1),
                _ => watched_missed(pin.wrapping_sub(WATCHED)),
            }
        }
    }

    /// Takes in what the machines have stamped, a few at a time.
    fn capture(&mut self) {
        let mut taken = 0;
        let mut is_over = false;
        while taken < AT_ONCE && !is_over {
            let more = self.take(AT_ONCE.saturating_sub(taken));
            is_over = more == 0;
            taken = taken.saturating_add(more);
        }
        all_missed(SKIPS, self.skip.gone());
        all_missed(TRIGGERS, self.trigger.gone());
        if is_over {
            self.listen();
        } else {
            pio::listen(false, false);
            RESUME.pend();
        }
        if !self.edges.is_empty() {
            TELL.pend();
        }
    }

    /// What is beyond the allowance waits for the next look.
    fn listen(&self) {
        pio::listen(self.skips.is_left(), self.scans.is_left());
    }

    /// The next stamp of each machine, at most so many, with the positions at it. How many there
    /// were.
    #[inline(always)]
    fn take(&mut self, most: usize) -> usize {
        let mut taken = 0;
        if self.skips.is_left()
            && let Some(edge) = self.skip.take(&self.axes)
        {
            taken += 1;
            self.skips.spend();
            if let Ok(edge) = edge {
                self.put(Edge::of(SKIPS, edge));
            }
        }
        if taken < most
            && self.scans.is_left()
            && let Some(edge) = self.trigger.take(&self.axes)
        {
            taken += 1;
            self.scans.spend();
            if let Ok(edge) = edge {
                self.put(Edge::of(TRIGGERS, edge));
            }
        }
        if taken < most
            && self.scans.is_left()
            && let Some(rises) = self.watched.take(&self.axes)
        {
            taken += 1;
            for cause in rises.pins().filter_map(cause_of) {
                self.scans.spend();
                match rises.at {
                    Some((at, counts)) => {
                        self.put(Edge {
                            cause,
                            at,
                            counts,
                            missed: 0,
                        });
                    }
                    None => missed(cause, 1),
                }
            }
        }
        taken
    }

    /// An edge waits to be told.
    fn put(&mut self, edge: Edge) {
        if let Err(edge) = self.edges.push_back(edge) {
            missed(edge.cause, edge.missed.saturating_add(1));
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
        let ticks = match tick_us {
            TICK_US => EXTEND_US / TICK_US,
            _ => 1,
        };
        self.until_look = match self.until_look {
            0 => ticks.saturating_sub(1),
            waiting => waiting.min(ticks).saturating_sub(1),
        };
        tick_us
    }

    fn look(&mut self) {
        let now = clock::now_cycles();
        all_missed(SKIPS, self.skip.look(now));
        all_missed(TRIGGERS, self.trigger.look(now));
        self.look_for_dropped(now);
        if !self.axes.look() {
            self.start_again();
        }
        // What has waited since the last look, nobody knows the positions of.
        if !self.skips.is_left() {
            self.skip.drop_all();
            all_missed(SKIPS, self.skip.gone());
        }
        if !self.scans.is_left() {
            self.trigger.drop_all();
            all_missed(TRIGGERS, self.trigger.gone());
            self.watched.give_up(watched_missed);
        }
        self.skips.refill();
        self.scans.refill();
        self.listen();
    }

    /// What may have been among the stamps that the machine of index marks and pulses dropped
    /// is missed, at least once.
    fn look_for_dropped(&mut self, now: Cycles) {
        let pulsed = core::mem::replace(&mut self.pulsed, self.pulses.is_on());
        if let Some(marks) = self.watched.look(now) {
            marks.pins().for_each(watched_missed);
            missed(LatchCause::Output, pulsed.into());
        }
    }

    /// Queues no more pulses.
    fn end_pulses(&mut self) {
        self.pulsed |= self.pulses.is_on();
        self.pulses = Pulses::Off;
    }

    /// Begins with others; their machine is ready for them.
    fn begin_pulses(&mut self, pulses: Pulses) {
        pio::release_pulses();
        self.pulsed |= pulses.is_on();
        self.pulses = pulses;
        self.until_look = 0;
    }

    fn positions(&self) -> Positions {
        let (counts, taken) = self.axes.latest();
        Positions {
            counts: counts.into_iter().map(|axis| axis.0).collect(),
            t_ns: SystemClock::ns(taken),
            illegal: self.axes.illegal().into_iter().collect(),
            lost_samples: self.axes.lost(),
        }
    }
}

/// Edges that came without a capture.
fn missed(cause: LatchCause, edges: u32) {
    if edges > 0 {
        CAPTURES.lost(cause, SystemClock::ns(clock::now_cycles()), edges);
    }
}

/// Edges of a line that came without a capture.
fn all_missed(causes: Causes, lost: LostEdges) {
    missed(causes.rise, lost.rises);
    missed(causes.fall, lost.falls);
}

/// A rise of a watched pin, at least one, came without a capture.
fn watched_missed(pin: u8) {
    if let Some(cause) = cause_of(pin) {
        missed(cause, 1);
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

/// How often it is looked whether a pulse is over, and how long it is waited in between: longer
/// than any pulse, all in all.
const PULSE_LOOKS: u32 = 1000;
const PULSE_LOOK_CYCLES: u32 = 2 * CYCLES_PER_US;
/// How often pulses are set, at most: two losses in a row are the exception already.
const SETTINGS: u32 = 8;
const _: () = assert!(PULSE_LOOKS * PULSE_LOOK_CYCLES > MOST_PULSE_CYCLES);

impl Scanner for Station {
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), TriggerRefusal> {
        let (counts, _) = with(|latches| latches.axes.latest()).ok_or(TriggerRefusal::NoOutput)?;
        let pulses = Pulses::new(when, &counts)?;
        with(Latches::end_pulses);
        // A pulse that is on ends by itself: a sensor would take half of one for none.
        for looks_left in (0..PULSE_LOOKS).rev() {
            if with(|_| pio::hold_pulses(looks_left == 0)) == Some(true) {
                break;
            }
            cortex_m::asm::delay(PULSE_LOOK_CYCLES);
        }
        // Nobody else uses the machine now. This comes from the flash, and captures must not wait
        // for it. Only a start after a loss may come in between and stop it half way: then again.
        let losses = || with(|latches| latches.axes.lost());
        for _ in 0..SETTINGS {
            let before = losses();
            pio::stop_pulses();
            if let TriggerOut::Time { pulse, .. } | TriggerOut::Distance { pulse, .. } = when {
                pio::set_pulse_width(trigger_out::width_cycles(pulse));
                pio::set_pulse_rest(pulse.rests);
            }
            if losses() == before {
                break;
            }
        }
        with(|latches| latches.begin_pulses(pulses));
        tick::soon();
        Ok(())
    }

    fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
        self.laser.set_level(on.into());
        Ok(())
    }
}

const _: () = assert!(AXES <= umi_protocol::latch::MAX_AXES);
