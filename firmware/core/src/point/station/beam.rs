//! Whether readings change with the axes as the calibration says.

use nalgebra::Vector3;

use super::record::{PlacePoint, PlaceState};
use crate::point::PointSensor;

/// Along the beam the reading must change as the axes move, to this and a part of the way: a direction that is a degree
/// off changes it by as much on a surface at 45 degrees.
const BEAM_MM: f64 = 0.01;
const BEAM_PART: f64 = 0.02;

/// A shorter way says nothing about the beam.
const BEAM_WAY_MM: f64 = 0.05;

/// ... and the noise of the two means may move it by so many of its standard deviations: no
/// false alarm in a million places, even from the scatter of thirty captures.
const BEAM_SIGMAS: f64 = 7.0;

/// After so many readings in succession that do not follow, each an edge as it seems, the beam is to be proven anew ...
const DOUBTS: u8 = 3;

/// ... and so many are no edges of any part.
const MOST_DOUBTS: u8 = 20;

/// So many captures that are alike to the last figure are no chance.
const FROZEN: f64 = 4.0;

/// Where noise may move it by more than this part of the way, a swapped sign could pass: such a
/// way proves nothing.
const BEAM_PROOF: f64 = 0.5;

/// Where the axes stood, and what was read there.
#[derive(Clone, Copy, Debug)]
struct Seen {
    axes: Vector3<f64>,
    gamma: f64,
    /// Captures in its mean.
    captures: f64,
}

/// What is known of the beam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Known {
    /// Nothing yet.
    #[default]
    Nothing,
    /// Readings change with the axes as the calibration says.
    Follows,
    /// They did; the last ones did not.
    Doubtful,
    /// They do not.
    Wrong,
    /// Their noise hides whether they do.
    Hidden,
}

/// The proof of the beam since the sensor was configured.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BeamProof {
    known: Known,
    seen: Option<Seen>,
    /// How often in succession a reading did not follow.
    doubts: u8,
    /// Squares of the readings' differences from the means at rest, mm², and their degrees of freedom.
    scatter: (f64, f64),
}

impl BeamProof {
    /// A beam that is proven already.
    #[cfg(test)]
    pub(super) fn follows() -> Self {
        Self {
            known: Known::Follows,
            ..Self::default()
        }
    }

    /// Standard deviation of a reading at rest, mm; none: too few were made there.
    pub(super) fn sigma_mm(&self) -> Option<f64> {
        let (sum, freedom) = self.scatter;
        (freedom >= FROZEN).then(|| libm::sqrt(sum / freedom))
    }

    /// The next reading is of another place: it proves nothing with the last one.
    pub(super) const fn leave(&mut self) {
        self.seen = None;
    }

    /// What becomes of a place that is otherwise good.
    pub(super) const fn state(&self) -> PlaceState {
        match self.known {
            Known::Follows => PlaceState::Ok,
            Known::Wrong => PlaceState::BeamMismatch,
            Known::Doubtful => PlaceState::Edge,
            Known::Nothing | Known::Hidden => PlaceState::BeamUnproven,
        }
    }

    /// Where the axes have moved along the beam since the last reading of this place, the
    /// reading must have changed by as much, but for the noise of both.
    pub(super) fn check(&mut self, sensor: &PointSensor, found: &mut PlacePoint, place: bool) {
        let captures = f64::from(found.captures.max(1));
        // Of one reading: that of all places together, for a few captures say little of it.
        let squares = found.spread.0 * found.spread.0 * captures;
        self.scatter.0 += squares;
        self.scatter.1 += captures - 1.0;
        let (sum, freedom) = self.scatter;
        let mut is_edge = false;
        // A sensor with noise that says the same again and again does not measure any more.
        if squares == 0.0 && captures >= FROZEN && sum > 1e-12 * freedom {
            self.known = Known::Wrong;
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
                let is_off = off > BEAM_MM + BEAM_PART * length + noise;
                let is_proof = noise <= BEAM_PROOF * length;
                self.doubts = if is_off {
                    self.doubts.saturating_add(1)
                } else {
                    0
                };
                is_edge = is_off;
                self.known = match self.known {
                    Known::Wrong => Known::Wrong,
                    // One reading beside the others is an edge of the part.
                    Known::Follows if self.doubts < DOUBTS => Known::Follows,
                    Known::Follows | Known::Doubtful if is_off && self.doubts < MOST_DOUBTS => {
                        Known::Doubtful
                    }
                    Known::Doubtful if !is_off && !is_proof => Known::Doubtful,
                    _ if is_off => Known::Wrong,
                    _ if is_proof => Known::Follows,
                    _ => Known::Hidden,
                };
            }
        }
        // What is to prove it cannot wait for the proof.
        if self.known != Known::Nothing || place {
            found.state = self.state();
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
}
