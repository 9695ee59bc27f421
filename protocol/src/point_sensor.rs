//! A distance sensor in the spindle: how it is set up on a board, and what a board says of it.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

use crate::latch::TriggerPulse;

/// Characters of a control's line to the station, at most.
pub const MAX_COMMAND: usize = 120;

/// The slowest line of a sensor, baud.
pub const LEAST_SENSOR_BAUD: u32 = 1200;
/// The fastest.
pub const MOST_SENSOR_BAUD: u32 = 3_000_000;

/// A calibrated distance sensor on a board's second serial port.
///
/// ```toml
/// offset_mm = [0.12, -0.08, -164.0]   # from the axes' position to the zero of the readings
/// direction = [0.01, 0.02, -0.99975]  # of the beam: a unit vector
/// counts_per_mm = [1000, 1000, 1000]
/// origin_counts = [0, 0, 0]
/// max_rate_hz = 9000
/// power_max = 5000
/// baud = 921600
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct SensorOnBoard {
    /// From the axes' position to the zero of the readings, mm.
    pub offset_mm: [f64; 3],
    /// The beam: a unit vector.
    pub direction: [f64; 3],
    /// Gain of the readings.
    #[serde(default = "one")]
    pub gain: f64,
    /// Encoder counts per millimetre of X, Y and Z, negative where they count down.
    pub counts_per_mm: [f64; 3],
    /// Counts where the axes' coordinates are zero.
    pub origin_counts: [i64; 3],
    /// Most captures a second.
    pub max_rate_hz: f64,
    /// Largest value of the laser's power.
    pub power_max: f64,
    /// Speed of the sensor's line, which has 8 data bits, no parity and 1 stop bit.
    pub baud: u32,
    /// How it writes a reading.
    #[serde(default)]
    pub text: SensorText,
    /// Which edge is a capture.
    #[serde(default)]
    pub captured_at: CapturedAt,
    /// The pulse by which it is triggered.
    #[serde(default)]
    pub pulse: TriggerPulse,
}

const fn one() -> f64 {
    1.0
}

/// Which edge latches the axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum CapturedAt {
    /// The board's own trigger pulse ([`crate::latch::LatchCause::Output`]).
    #[default]
    Pulse,
    /// What the sensor sends back while it captures, at the board's trigger input
    /// ([`crate::latch::LatchCause::Trigger`]).
    Sync,
}

/// What stands between the columns of a reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum ColumnSeparator {
    /// Blanks; several count as one.
    #[default]
    Blank,
    /// A comma.
    Comma,
    /// A semicolon.
    Semicolon,
    /// A tabulator.
    Tab,
}

/// How a sensor writes a reading: columns, counted from 0. A distance that is no number is no
/// signal; its reason is then in the column behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct SensorText {
    /// Between the columns.
    pub separator: ColumnSeparator,
    /// The reading's own number.
    pub number: u8,
    /// Distance, mm.
    pub gamma: u8,
    /// Signal to noise, per cent.
    pub snr: u8,
    /// Light received.
    pub total: u8,
}

impl Default for SensorText {
    /// Number, distance, SNR, Total with blanks between them.
    fn default() -> Self {
        Self {
            separator: ColumnSeparator::Blank,
            number: 0,
            gamma: 1,
            snr: 2,
            total: 3,
        }
    }
}

/// Why there is no reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum SignalLoss {
    /// No surface within the depth of field.
    OutOfRange,
    /// The surface is steeper than the sensor's angle.
    TooSteep,
    /// Something stands before the surface.
    Occluded,
    /// Too little light comes back.
    Underexposed,
}

/// How a place ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum PlaceState {
    /// There is a point.
    #[default]
    Ok,
    /// No signal.
    NoSignal(SignalLoss),
    /// A capture has no reading.
    LostCapture,
    /// The axes moved between the captures.
    Moved,
    /// Readings do not change with the axes as the calibration says.
    BeamMismatch,
    /// Nothing has shown that they do: no signal where it was tried, or noise hides it.
    BeamUnproven,
    /// The captures on the way to it and from it follow no smooth surface; at rest, the reading
    /// changed otherwise than the axes along the beam, and others before did not.
    Edge,
    /// The command cannot be carried out.
    Refused,
}

impl PlaceState {
    /// The name, as in a cloud's column: never changes.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::NoSignal(SignalLoss::OutOfRange) => "out_of_range",
            Self::NoSignal(SignalLoss::TooSteep) => "too_steep",
            Self::NoSignal(SignalLoss::Occluded) => "occluded",
            Self::NoSignal(SignalLoss::Underexposed) => "underexposed",
            Self::LostCapture => "lost_capture",
            Self::Moved => "moved",
            Self::BeamMismatch => "beam_mismatch",
            Self::BeamUnproven => "beam_unproven",
            Self::Edge => "edge",
            Self::Refused => "refused",
        }
    }

    /// The number that the control's macro gets: 1 is a reading, 2 to 5 are no signal, what is
    /// above is an alarm.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Ok => 1,
            Self::NoSignal(SignalLoss::OutOfRange) => 2,
            Self::NoSignal(SignalLoss::TooSteep) => 3,
            Self::NoSignal(SignalLoss::Occluded) => 4,
            Self::NoSignal(SignalLoss::Underexposed) => 5,
            Self::LostCapture => 6,
            Self::Moved => 7,
            Self::BeamMismatch => 8,
            Self::Refused => 9,
            Self::Edge => 10,
            Self::BeamUnproven => 11,
        }
    }
}

