//! What a station has to tell.

use super::command::CommandFault;
use super::text::SignalLoss;
use crate::units::{Mm, Point};

/// Something for the journal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StationRecord {
    /// A place was measured, or was not, and why.
    Place(PlacePoint),
    /// A latch whose reading never came.
    Lost {
        /// Number of the latch.
        latch: u32,
    },
    /// A reading that no latch belongs to.
    Unpaired {
        /// Number of the reading.
        reading: u32,
    },
    /// Text of the sensor that is no reading.
    Unreadable,
    /// A line of the control that was not carried out.
    Refused(CommandFault),
}

/// How a place ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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

/// What was measured at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacePoint {
    /// The place's number in the order of measuring, from 0.
    pub number: u32,
    /// Whether there is a point, or why not.
    pub state: PlaceState,
    /// Where the axes stood: the mean of the latches.
    pub axes: Point,
    /// Mean of the readings.
    pub gamma: Mm,
    /// Standard deviation of the readings.
    pub spread: Mm,
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
    pub point: Option<Point>,
}

impl Default for PlacePoint {
    fn default() -> Self {
        Self {
            number: 0,
            state: PlaceState::Ok,
            axes: Point::from_mm(0.0, 0.0, 0.0),
            gamma: Mm(0.0),
            spread: Mm(0.0),
            captures: 0,
            outliers: 0,
            lost: 0,
            snr: 0.0,
            total: 0.0,
            point: None,
        }
    }
}
