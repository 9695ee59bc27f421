//! Digitizing under a control's own command: captures, their places, and what the control hears.
//!
//! A macro on the control prints short checked lines (`wire`); the sensor sends its readings
//! as text; each capture pulse latches the axes. This station joins them: reading n
//! belongs to latch n, or the loss is named (`captures`). Captures at rest are averaged
//! and become points P = Q + t + γ g a. The control hears of it in three ways:
//! by a program that sets variables, by the skip input ([`CaptureStation::skip`]), or not
//! at all, where pulses are made on the way.
//!
//! Nothing here waits and nothing is asked: bytes, latches and time come in, what is to be done
//! next is read ([`CaptureStation::order`]).

mod arrivals;
mod beam;
mod captures;
mod orders;
mod places;
mod record;
mod setup;
#[cfg(test)]
mod tests;
mod watch;
mod wire;

use heapless::Deque;
use nalgebra::Vector3;

pub use record::{PlacePoint, PlaceState, StationRecord};
pub use setup::check_sensor;
pub use wire::{
    ANSWER_BYTES, ANSWER_PROGRAM, CommandAnswer, CommandFault, CommandLine, NumberedReading,
    ReadingText, SensorCommand, SensorConfiguration, SignalLoss, check_value,
};

use super::sensor::PointSensor;
use crate::units::{Micros, Mm, Point};
use beam::BeamProof;
use captures::collect::Collected;
use captures::pairing::Pairing;
use captures::sweep::Sweep;
use orders::ADAPT_CAPTURES;
use watch::Watch;
use wire::text::TextLine;

/// A reading that has not come this long after its pulse is lost.
const LATE_US: u64 = 200_000;

/// No latch for so long, though the sensor is triggered: nothing is captured any more.
const STALLED_US: u64 = 1_000_000;

/// Readings that came before the board had told their latches.
const EARLY: usize = 8;

/// How often a gate is on before the first line: away along the beam, back, nearer, back.
pub const BEAM_GATES: u8 = 4;

/// What a station knows of its machine and its sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StationSetup {
    /// The calibration.
    pub sensor: PointSensor,
    /// Encoder counts per millimetre of X, Y and Z, negative where they count down.
    pub counts_per_mm: [f64; 3],
    /// Counts where the axes' coordinates are zero.
    pub origin_counts: [i64; 3],
    /// Most captures a second.
    pub max_rate_hz: f64,
    /// Largest value of the laser's power.
    pub power_max: f64,
    /// How the sensor writes a reading.
    pub text: ReadingText,
}

/// When the sensor is to be triggered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CapturePulses {
    /// Not at all.
    Off,
    /// Again and again, as fast as it was configured.
    Time,
    /// Where X crosses lines this many counts apart, one of them at a count.
    Distance {
        /// A line.
        origin_counts: i64,
        /// From line to line.
        interval_counts: i64,
    },
}

/// Outputs of the board for a control that reads inputs (LinuxCNC's `M66`). Together they are
/// never stale: the first turns with each line that is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StationSignals {
    /// The number of the last line that was answered is odd.
    pub parity: bool,
    /// It was carried out; of a measurement: there is a reading.
    pub is_ok: bool,
    /// There was no signal to measure, or an edge. Neither this nor `is_ok`: a fault.
    pub has_no_signal: bool,
}

/// What a station does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    Idle,
    /// One capture by which the numbers of readings and latches are brought together.
    Joining,
    /// Captures at rest.
    Collecting {
        left: u32,
        place: bool,
    },
    /// Readings are looked at, and the skip line may rise.
    Watching,
    /// Captures on the way.
    Pulsing {
        origin_counts: i64,
        interval_counts: i64,
    },
    /// The way is over; the last readings of it are to come.
    Resting,
}

/// What a station has counted since it began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationCounters {
    /// Readings with their latches.
    pub paired: u32,
    /// Latches without a reading.
    pub lost: u32,
    /// Readings without a latch.
    pub unpaired: u32,
    /// Lines that were no readings.
    pub unreadable: u32,
}

