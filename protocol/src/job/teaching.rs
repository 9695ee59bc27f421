//! Where the nominal positions come from: what teaches them, and what a taught setup has shown.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use super::MAX_FEATURES;

/// Where the nominal positions come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// From the job: every datum feature has a `position_mm`.
    Given,
    /// The first setup that keeps all limits becomes the reference for those
    /// that follow, as case 0 of the thesis (Sawula 2013, section 4.3).
    Taught,
}

/// What makes a setup the reference, where it is taught.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Teach {
    /// The first setup that keeps all limits, as in the thesis (Sawula 2013, section 4.3).
    /// An older setup that stood in a buffer, or a later one after the first was refused,
    /// then becomes the reference without a word.
    #[default]
    FirstOk,
    /// The setup that comes next after somebody asked for it: the host, or a checked line.
    /// If that one is refused, nothing is taught until it is asked for again.
    Asked,
}

/// How a feature was in the taught setup.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Learned {
    /// Fitted radius; 0 where it has none.
    pub radius_mm: f64,
    /// Rms of the residuals.
    pub rms_mm: f64,
    /// How far beside the centre the hits were approached, at most; 0 where not known.
    pub centring_mm: f64,
}

impl Learned {
    fn of_each(&self, other: &Self, of: fn(f64, f64) -> f64) -> Self {
        Self {
            radius_mm: of(self.radius_mm, other.radius_mm),
            rms_mm: of(self.rms_mm, other.rms_mm),
            centring_mm: of(self.centring_mm, other.centring_mm),
        }
    }
}

/// What the taught setups have shown of each feature of the job, in its order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Lessons {
    /// The smallest of all setups that taught.
    pub smallest: Vec<Learned, MAX_FEATURES>,
    /// The largest; empty where one setup taught: then they are the same. Older records end
    /// before.
    pub largest: Vec<Learned, MAX_FEATURES>,
    /// Setups that have taught after the first.
    pub further: u16,
    /// The tool length in force in the first one, where its run said it.
    pub tool_length_mm: Option<f64>,
    /// The feed of its hits; 0 where their lines do not say it.
    pub feed_mm_per_min: f64,
    /// Whether the first one is the setup that was meant.
    pub doubt: Doubt,
    /// The first one's run.
    pub run: u32,
    /// The run in which the control had last been asked to teach by a line, as far as the board has read of it; 0 where
    /// the runs do not say it.
    pub asked_in: u32,
}

/// Who has taught a setup, as long as it may not be the one that was meant but an old text that came late.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Doubt {
    /// There is no doubt: the control or a host has said so, a setup was measured by it, or nobody asked.
    #[default]
    None,
    /// `T1.`
    First,
    /// `T2.`: also in place of the reference that there is.
    Again,
    /// A host or the button, and neither the control nor a host has said that its run is the one that was meant.
    Unread,
}

impl Lessons {
    /// Nothing was taught.
    pub const NONE: Self = Self {
        smallest: Vec::new(),
        largest: Vec::new(),
        further: 0,
        tool_length_mm: None,
        feed_mm_per_min: 0.0,
        doubt: Doubt::None,
        run: 0,
        asked_in: 0,
    };

    /// The smallest and the largest of a feature, by its place in the job.
    #[must_use]
    pub fn of(&self, place: usize) -> Option<(&Learned, &Learned)> {
        let smallest = self.smallest.get(place)?;
        Some((smallest, self.largest.get(place).unwrap_or(smallest)))
    }

    /// One more setup has taught. It has the same features.
    pub fn widen(&mut self, by: &[Learned]) {
        if self.largest.is_empty() {
            self.largest = self.smallest.clone();
        }
        let ends = self.smallest.iter_mut().zip(&mut self.largest);
        for ((smallest, largest), now) in ends.zip(by) {
            *smallest = smallest.of_each(now, f64::min);
            *largest = largest.of_each(now, f64::max);
        }
        self.further = self.further.saturating_add(1);
    }
}
