//! Digitizing under a control's own command: captures, their places, and what the control hears.
//!
//! A macro on the control prints short checked lines (`command`); the sensor sends its readings
//! as text (`text`); each capture pulse latches the axes. This station joins them: reading n
//! belongs to latch n, or the loss is named (`pairing`). Captures at rest are averaged
//! (`collect`) and become points P = Q + t + γ g a. The control hears of it in three ways:
//! by a program that sets variables (`answer`), by the skip input ([`CaptureStation::skip`]), or not
//! at all, where pulses are made on the way.
//!
//! Nothing here waits and nothing is asked: bytes, latches and time come in, what is to be done
//! next is read ([`CaptureStation::order`]).

mod answer;
mod buffer;
mod collect;
mod command;
mod pairing;
mod record;
mod sweep;
#[cfg(test)]
mod tests;
mod text;
mod watch;

use heapless::Deque;
use nalgebra::Vector3;

pub use answer::{ANSWER_BYTES, ANSWER_PROGRAM, CommandAnswer};
pub use command::{CommandFault, SensorCommand, SensorConfiguration, check_value};
pub use record::{PlacePoint, PlaceState, StationRecord};
pub use text::{NumberedReading, ReadingText, SignalLoss};

use super::sensor::PointSensor;
use crate::units::{Micros, Mm, Point};
use collect::Collected;
use command::CommandLine;
use pairing::{Latched, Pairing};
use sweep::Sweep;
use text::TextLine;
use watch::{Trip, Watch};

/// Readings that a board takes to bring a sensor to its place.
const ADAPT_CAPTURES: u32 = 16;

/// A reading that has not come this long after its pulse is lost.
const LATE_US: u64 = 50_000;

/// How often a gate is on before the first line: away along the beam, back, nearer, back.
pub const BEAM_GATES: u8 = 4;

/// Along the beam the reading must change as the axes move, to this and a twentieth of the way.
const BEAM_MM: f64 = 0.01;

/// A shorter way says nothing about the beam.
const BEAM_WAY_MM: f64 = 0.05;

/// ... and the noise of the two means may move it by so many of its standard deviations: no
/// false alarm in a million places, even from the scatter of thirty captures.
const BEAM_SIGMAS: f64 = 7.0;

/// So many readings in succession that do not follow are no edge of the part any more.
const DOUBTS: u8 = 3;

/// So many captures that are alike to the last figure are no chance.
const FROZEN: f64 = 4.0;

/// Where noise may move it by more than this part of the way, a swapped sign could pass: such a
/// way proves nothing.
const BEAM_PROOF: f64 = 0.5;

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
}

/// Where the axes stood, and what was read there.
#[derive(Clone, Copy, Debug)]
struct Seen {
    axes: Vector3<f64>,
    gamma: f64,
    /// Captures in its mean.
    captures: f64,
}