/// The station.
#[derive(Debug)]
pub struct CaptureStation {
    setup: StationSetup,
    configuration: Option<SensorConfiguration>,
    doing: Doing,
    line: CommandLine,
    text: TextLine,
    pairing: Pairing,
    collected: Collected,
    watch: Watch,
    sweep: Sweep,
    answer: Option<CommandAnswer>,
    /// The last command that was answered, and how.
    answered: (u16, PlaceState),
    /// The trip waits for its first reading.
    is_arming: bool,
    /// How often the gate was on to prove the beam.
    gates: u8,
    sequence: u16,
    /// Places measured so far.
    places: u32,
    proof: BeamProof,
    /// Readings that may have come before their latches, and when.
    early: Deque<(NumberedReading, Micros), EARLY>,
    /// Since when nothing was captured, though it should.
    stalled_since: Option<Micros>,
    counters: StationCounters,
    records: Deque<StationRecord, 16>,
    /// Records that found no room.
    dropped: u32,
}

impl CaptureStation {
    /// A station that waits for its configuration.
    #[must_use]
    pub fn new(setup: StationSetup) -> Self {
        Self {
            setup,
            configuration: None,
            doing: Doing::Idle,
            line: CommandLine::default(),
            text: TextLine::default(),
            pairing: Pairing::default(),
            collected: Collected::default(),
            watch: Watch::default(),
            sweep: Sweep::new(0.0, Mm(1.0), None),
            answer: None,
            answered: (0, PlaceState::Refused),
            is_arming: false,
            gates: 0,
            sequence: 0,
            places: 0,
            proof: BeamProof::default(),
            early: Deque::new(),
            stalled_since: None,
            counters: StationCounters::default(),
            records: Deque::new(),
            dropped: 0,
        }
    }

    /// How the sensor was configured; none before.
    #[must_use]
    pub fn configuration(&self) -> Option<SensorConfiguration> {
        self.configuration
    }

    /// From capture to capture where they come in time: not more often than was asked for.
    #[must_use]
    pub fn interval_us(&self) -> u32 {
        let rate_hz = self.configuration.map_or(1.0, |with| with.rate_hz);
        // The cast ends at the bounds.
        libm::ceil(1e6 / rate_hz - 1e-6) as u32
    }

    /// When the sensor is to be triggered from now on.
    #[must_use]
    pub fn order(&self) -> CapturePulses {
        match self.doing {
            Doing::Joining if self.pairing.is_empty() => CapturePulses::Time,
            Doing::Collecting { left, .. } if left > 0 => CapturePulses::Time,
            Doing::Watching if self.watch.is_on() => CapturePulses::Time,
            Doing::Pulsing {
                origin_counts,
                interval_counts,
            } => CapturePulses::Distance {
                origin_counts,
                interval_counts,
            },
            _ => CapturePulses::Off,
        }
    }

    /// Whether the control's skip input is to be on.
    #[must_use]
    pub fn skip(&self) -> bool {
        self.doing == Doing::Watching && self.watch.has_tripped()
    }

    /// What the board's outputs tell a control that cannot be served a program.
    #[must_use]
    pub const fn signals(&self) -> StationSignals {
        StationSignals {
            parity: self.answered.0 % 2 == 1,
            is_ok: matches!(self.answered.1, PlaceState::Ok),
            has_no_signal: matches!(self.answered.1, PlaceState::NoSignal(_) | PlaceState::Edge),
        }
    }

    /// Whether captures are only looked at: no place is made of them.
    #[must_use]
    pub fn is_watching(&self) -> bool {
        self.doing == Doing::Watching
    }

    /// The oldest record that was not taken yet.
    pub fn take_record(&mut self) -> Option<StationRecord> {
        self.records.pop_front()
    }

    /// Records that found no room, since they were asked for last.
    pub fn take_dropped(&mut self) -> u32 {
        core::mem::take(&mut self.dropped)
    }

    /// The answer to the last command, once it is there; it is given once.
    pub fn take_answer(&mut self) -> Option<CommandAnswer> {
        self.answer.take()
    }

    /// Configures the sensor for a control that cannot print: it measures on lines along X while a
    /// [gate](Self::gate) is on. False: not possible so.
    pub fn prepare(&mut self, wanted: SensorConfiguration) -> bool {
        self.gates = 0;
        self.configure(wanted);
        self.doing == Doing::Joining
    }

    /// The gate of a control that cannot print (an output of its own, as that for coolant). The
    /// first four times that it is on prove the beam, with the axes at rest; then it is on along
    /// each line.
    pub fn gate(&mut self, is_on: bool, counts: [i64; 3]) {
        while let Some(lost) = self.pairing.oldest() {
            self.lost(lost);
        }
        let Some(with) = self.configuration else {
            self.record(StationRecord::Refused(CommandFault::Value));
            return;
        };
        if !is_on {
            self.rest();
        } else if self.gates < BEAM_GATES {
            self.gates += 1;
            self.collect(ADAPT_CAPTURES, false);
        } else {
            self.pulse(with, counts);
        }
    }

