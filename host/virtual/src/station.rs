//! The board between the sensor and the control: the station of the firmware on the wires of
//! the virtual machine.
//!
//! The sensor's line is taken to be so fast that a reading is there when its capture is; the
//! control's line has its own speed. What may go wrong on the way is made on purpose
//! ([`SensorLineFault`]).

use umi_core::point::station::{
    CapturePulses, CaptureStation, SensorConfiguration, StationRecord, StationSetup,
};
use umi_core::units::Micros;

use crate::machine::{SensorOrder, SensorPulses, ServedProgram, Wires};
use crate::sensor::{Exposure, SensorFault, SensorSignal};

/// What goes wrong between sensor and board, or between board and control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SensorLineFault {
    /// Nothing.
    #[default]
    None,
    /// From this reading on all come under the next one's number.
    OffByOne(u32),
    /// This reading does not come.
    Lost(u32),
    /// From this reading on the sensor repeats what it has sent before.
    Stale(u32),
    /// The control gets the answer before the last once more, at this answer.
    StaleAnswer(u32),
    /// One figure of this answer is another one.
    WrongAnswer(u32),
    /// The control's skip input is not wired: it never rises.
    NoSkip,
}

/// A station wired to a machine.
#[derive(Debug)]
pub struct SensorStation {
    station: CaptureStation,
    fault: SensorLineFault,
    /// Captures so far: the sensor's own number of a reading.
    captures: u32,
    /// Those that were not only looked at.
    measured: u32,
    last: Option<SensorSignal>,
    records: Vec<StationRecord>,
    dropped: u32,
    counts: [i64; 3],
    answers: u32,
    before: Option<Vec<u8>>,
    commands: u32,
    text: String,
}

impl SensorStation {
    /// A station that waits for its configuration.
    #[must_use]
    pub fn new(setup: StationSetup, fault: SensorLineFault) -> Self {
        Self {
            station: CaptureStation::new(setup),
            fault,
            captures: 0,
            measured: 0,
            last: None,
            records: Vec::new(),
            dropped: 0,
            counts: [0; 3],
            answers: 0,
            before: None,
            commands: 0,
            text: String::new(),
        }
    }

    /// Configures the sensor, where the control cannot. False: not possible so.
    pub fn prepare(&mut self, wanted: SensorConfiguration) -> bool {
        self.station.prepare(wanted)
    }

    /// What the station has told so far, oldest first.
    #[must_use]
    pub fn records(&self) -> &[StationRecord] {
        &self.records
    }

    /// Records that found no room at the station.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Captures so far of which something was made; those that were only looked at on the way
    /// are not in it.
    #[must_use]
    pub fn measured(&self) -> u32 {
        self.measured
    }

    /// Lines that the control has printed.
    #[must_use]
    pub fn commands(&self) -> u32 {
        self.commands
    }

    fn drain(&mut self) {
        while let Some(record) = self.station.take_record() {
            self.records.push(record);
        }
        self.dropped = self.dropped.saturating_add(self.station.take_dropped());
    }
}

impl Wires for SensorStation {
    fn stands(&mut self, counts: [i64; 3]) {
        self.counts = counts;
    }

    fn serial(&mut self, _: Micros, bytes: &[u8]) {
        for byte in bytes {
            self.commands += u32::from(*byte == b'\n');
            self.station.command_byte(*byte, self.counts);
            self.drain();
        }
    }

    fn skip(&mut self, _: Micros, _: [i64; 3]) {}

    fn time(&mut self, now: Micros) {
        self.station.tick(now);
        self.drain();
    }

    fn sensor_order(&self) -> Option<SensorOrder> {
        let pulses = match self.station.order() {
            CapturePulses::Off => return None,
            CapturePulses::Time => SensorPulses::Time,
            CapturePulses::Distance {
                origin_counts,
                interval_counts,
            } => SensorPulses::Distance {
                origin_counts,
                interval_counts,
            },
        };
        let with = self.station.configuration()?;
        Some(SensorOrder {
            exposure: Exposure {
                rate_hz: with.rate_hz,
                power: with.power,
            },
            pulses,
        })
    }

    fn captured(&mut self, at: Micros, counts: [i64; 3], read: Result<SensorSignal, SensorFault>) {
        use std::fmt::Write as _;
        self.measured += u32::from(!self.station.is_watching());
        self.station.latched(counts, at);
        let number = self.captures;
        self.captures = self.captures.wrapping_add(1);
        let read = match (self.fault, self.last) {
            (SensorLineFault::Stale(from), Some(last)) if number >= from => Ok(last),
            _ => read,
        };
        let shown = match self.fault {
            SensorLineFault::OffByOne(from) if number >= from => number.wrapping_add(1),
            _ => number,
        };
        if self.fault != SensorLineFault::Lost(number) {
            self.text.clear();
            // Writing to a string cannot fail.
            let _ = match read {
                Ok(signal) => writeln!(
                    self.text,
                    "{shown:05} {:.6} {:.1} {:.0}\r",
                    signal.gamma_mm, signal.snr, signal.total
                ),
                Err(fault) => writeln!(self.text, "{shown:05} - {}\r", fault.code()),
            };
            for byte in self.text.bytes() {
                self.station.sensor_byte(byte, at);
            }
        }
        self.last = read.ok().or(self.last);
        self.drain();
    }

    fn skip_input(&self) -> bool {
        self.fault != SensorLineFault::NoSkip && self.station.skip()
    }

    fn gate(&mut self, now: Micros, is_on: bool, counts: [i64; 3]) {
        self.station.tick(now);
        self.station.gate(is_on, counts);
        self.drain();
    }

    /// 0: the last line answered has an odd number; 1: it was carried out; 2: no signal;
    /// 3: the skip line.
    fn digital_input(&self, number: u16) -> bool {
        let signals = self.station.signals();
        match number {
            0 => signals.parity,
            1 => signals.is_ok,
            2 => signals.has_no_signal,
            3 => self.skip_input(),
            _ => false,
        }
    }

    fn is_silent(&self) -> bool {
        false
    }

    fn program(&mut self, _: Micros, _: u32) -> Option<ServedProgram> {
        let answer = self.station.take_answer()?;
        let mut bytes = answer.program().as_bytes().to_vec();
        let number = self.answers;
        self.answers = self.answers.wrapping_add(1);
        match (self.fault, &self.before) {
            (SensorLineFault::StaleAnswer(at), Some(before)) if at == number => {
                bytes.clone_from(before);
            }
            (SensorLineFault::WrongAnswer(at), _) if at == number => {
                // The first figure behind the first `=`: the distance.
                if let Some(figure) = bytes
                    .iter()
                    .position(|byte| *byte == b'=')
                    .and_then(|place| bytes.get_mut(place + 1))
                {
                    *figure = if *figure == b'9' { b'1' } else { *figure + 1 };
                }
            }
            _ => {}
        }
        self.before = Some(bytes.clone());
        Some(ServedProgram { bytes })
    }
}
