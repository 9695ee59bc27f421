//! What a station has to tell.

use umi_protocol::point_sensor::{CaptureLoss, CommandFault, PlaceReport};

pub use umi_protocol::point_sensor::PlaceState;

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

impl StationRecord {
    /// As it is journaled: a place, or what was lost.
    ///
    /// # Errors
    /// It is no place.
    pub fn report(&self) -> Result<PlaceReport, CaptureLoss> {
        Err(match *self {
            Self::Place(place) => return Ok(place.report()),
            Self::Lost { latch } => CaptureLoss::Latch { latch },
            Self::Unpaired { reading } => CaptureLoss::Reading { reading },
            Self::Unreadable => CaptureLoss::Text,
            Self::Refused(fault) => CaptureLoss::Command(fault),
        })
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

impl PlacePoint {
    /// As it is journaled.
    #[must_use]
    pub fn report(&self) -> PlaceReport {
        PlaceReport {
            number: self.number,
            state: self.state,
            axes_mm: self.axes.to_array_mm(),
            gamma_mm: self.gamma.0,
            spread_mm: self.spread.0,
            captures: self.captures,
            outliers: self.outliers,
            lost: self.lost,
            snr: self.snr,
            total: self.total,
            point_mm: self.point.map(|point| point.to_array_mm()),
        }
    }
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