/// What was measured at a place: P = Q + t + γ g a, of captures that were averaged.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct PlaceReport {
    /// The place's number in the order of measuring, from 0.
    pub number: u32,
    /// Whether there is a point, or why not.
    pub state: PlaceState,
    /// Where the axes stood: the mean of the latches.
    pub axes_mm: [f64; 3],
    /// Mean of the readings.
    pub gamma_mm: f64,
    /// Standard deviation of the readings.
    pub spread_mm: f64,
    /// Readings in the mean.
    pub captures: u32,
    /// Readings left out for their signal.
    pub outliers: u32,
    /// Captures without a reading.
    pub lost: u32,
    /// Mean signal to noise, per cent.
    pub snr: f64,
    /// Mean light received.
    pub total: f64,
    /// The point, where `state` is OK.
    pub point_mm: Option<[f64; 3]>,
}

/// Something between sensor, board and control that was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum CaptureLoss {
    /// A latch whose reading never came.
    Latch {
        /// Its number.
        latch: u32,
    },
    /// A reading that no latch belongs to.
    Reading {
        /// Its own number.
        reading: u32,
    },
    /// Text of the sensor that is no reading.
    Text,
    /// Characters of the sensor that were lost before they could be read.
    Characters {
        /// How many, at least.
        count: u32,
    },
    /// A line of the control that was not carried out.
    Command(CommandFault),
    /// Records of the station that found no room.
    Records {
        /// How many.
        count: u32,
    },
    /// The sensor that was set up is not in force any more, since the start.
    Setup(SensorLoss),
}

/// Why a sensor that was set up could not be restored at start. Where none was, nothing is told.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum SensorLoss {
    /// It was kept by a firmware with other messages.
    #[error(
        "the sensor was set up by a firmware with other messages, which this one does not read: set it up again"
    )]
    OtherSchema,
    /// It was kept and cannot be read.
    #[error("the sensor was set up and cannot be read any more: set it up again")]
    Damaged,
    /// This firmware does not take the sensor that was kept.
    #[error("this firmware does not take the sensor that was set up: set it up again")]
    Refused,
}

impl SensorLoss {
    /// Its name for programs.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}

/// Why a line was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum CommandFault {
    /// It is not written as a command is.
    Unreadable,
    /// Its check value is another one.
    CheckValue,
    /// There is no such command, or not with these values, or not before the sensor is configured.
    Value,
}

impl CommandFault {
    /// The name.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::Unreadable => "unreadable",
            Self::CheckValue => "check_value",
            Self::Value => "value",
        }
    }
}

/// A line to the station, as the control's macro prints it.
pub type CommandText = Vec<u8, MAX_COMMAND>;

/// The answer to a line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct StationAnswer {
    /// The line's own number.
    pub sequence: u16,
    /// How it ended.
    pub state: PlaceState,
    /// Mean reading; 0 where there is none.
    pub gamma_mm: f64,
}

/// What the station does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct SensorStatus {
    /// The sensor in force; none: nothing is captured.
    pub sensor: Option<SensorOnBoard>,
    /// Why the one that was set up is not, until one is set up.
    pub setup_lost: Option<SensorLoss>,
    /// A line waits for its answer.
    pub waits: bool,
    /// The latest answer.
    pub answer: Option<StationAnswer>,
    /// The skip line is raised.
    pub skip: bool,
    /// Captures that were paired with their readings, since the board started.
    pub paired: u32,
    /// Latches without a reading, since the board started.
    pub lost: u32,
    /// Readings without a latch, since the board started.
    pub unpaired: u32,
    /// Lines of the sensor that were no readings, since the board started.
    pub unreadable: u32,
}

/// Why a sensor or a line is not taken.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum SensorRefusal {
    /// Something is no number.
    #[error("a value of the sensor is not finite: take a calibration that `umi` wrote")]
    NotFinite,
    /// The beam has no direction.
    #[error("`direction` must have length 1 within 1e-6")]
    Direction,
    /// The readings have no gain.
    #[error("`gain` must be 0.5 to 2")]
    Gain,
    /// Counts per millimetre.
    #[error("`counts_per_mm` must be 1 to 10 000 000 for each axis, negative where it counts down")]
    CountsPerMm,
    /// The rate.
    #[error("`max_rate_hz` must be 1 to 100 000")]
    Rate,
    /// The power.
    #[error("`power_max` must be positive")]
    Power,
    /// The line.
    #[error("`baud` must be 1200 to 3 000 000")]
    Baud,
    /// The columns.
    #[error("`text`: number, gamma, snr and total must be four different columns, 0 to 7")]
    Columns,
    /// The pulse.
    #[error("the board does not send such pulses: see its README")]
    Pulse,
    /// A program of the control is being served.
    #[error("the station waits for captures: ask again when it has answered")]
    UnderWay,
    /// There is no sensor.
    #[error("no sensor is set up on this board: `umi scan serve --sensor` does it")]
    NoSensor,
}

impl SensorRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}
