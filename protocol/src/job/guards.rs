//! Guards against errors that leave no trace in one setup.

use core::fmt;

use heapless::Vec;
use postcard_derive::Schema;
use serde::de::{Deserializer, Error, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::Name;

/// Features that repeat another one, at most.
pub const MAX_CLOSING: usize = 3;
/// Features that stay on the table, at most.
pub const MAX_FIXED: usize = 2;

/// Guards against errors that leave no trace in one setup. Each is off where it is absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct Guards {
    /// Features that are another feature, probed once more: what moved between the two shows, and
    /// the feature's place is the mean of both.
    pub closing: Vec<Closing, MAX_CLOSING, u8>,
    /// Features that stay on the table while parts change: a longer probe, a bent stylus or
    /// a machine that drifts shows. Their places are learned with the reference.
    pub fixed: Vec<Name, MAX_FIXED, u8>,
    /// How far a feature on the table may be from where it was when the reference was taught.
    pub fixed_mm: Option<f64>,
    /// How far distances between datum features may be from those of their `position_mm`,
    /// in every setup, also in the one that is taught.
    pub nominal_distance_mm: Option<f64>,
    /// How far a feature may be from how it was in the taught setup.
    pub learned: Option<LearnedLimits>,
    /// What one hit scatters: then the expected error rests on it and on all residuals, and
    /// is honest with few hits.
    pub probing: Option<ProbingSpec>,
    /// Warmer or colder than taught: told, and up to a limit no reason against a setup.
    pub warmth: Option<WarmthSpec>,
    /// The control's variable that counts the runs: the correction compares it with the run
    /// that was measured and raises an alarm where they differ.
    pub run_variable: Option<u32>,
    /// Every run must say in which work offset, with which values, it is probed, that no
    /// rotation is active, what else moves its coordinates, and that nothing shifts them besides
    /// (G52, G92).
    pub frame: bool,
    /// The external offset (`#5201`; G52 on a Haas, G52 and G92 on LinuxCNC) that a run must have.
    pub external_mm: [f64; 3],
    /// The tool length in force that a run must have; absent: that of the taught run.
    pub tool_length_mm: Option<f64>,
}

/// A feature that is another one, probed once more. The mean of all its times counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Closing {
    /// The feature that repeats.
    pub feature: Name,
    /// The feature that it repeats.
    pub repeats: Name,
    /// How far apart the two may be.
    pub within_mm: f64,
}

/// How far a feature may be from how it was in the taught setup; where several taught, below
/// the smallest of them and above the largest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct LearnedLimits {
    /// Its radius, to either side.
    pub radius_mm: f64,
    /// The rms of its residuals, upwards.
    pub rms_mm: f64,
    /// How far beside the centre the hits were approached, upwards.
    pub centring_mm: f64,
}

/// What one hit scatters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct ProbingSpec {
    /// Standard deviation of one hit along X, along Y and along Z, from a calibration. What the
    /// control's step adds to it comes on top. A job file may say one number, where the axes
    /// scatter alike.
    #[serde(deserialize_with = "alike_or_each")]
    pub sigma_mm: [f64; 3],
    /// Degrees of freedom of that calibration: repeated hits less one; of each axis, if they
    /// were calibrated one by one.
    pub dof: u16,
}

impl ProbingSpec {
    /// One number for the three axes.
    #[must_use]
    pub const fn alike(sigma_mm: f64, dof: u16) -> Self {
        let sigma_mm = [sigma_mm; 3];
        Self { sigma_mm, dof }
    }

    /// That of the three, if it is one number.
    #[must_use]
    #[allow(clippy::float_cmp, reason = "copies of one number")]
    pub fn same_mm(&self) -> Option<f64> {
        let [x, y, z] = self.sigma_mm;
        (x == y && y == z).then_some(x)
    }

    /// Of the axis that scatters most.
    #[must_use]
    pub fn worst_mm(&self) -> f64 {
        let [x, y, z] = self.sigma_mm;
        x.max(y).max(z)
    }
}

/// Three numbers, or in a text one for all three; bytes have three always.
fn alike_or_each<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
    if from.is_human_readable() {
        from.deserialize_any(AlikeOrEach)
    } else {
        <[f64; 3]>::deserialize(from)
    }
}

struct AlikeOrEach;

impl<'de> Visitor<'de> for AlikeOrEach {
    type Value = [f64; 3];

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, or three in brackets: of X, Y and Z")
    }

    fn visit_f64<E: Error>(self, all: f64) -> Result<[f64; 3], E> {
        Ok([all; 3])
    }

    fn visit_i64<E: Error>(self, all: i64) -> Result<[f64; 3], E> {
        self.visit_f64(all as f64)
    }

    fn visit_u64<E: Error>(self, all: u64) -> Result<[f64; 3], E> {
        self.visit_f64(all as f64)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut each: A) -> Result<[f64; 3], A::Error> {
        let mut sigma = [0.0; 3];
        for (at, axis) in sigma.iter_mut().enumerate() {
            let next = each.next_element()?;
            *axis = next.ok_or_else(|| Error::invalid_length(at, &self))?;
        }
        match each.next_element::<f64>()? {
            None => Ok(sigma),
            Some(_) => Err(Error::invalid_length(4, &self)),
        }
    }
}

/// The expansion of plate and part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct WarmthSpec {
    /// Expansion of the plate, millionths per kelvin: steel 11.5, aluminium 23.
    pub expansion_ppm_per_k: f64,
    /// How much warmer or colder than taught it may be.
    pub at_most_k: f64,
}

/// Spheres whose last hit touches once more where the first one did (`approach` begins and
/// ends alike): a first touch that came early shows, although the hits between follow it.
///
/// ```toml
/// [again]
/// within_mm = 0.008
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct AgainSpec {
    /// How far the two may be apart along their approach.
    pub within_mm: f64,
}
