//! The bench port: it plays encoders and inputs, and is told the outputs.

use core::cell::RefCell;

use critical_section::Mutex;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use umi_app::board::{Axes, CncInput, Lights, Outputs, Scanner, SensorLines, Unsupported};
use umi_protocol::latch::{Positions, TriggerOut, TriggerRefusal};
use umi_protocol::message::ResetReason;
use umi_stimuli::{
    BenchState, MAX_FRAME, SensorTriggers, Stimulus, StimulusDecoder, decode, encode,
};

use crate::path::Path;
use crate::ports::link::LINK;
use crate::{BENCH, CONTROL, LATCHES, clock};

struct Inner {
    decoder: StimulusDecoder,
    path: Path,
    state: BenchState,
    /// When the bench wants to be told the state in any case.
    due_ns: Option<u64>,
}

static INNER: Mutex<RefCell<Inner>> = Mutex::new(RefCell::new(Inner {
    decoder: StimulusDecoder::new(),
    path: Path::new(),
    state: BenchState {
        taken: 0,
        refused: 0,
        t_ns: 0,
        reset: ResetReason::Unknown,
        busy: false,
        ok: false,
        ng: false,
        trouble: false,
        laser: false,
        from_control: 0,
        overruns: 0,
        sensor: [false; 4],
        triggers: SensorTriggers::Off,
    },
    due_ns: None,
}));

/// The state has changed.
static CHANGED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The bench asks that measuring never answers again.
pub static HANG: Signal<CriticalSectionRawMutex, ()> = Signal::new();

fn with<T>(work: impl FnOnce(&mut Inner) -> T) -> T {
    critical_section::with(|cs| work(&mut INNER.borrow(cs).borrow_mut()))
}

/// Does what the bench sends, for ever: in a task of the highest priority, because a panic is among
/// the things that it may ask for, and no interrupt handler has a way to one.
pub async fn play() {
    let mut bytes = [0; MAX_FRAME];
    loop {
        if let CncInput::Bytes(count) = BENCH.read(&mut bytes).await {
            for byte in bytes.iter().take(count) {
                take(*byte);
            }
        }
    }
}

/// A byte has come.
fn take(byte: u8) {
    with(|inner| {
        let mut stimulus = None;
        let damaged = decode(&mut inner.decoder, &[byte], |whole| stimulus = Some(whole));
        if damaged > 0 {
            inner.state.refused = inner.state.refused.saturating_add(damaged);
        } else if let Some(stimulus) = stimulus {
            inner.take(&stimulus);
            inner.state.taken = inner.state.taken.wrapping_add(1);
        } else {
            return;
        }
        CHANGED.signal(());
    });
}

impl Inner {
    fn take(&mut self, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Look => {}
            Stimulus::Wait { until_ns } => self.due_ns = Some(*until_ns),
            Stimulus::Path {
                from_ns,
                to_ns,
                counts,
            } => {
                if self.path.lay(*from_ns, *to_ns, counts).is_err() {
                    self.state.refused = self.state.refused.saturating_add(1);
                }
            }
            Stimulus::Edge { cause, t_ns } => match self.path.at(*t_ns) {
                Some(counts) => {
                    LATCHES.captured(*cause, *t_ns, counts, 0);
                }
                None => LATCHES.lost(*cause, *t_ns, 1),
            },
            Stimulus::Host { connected } => LINK.plug(*connected),
            Stimulus::Clear { characters } => crate::ports::control::clear(*characters),
            #[allow(clippy::panic, reason = "it is what the bench asks for")]
            Stimulus::Panic => panic!("asked for by the bench"),
            Stimulus::Hang => HANG.signal(()),
            // SAFETY: nothing returns from here: what is pushed ends in a fault.
            Stimulus::Overflow => unsafe {
                core::arch::asm!("2:", "push {{r0-r7}}", "b 2b", options(noreturn))
            },
        }
    }
}

/// Notes why the board started.
pub fn note_reset(reset: ResetReason) {
    with(|inner| inner.state.reset = reset);
    CHANGED.signal(());
}

/// Tells the bench how the board stands, for ever.
pub async fn tell() {
    let mut buffer = [0; MAX_FRAME];
    // Ends the frame that a reset has cut.
    BENCH.write(0).await;
    loop {
        let due = with(|inner| inner.due_ns);
        // Not before it.
        let due = due.map_or(Instant::MAX, |ns| Instant::from_micros(ns.div_ceil(1000)));
        select(CHANGED.wait(), Timer::at(due)).await;
        let state = with(|inner| {
            let t_ns = clock::now_ns();
            inner.due_ns = inner.due_ns.filter(|due| *due > t_ns);
            BenchState {
                t_ns,
                from_control: CONTROL.received(),
                overruns: CONTROL.overruns(),
                ..inner.state
            }
        });
        for byte in encode(&state, &mut buffer).unwrap_or_default() {
            BENCH.write(*byte).await;
        }
    }
}

/// What the station of a distance sensor wants from now on.
pub fn note_triggers(triggers: SensorTriggers) {
    with(|inner| inner.state.triggers = triggers);
    CHANGED.signal(());
}

/// What it shows to the control.
pub fn note_sensor(lines: SensorLines) {
    let SensorLines {
        skip,
        parity,
        is_ok,
        has_no_signal,
    } = lines;
    with(|inner| inner.state.sensor = [skip, parity, is_ok, has_no_signal]);
    CHANGED.signal(());
}

/// The outputs to the machine.
pub struct Lamps;

impl Outputs for Lamps {
    fn show(&mut self, lights: Lights) {
        let changed = with(|inner| {
            let state = &mut inner.state;
            let before = *state;
            state.busy = lights.busy;
            state.ok = lights.ok;
            state.ng = lights.ng;
            state.trouble = lights.trouble;
            before != *state
        });
        if changed {
            CHANGED.signal(());
        }
    }
}

/// The axes, and the outputs to a scanner.
pub struct Station;

impl Axes for Station {
    fn positions(&mut self) -> Positions {
        let t_ns = clock::now_ns();
        // The path always reaches to now.
        let counts = with(|inner| inner.path.at(t_ns)).unwrap_or_default();
        Positions {
            counts: counts.iter().map(|axis| axis.0).collect(),
            t_ns,
            illegal: counts.iter().map(|_| 0).collect(),
            lost_samples: 0,
        }
    }
}

impl Scanner for Station {
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), TriggerRefusal> {
        match when {
            TriggerOut::Off => Ok(()),
            TriggerOut::Time { .. } | TriggerOut::Distance { .. } => Err(TriggerRefusal::NoOutput),
        }
    }

    fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
        with(|inner| inner.state.laser = on);
        CHANGED.signal(());
        Ok(())
    }
}
