//! The machine's wires: each signal with its true time.

use umi_core::units::Micros;

use crate::sensor::{Exposure, SensorFault, SensorSignal};

/// When the sensor in the spindle is triggered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorOrder {
    /// How a capture is taken.
    pub exposure: Exposure,
    /// When.
    pub pulses: SensorPulses,
}

/// What triggers a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorPulses {
    /// Time: at the rate of the exposure.
    Time,
    /// X crosses lines this many counts apart, one of them at a count.
    Distance {
        /// A line.
        origin_counts: i64,
        /// From line to line.
        interval_counts: i64,
    },
}

/// A program that comes over the serial line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServedProgram {
    /// Its bytes, as they stand on the wire.
    pub bytes: Vec<u8>,
}

/// The receiving end: a board, a log, or nobody ([`Unwired`]).
///
/// Calls come in the order of their times, which never go back.
pub trait Wires {
    /// Bytes on the control's serial line; `at` is when the last of them has gone.
    fn serial(&mut self, at: Micros, bytes: &[u8]);

    /// The probe's skip line rises. `counts` are the encoders' counts of X, Y and Z
    /// at that instant.
    fn skip(&mut self, at: Micros, counts: [i64; 3]);

    /// It falls: the stylus is free again, or the probe is out of the spindle.
    fn skip_falls(&mut self, _at: Micros, _counts: [i64; 3]) {}

    /// Nothing else happens until then: time passes.
    fn time(&mut self, now: Micros);

    /// How often [`Self::moved`] is told of axes in motion, seconds; none: never.
    fn sampling_s(&self) -> Option<f64> {
        None
    }

    /// The encoders' counts of X, Y and Z at that instant: when the machine is switched
    /// on, along a motion and at its end.
    fn moved(&mut self, _at: Micros, _counts: [i64; 3]) {}

    /// The encoders' counts of the rotary axes, in the order of the scene, from now on: what
    /// [`Self::moved`], [`Self::skip`] and [`Self::stands`] tell of X, Y, Z goes with them.
    fn turned(&mut self, _counts: &[i64]) {}

    /// Whether the sensor in the spindle is to be triggered from now on; asked again after
    /// every capture and every byte.
    fn sensor_order(&self) -> Option<SensorOrder> {
        None
    }

    /// The sensor was triggered with the axes at these counts, and this came of it.
    fn captured(&mut self, _: Micros, _: [i64; 3], _: Result<SensorSignal, SensorFault>) {}

    /// Whether the board holds the control's skip input on.
    fn skip_input(&self) -> bool {
        false
    }

    /// Whether the board holds one of the control's digital inputs on (LinuxCNC's `M66 P`).
    fn digital_input(&self, _number: u16) -> bool {
        false
    }

    /// The control's output for coolant (M8, M9), where it is wired to the board.
    fn gate(&mut self, _at: Micros, _is_on: bool, _counts: [i64; 3]) {}

    /// The axes stand at these counts while bytes go out: before [`Self::serial`].
    fn stands(&mut self, _counts: [i64; 3]) {}

    /// Whether nobody is there who could answer with a program.
    fn is_silent(&self) -> bool {
        true
    }

    /// The control asks for a program over its serial line; none as long as it is not there.
    fn program(&mut self, _now: Micros, _number: u32) -> Option<ServedProgram> {
        None
    }
}

/// Nothing is connected.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwired;

impl Wires for Unwired {
    fn serial(&mut self, _: Micros, _: &[u8]) {}
    fn skip(&mut self, _: Micros, _: [i64; 3]) {}
    fn time(&mut self, _: Micros) {}
}
