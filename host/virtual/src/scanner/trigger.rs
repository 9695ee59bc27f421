//! The sensor's trigger input and its clock.

use crate::scene::LineScannerSpec;

/// What becomes of a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulseFate {
    /// A profile is taken.
    Taken,
    /// Shorter than the input sees.
    TooShort,
    /// The sensor is still at the profile before.
    Busy,
}

/// The input.
#[derive(Clone, Debug)]
pub struct TriggerInput {
    least_us: f64,
    busy_us: f64,
    free_at_us: f64,
}

impl TriggerInput {
    /// The input of a sensor.
    #[must_use]
    pub const fn new(spec: &LineScannerSpec) -> Self {
        Self {
            least_us: spec.least_pulse_us,
            busy_us: spec.busy_us,
            free_at_us: f64::NEG_INFINITY,
        }
    }

    /// A pulse begins at a time and lasts so long.
    pub fn pulse(&mut self, at_us: f64, width_us: f64) -> PulseFate {
        if width_us < self.least_us {
            return PulseFate::TooShort;
        }
        if at_us < self.free_at_us {
            return PulseFate::Busy;
        }
        self.free_at_us = at_us + self.busy_us;
        PulseFate::Taken
    }
}

/// The clock of a sensor, against that of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorClock {
    offset_us: f64,
    rate: f64,
}

impl SensorClock {
    /// The clock of a sensor.
    #[must_use]
    pub fn new(spec: &LineScannerSpec) -> Self {
        Self {
            offset_us: spec.clock_offset_us,
            rate: 1.0 + spec.clock_drift_ppm * 1e-6,
        }
    }

    /// What it shows when the board's shows this, in true microseconds.
    #[must_use]
    pub fn shows_us(&self, board_us: f64) -> f64 {
        self.offset_us + self.rate * board_us
    }
}
