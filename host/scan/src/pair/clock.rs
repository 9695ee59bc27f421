//! What the pairs say about the two clocks.

use serde::Serialize;

use super::trains::Trains;

/// `board = offset + (1 + drift·1e-6) · sensor`, by least squares over the pairs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClockFit {
    /// Board's time at the sensor's time 0, in microseconds.
    pub offset_us: f64,
    /// How much faster the board's clock is, in parts per million.
    pub drift_ppm: f64,
    /// The line through the centres of both trains, where digits are not lost.
    #[serde(skip)]
    pub(super) centred: (f64, f64),
}

impl Trains {
    /// The straight line through the pairs; no drift for one pair.
    pub(super) fn clock(&self, found: &[Option<usize>]) -> ClockFit {
        let mut by_place = vec![None; found.len()];
        for (profile, latch) in found.iter().enumerate() {
            by_place[self.place(profile)] = *latch;
        }
        let (offset, drift) = self.line(&by_place, (0.0, 0.0));
        let (centre_s, centre_b) = self.centres();
        ClockFit {
            offset_us: centre_b + offset - (1.0 + drift) * centre_s,
            drift_ppm: drift * 1e6,
            centred: (offset, drift),
        }
    }
}
