//! A laser line scanner carried by the machine: what its camera sees of the laser's line.
//!
//! * [`optics`]: rays to the surface, occlusion, mirrors, the mean over an exposure.
//! * `noise`: noise, speckle, mixed samples at edges.
//! * [`trigger`]: its input with least pulse and busy time, its clock.
//! * [`channel`]: its data channel, byte for byte a Gocator's.
//! * [`device`]: all of it, pulse by pulse; [`serve`]: the channel over TCP.
//!
//! # Model
//! A column of the camera is a straight line in the laser's plane, and a sample of a profile is
//! where that line first meets a surface. It has no range where the field or the range ends,
//! where the surface is steeper than stated, where the camera cannot see the place, and where a
//! surface that mirrors saturates it. Its error is along its column: z moves, and x with it.
//!
//! # Limitations
//! The laser comes from the point where the columns meet, so that it reaches what a column
//! meets first. A light that was mirrored twice is not followed.

pub mod channel;
pub mod device;
mod noise;
pub mod optics;
pub mod serve;
#[cfg(test)]
mod tests;
pub mod trigger;

use nalgebra::Vector3;

use crate::scene::{BeamEnd, Scene};

pub use channel::encode;
pub use device::{LineScanner, ScannerTally};
pub use optics::Optics;
pub use serve::DataChannel;
pub use trigger::{PulseFate, SensorClock, TriggerInput};

/// A sample of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineSample {
    /// Along the line.
    pub x_mm: f64,
    /// Towards the sensor.
    pub z_mm: f64,
    /// Cosine of the laser's incidence.
    pub cosine: f64,
    /// The reflex of another place: there is no surface here.
    pub is_false: bool,
}

impl LineSample {
    /// How bright the camera sees it, of 0 to 255: a surface that scatters evenly, by its incidence; a reflex of
    /// a mirror saturates.
    #[must_use]
    pub fn brightness(&self) -> f64 {
        if self.is_false {
            return 255.0;
        }
        200.0 * self.cosine.clamp(0.0, 1.0)
    }
}

/// A profile: a place for each column of the camera.
pub type LineProfile = Vec<Option<LineSample>>;

/// What a laser can fall on.
pub trait LaserTarget: Sync {
    /// Where a beam first meets it within a way; `direction` is a unit vector.
    fn beam(
        &self,
        from_mm: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd>;
}

impl LaserTarget for Scene {
    fn beam(
        &self,
        from_mm: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd> {
        Self::beam(self, from_mm, direction, far_mm, |_| true).map(|(_, end)| end)
    }
}
