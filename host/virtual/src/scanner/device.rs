//! A scanner at work: pulses in, messages out.

use umi_kinematics::Pose;

use super::channel::{FrameStamp, encode};
use super::trigger::{PulseFate, SensorClock, TriggerInput};
use super::{LaserTarget, LineProfile, Optics, noise};
use crate::random::Random;
use crate::scene::LineScannerSpec;

/// What a sensor has counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScannerTally {
    /// Profiles that were taken.
    pub taken: u64,
    /// Pulses that came while it was busy.
    pub busy: u64,
    /// Pulses that were too short.
    pub short: u64,
    /// Profiles whose messages were lost on the way.
    pub lost: u64,
    /// Profiles whose messages came twice.
    pub repeated: u64,
}

/// A sensor. The same seed gives the same noise, losses and repetitions.
#[derive(Clone, Debug)]
pub struct LineScanner {
    optics: Optics,
    input: TriggerInput,
    clock: SensorClock,
    random: Random,
    /// Losses on the way have dice of their own: the noise does not depend on them.
    way: Random,
    tally: ScannerTally,
}

impl LineScanner {
    /// A sensor.
    #[must_use]
    pub fn new(spec: LineScannerSpec, seed: u64) -> Self {
        Self {
            input: TriggerInput::new(&spec),
            clock: SensorClock::new(&spec),
            random: Random::new(seed),
            way: Random::new(seed ^ 0x5EED),
            tally: ScannerTally::default(),
            optics: Optics::new(spec),
        }
    }

    /// What it is.
    #[must_use]
    pub const fn spec(&self) -> &LineScannerSpec {
        self.optics.spec()
    }

    /// Its geometry.
    #[must_use]
    pub const fn optics(&self) -> &Optics {
        &self.optics
    }

    /// What it has counted.
    #[must_use]
    pub const fn tally(&self) -> ScannerTally {
        self.tally
    }

    /// A pulse at its trigger input, or of its own: whether a profile is taken.
    pub fn pulse(&mut self, at_us: f64, width_us: f64) -> PulseFate {
        let fate = self.input.pulse(at_us, width_us);
        match fate {
            PulseFate::Taken => {}
            PulseFate::TooShort => self.tally.short += 1,
            PulseFate::Busy => self.tally.busy += 1,
        }
        fate
    }

    /// The profile of a pulse that was taken; `pose` as for [`Optics::profile`].
    pub fn take(&mut self, surface: &dyn LaserTarget, pose: impl Fn(f64) -> Pose) -> LineProfile {
        let profile = self.optics.profile(surface, pose);
        self.noisy(profile)
    }

    /// What the sensor makes of what its camera sees.
    pub fn noisy(&mut self, mut profile: LineProfile) -> LineProfile {
        noise::add(&mut profile, &self.optics, &mut self.random);
        profile
    }

    /// The bytes that the host gets of the next profile: none if they are lost on the way,
    /// twice the same if they are repeated.
    pub fn send(&mut self, at_us: f64, encoder: i64, profile: &LineProfile) -> Vec<u8> {
        let stamp = FrameStamp {
            frame: self.tally.taken,
            t_us: self.clock.shows_us(at_us),
            encoder,
        };
        self.tally.taken += 1;
        let (lost, repeated) = (self.way.between(0.0, 1.0), self.way.between(0.0, 1.0));
        if lost < self.spec().lost_share {
            self.tally.lost += 1;
            return Vec::new();
        }
        let mut bytes = encode(&stamp, profile, self.spec());
        if repeated < self.spec().repeated_share {
            self.tally.repeated += 1;
            bytes.extend_from_within(..);
        }
        bytes
    }
}