    /// A byte that the control has printed; the axes stand at these counts.
    pub fn command_byte(&mut self, byte: u8, counts: [i64; 3]) {
        if let Some(line) = self.line.byte(byte) {
            self.command(line, counts);
        }
    }

    /// A line that the control has printed; the axes stand at these counts.
    pub fn command(&mut self, line: Result<(u16, SensorCommand), CommandFault>, counts: [i64; 3]) {
        match line {
            Ok((sequence, command)) => self.carry_out(sequence, command, counts),
            Err(fault) => self.record(StationRecord::Refused(fault)),
        }
    }

    /// The sensor was triggered at this time, and the axes stood at these counts.
    pub fn latched(&mut self, counts: [i64; 3], at: Micros) {
        self.stalled_since = None;
        let is_surplus = match &mut self.doing {
            Doing::Collecting { left: 0, .. } | Doing::Idle => true,
            Doing::Collecting { left, .. } => {
                *left -= 1;
                false
            }
            Doing::Joining => !self.pairing.is_empty(),
            Doing::Watching | Doing::Pulsing { .. } | Doing::Resting => false,
        };
        if let Some(lost) = self.pairing.latched(counts, at, is_surplus) {
            self.lost(lost);
        }
        self.take_early(at);
    }

    /// The sensor was triggered so often, and where the axes stood is not known.
    pub fn missed(&mut self, count: u32) {
        self.pairing.missed(count);
    }

    /// The board cannot send the pulses that are [wanted](Self::order): so the command cannot be carried out.
    pub fn pulses_refused(&mut self) {
        self.refuse();
    }

    /// A byte from the sensor.
    pub fn sensor_byte(&mut self, byte: u8, now: Micros) {
        match self.text.byte(byte, &self.setup.text) {
            None => {}
            Some(Ok(reading)) => self.came(reading, now),
            Some(Err(())) => self.unreadable(),
        }
    }

    /// Characters of the sensor were lost: what they belong to cannot be read.
    pub fn sensor_lost(&mut self) {
        self.text = TextLine::default();
        self.text.spoil();
    }

    /// Time passes: a reading that is late is lost, and so is one whose latch does not come.
    pub fn tick(&mut self, now: Micros) {
        let since = Micros(now.0.saturating_sub(LATE_US));
        while let Some(lost) = self.pairing.older_than(since) {
            self.lost(lost);
        }
        while let Some((reading, _)) = self.early.front().copied().filter(|(_, at)| *at < since) {
            self.early.pop_front();
            self.unpaired(reading.number);
        }
        if self.order() != CapturePulses::Time {
            self.stalled_since = None;
            return;
        }
        let since = *self.stalled_since.get_or_insert(now);
        if now.0.saturating_sub(since.0) > STALLED_US {
            self.stalled_since = None;
            self.stalled();
        }
    }

    /// What was counted since the station began.
    #[must_use]
    pub const fn counters(&self) -> StationCounters {
        self.counters
    }

    /// When [`Self::tick`] is due, at the latest so long from now; none: never.
    #[must_use]
    pub fn patience(&self) -> Option<Micros> {
        let waits = !self.pairing.is_empty() || !self.early.is_empty();
        (waits || self.order() == CapturePulses::Time).then_some(Micros(LATE_US / 10))
    }

    #[cfg(test)]
    fn pairing_next(&self) -> u32 {
        self.pairing.next()
    }

    fn record(&mut self, record: StationRecord) {
        if self.records.push_back(record).is_err() {
            self.dropped = self.dropped.saturating_add(1);
        }
    }

    fn reply(&mut self, gamma: Mm, state: PlaceState) {
        self.answered = (self.sequence, state);
        self.answer = Some(CommandAnswer {
            gamma,
            state,
            sequence: self.sequence,
        });
    }

    /// Where the axes stand at these counts.
    fn axes(&self, counts: [i64; 3]) -> Point {
        let setup = &self.setup;
        let mut mm = Vector3::zeros();
        let each = counts.iter().zip(&setup.origin_counts);
        for (slot, ((count, origin), per_mm)) in mm.iter_mut().zip(each.zip(&setup.counts_per_mm)) {
            *slot = (count - origin) as f64 / per_mm;
        }
        Point { mm }
    }
}
