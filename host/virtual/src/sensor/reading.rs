//! What comes of a capture.

use std::fmt;

/// A reading with its quality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorSignal {
    /// Way along the beam.
    pub gamma_mm: f64,
    /// Signal to noise, per cent.
    pub snr: f64,
    /// Light received, in the sensor's units.
    pub total: f64,
}

/// Captures at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorCaptures {
    /// Their mean.
    pub signal: SensorSignal,
    /// Their standard deviation.
    pub spread_mm: f64,
    /// How many they are.
    pub count: u32,
}

/// Why there is no reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoSignal {
    /// No surface within the depth of field.
    OutOfRange,
    /// The surface is steeper than the sensor's angle.
    TooSteep,
    /// Something stands before the surface.
    Occluded,
    /// Too little light comes back.
    Underexposed,
}

impl NoSignal {
    /// The name, as in a cloud's column.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::OutOfRange => "out_of_range",
            Self::TooSteep => "too_steep",
            Self::Occluded => "occluded",
            Self::Underexposed => "underexposed",
        }
    }
}

/// Why a capture fails.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorFault {
    /// There is nothing to read.
    NoSignal(NoSignal),
    /// The sensor is not so fast.
    RateTooHigh {
        /// What was asked for.
        rate_hz: f64,
        /// What it does.
        max_rate_hz: f64,
    },
    /// The laser is not so strong.
    PowerTooHigh {
        /// What was asked for.
        power: f64,
        /// What it has.
        power_max: f64,
    },
    /// The mean of no captures.
    NoCaptures,
}

impl SensorFault {
    /// The class, for machines: never changes.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::NoSignal(why) => why.code(),
            Self::RateTooHigh { .. } => "rate_too_high",
            Self::PowerTooHigh { .. } => "power_too_high",
            Self::NoCaptures => "no_captures",
        }
    }
}

impl fmt::Display for SensorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSignal(NoSignal::OutOfRange) => {
                f.write_str("no surface within the depth of field: move along the beam")
            }
            Self::NoSignal(NoSignal::TooSteep) => {
                f.write_str("the surface is steeper than the sensor's angle: tilt the part")
            }
            Self::NoSignal(NoSignal::Occluded) => {
                f.write_str("something stands between the sensor and the surface")
            }
            Self::NoSignal(NoSignal::Underexposed) => {
                f.write_str("too little light comes back: more power, or a lower rate")
            }
            Self::RateTooHigh {
                rate_hz,
                max_rate_hz,
            } => write!(
                f,
                "{rate_hz} captures a second are asked for, the sensor takes more than 0 and at most {max_rate_hz}"
            ),
            Self::PowerTooHigh { power, power_max } => {
                write!(f, "the power {power} is not from 0 to {power_max}")
            }
            Self::NoCaptures => f.write_str("one capture at least is needed"),
        }
    }
}

impl std::error::Error for SensorFault {}