/// What is known of the beam since the sensor was configured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Beam {
    /// Nothing yet.
    #[default]
    Unknown,
    /// Readings change with the axes as the calibration says.
    Follows,
    /// They do not.
    Wrong,
    /// Their noise hides whether they do.
    Hidden,
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
    seen: Option<Seen>,
    beam: Beam,
    /// How often in succession a reading did not follow.
    doubts: u8,
    /// Squares of the readings' differences from the means at rest, mm², and their degrees of
    /// freedom, since the sensor was configured.
    scatter: (f64, f64),
    latest: Option<[i64; 3]>,
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
            sweep: Sweep::new(0.0, Mm(1.0)),
            answer: None,
            answered: (0, PlaceState::Refused),
            is_arming: false,
            gates: 0,
            sequence: 0,
            places: 0,
            seen: None,
            beam: Beam::Unknown,
            doubts: 0,
            scatter: (0.0, 0.0),
            latest: None,
            records: Deque::new(),
            dropped: 0,
        }
    }

    /// How the sensor was configured; none before.
    #[must_use]
    pub fn configuration(&self) -> Option<SensorConfiguration> {
        self.configuration
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
        match self.line.byte(byte) {
            None => {}
            Some(Ok((sequence, command))) => self.carry_out(sequence, command, counts),
            Some(Err(fault)) => self.record(StationRecord::Refused(fault)),
        }
    }

    /// The sensor was triggered, and the axes stood at these counts.
    pub fn latched(&mut self, counts: [i64; 3], now: Micros) {
        self.latest = Some(counts);
        if let Doing::Collecting { left, .. } = &mut self.doing {
            *left = left.saturating_sub(1);
        }
        if let Some(lost) = self.pairing.latched(counts, now) {
            self.lost(lost);
        }
    }

    /// A byte from the sensor.
    pub fn sensor_byte(&mut self, byte: u8) {
        match self.text.byte(byte, &self.setup.text) {
            None => {}
            Some(Ok(reading)) => self.read(reading),
            Some(Err(())) => self.record(StationRecord::Unreadable),
        }
    }

    /// Time passes: a reading that is late is lost.
    pub fn tick(&mut self, now: Micros) {
        while let Some(lost) = self
            .pairing
            .older_than(Micros(now.0.saturating_sub(LATE_US)))
        {
            self.lost(lost);
        }
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

    fn carry_out(&mut self, sequence: u16, command: SensorCommand, counts: [i64; 3]) {
        // What has not come for the command before is not what this one asks for.
        while let Some(lost) = self.pairing.oldest() {
            self.lost(lost);
        }
        self.answer = None;
        self.is_arming = false;
        self.sequence = sequence;
        match (command, self.configuration) {
            (SensorCommand::Configure(wanted), _) => self.configure(wanted),
            (SensorCommand::Finish, _) => {
                self.doing = Doing::Idle;
                self.configuration = None;
                self.reply(Mm(0.0), PlaceState::Ok);
            }
            (_, None) => self.refuse(),
            (SensorCommand::Adapt, Some(_)) => self.collect(ADAPT_CAPTURES, false),
            (SensorCommand::Measure, Some(with)) => self.collect(with.captures, true),
            (SensorCommand::TripNear, Some(with)) => self.trip(Trip::AtMost(with.target.0)),
            (SensorCommand::TripFar, Some(with)) => {
                self.trip(Trip::AtLeast(with.target.0 + with.overshoot.0));
            }
            (SensorCommand::Pulses, Some(with)) => self.pulse(with, counts),
            (SensorCommand::Rest, Some(_)) => {
                self.rest();
                self.reply(Mm(0.0), PlaceState::Ok);
            }
        }
    }

    fn configure(&mut self, wanted: SensorConfiguration) {
        let is_possible = wanted.rate_hz > 0.0
            && wanted.rate_hz <= self.setup.max_rate_hz
            && (0.0..=self.setup.power_max).contains(&wanted.power)
            && wanted.captures > 0;
        if !is_possible {
            self.refuse();
            return;
        }
        self.configuration = Some(wanted);
        self.pairing = Pairing::default();
        self.places = 0;
        self.seen = None;
        self.beam = Beam::Unknown;
        self.doubts = 0;
        self.scatter = (0.0, 0.0);
        self.doing = Doing::Joining;
    }

    fn refuse(&mut self) {
        self.doing = Doing::Idle;
        self.record(StationRecord::Refused(CommandFault::Value));
        self.reply(Mm(0.0), PlaceState::Refused);
    }

    fn collect(&mut self, captures: u32, place: bool) {
        self.collected = Collected::of(captures);
        self.doing = Doing::Collecting {
            left: captures,
            place,
        };
    }

    /// Watches for the target; answered once the first reading shows on which side of it the
    /// sensor is.
    fn trip(&mut self, trip: Trip) {
        // One reading on the way is too noisy to hold the beam against.
        self.seen = None;
        self.is_arming = true;
        self.watch(Watch::trip(trip));
    }

    fn watch(&mut self, watch: Watch) {
        self.watch = watch;
        self.doing = Doing::Watching;
    }

    fn pulse(&mut self, with: SensorConfiguration, counts: [i64; 3]) {
        let [per_mm, _, _] = self.setup.counts_per_mm;
        let step = libm::fabs(with.interval.0 * per_mm);
        // Not more often than was asked for.
        let interval = libm::ceil(step / f64::from(with.captures) - 1e-6) as i64;
        let [at, _, _] = counts;
        if interval < 2 {
            self.refuse();
            return;
        }
        let Point { mm } = self.axes(counts);
        // A capture in the middle of a cell where there is one only.
        self.sweep = Sweep::new(mm.x, with.interval);
        self.doing = Doing::Pulsing {
            origin_counts: at.saturating_add(interval / 2),
            interval_counts: interval,
        };
        self.reply(Mm(0.0), PlaceState::Ok);
    }

    /// Ends the captures on the way.
    fn rest(&mut self) {
        if matches!(self.doing, Doing::Pulsing { .. })
            && let Some(place) = self.sweep.end()
        {
            self.place(place);
        }
        self.doing = Doing::Idle;
    }

    /// Takes a capture on the way, with its reading if that came.
    fn on_the_way(&mut self, axes: Point, reading: Option<&NumberedReading>) {
        // Three cells at most.
        while let Some(done) = self.sweep.go_on(axes) {
            if let Some(place) = done {
                self.place(place);
            }
        }
        match reading {
            Some(reading) => self.sweep.add(axes, reading),
            None => self.sweep.lost(),
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

    /// A latch whose reading never came.
    fn lost(&mut self, latch: Latched) {
        self.record(StationRecord::Lost {
            latch: latch.number,
        });
        match self.doing {
            Doing::Joining => {
                self.doing = Doing::Idle;
                self.reply(Mm(0.0), PlaceState::LostCapture);
            }
            Doing::Collecting { .. } => {
                self.collected.lost();
                self.close();
            }
            Doing::Pulsing { .. } => self.on_the_way(self.axes(latch.counts), None),
            Doing::Idle | Doing::Watching => {}
        }
    }

    fn read(&mut self, reading: NumberedReading) {
        if self.doing == Doing::Joining {
            // One pulse, one reading: their numbers belong together from here on.
            self.pairing.join(reading.number);
        }
        while let Some(lost) = self.pairing.before(reading.number) {
            self.lost(lost);
        }
        let Some(latch) = self.pairing.take(reading.number) else {
            self.record(StationRecord::Unpaired {
                reading: reading.number,
            });
            return;
        };
        let axes = self.axes(latch.counts);
        match self.doing {
            Doing::Joining => {
                self.doing = Doing::Idle;
                self.reply(Mm(0.0), PlaceState::Ok);
            }
            Doing::Collecting { .. } => {
                self.collected.add(axes, &reading);
                self.close();
            }
            Doing::Watching => {
                self.watch.look(reading.signal.ok().map(|s| s.gamma.0));
                if core::mem::take(&mut self.is_arming) {
                    self.reply(Mm(0.0), PlaceState::Ok);
                }
            }
            Doing::Pulsing { .. } => self.on_the_way(axes, Some(&reading)),
            Doing::Idle => {}
        }
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

    /// Ends the captures at rest once each has its reading or is lost.
    fn close(&mut self) {
        let Doing::Collecting { left: 0, place } = self.doing else {
            return;
        };
        if !self.collected.is_complete() {
            return;
        }
        let mut found = self.collected.place();
        if found.state == PlaceState::Ok {
            self.check_beam(&mut found, place);
        } else {
            self.seen = None;
        }
        self.reply(found.gamma, found.state);
        if place {
            self.place(found);
            self.seen = None;
        }
        let guards = self.configuration.is_some_and(|with| with.guards);
        if guards {
            self.watch(Watch::guard());
        } else {
            self.doing = Doing::Idle;
        }
    }

    /// Where the axes have moved along the beam since the last reading of this place, the
    /// reading must have changed by as much, but for the noise of both.
    fn check_beam(&mut self, found: &mut PlacePoint, place: bool) {
        let sensor = &self.setup.sensor;
        let captures = f64::from(found.captures.max(1));
        // Of one reading: that of all places together, for a few captures say little of it.
        let squares = found.spread.0 * found.spread.0 * captures;
        self.scatter.0 += squares;
        self.scatter.1 += captures - 1.0;
        let (sum, freedom) = self.scatter;
        let mut is_edge = false;
        // A sensor with noise that says the same again and again does not measure any more.
        if squares == 0.0 && captures >= FROZEN && sum > 1e-12 * freedom {
            self.beam = Beam::Wrong;
        }
        if let Some(seen) = self.seen {
            let way = found.axes.mm - seen.axes;
            let along = way.dot(&sensor.direction);
            let aside = crate::fit::solve::linalg::norm(&(way - sensor.direction * along));
            let length = libm::fabs(along);
            if length >= BEAM_WAY_MM && aside <= 0.01 {
                let off = libm::fabs((found.gamma.0 - seen.gamma) * sensor.gain + along);
                let variance = sum / freedom.max(1.0) * (1.0 / captures + 1.0 / seen.captures);
                let noise = BEAM_SIGMAS * sensor.gain * libm::sqrt(variance);
                let is_off = off > BEAM_MM + 0.05 * length + noise;
                let is_proof = noise <= BEAM_PROOF * length;
                self.doubts = if is_off {
                    self.doubts.saturating_add(1)
                } else {
                    0
                };
                is_edge = is_off;
                self.beam = match self.beam {
                    Beam::Wrong => Beam::Wrong,
                    // One reading beside the others is an edge of the part.
                    Beam::Follows if self.doubts < DOUBTS => Beam::Follows,
                    _ if is_off => Beam::Wrong,
                    _ if is_proof => Beam::Follows,
                    _ => Beam::Hidden,
                };
            }
        }
        // What is to prove it cannot wait for the proof.
        if self.beam != Beam::Unknown || place {
            found.state = self.beam_state();
        }
        if is_edge && found.state == PlaceState::Ok {
            found.state = PlaceState::Edge;
        }
        self.seen = Some(Seen {
            axes: found.axes.mm,
            gamma: found.gamma.0,
            captures,
        });
    }

    /// What becomes of a place that is otherwise good.
    const fn beam_state(&self) -> PlaceState {
        match self.beam {
            Beam::Follows => PlaceState::Ok,
            Beam::Wrong => PlaceState::BeamMismatch,
            Beam::Unknown | Beam::Hidden => PlaceState::BeamUnproven,
        }
    }

    fn place(&mut self, mut found: PlacePoint) {
        if found.state == PlaceState::Ok {
            found.state = self.beam_state();
        }
        found.number = self.places;
        self.places = self.places.saturating_add(1);
        if found.state == PlaceState::Ok {
            found.point = Some(self.setup.sensor.place(found.axes, found.gamma));
        }
        self.record(StationRecord::Place(found));
    }
}
