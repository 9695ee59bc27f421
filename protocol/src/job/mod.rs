//! The job: which features a part program probes, what they should be, the
//! limits that decide the verdict, and the correction that is wanted.
//!
//! A job is data. It is written as TOML, checked by `umi job check`, sent over
//! the link and kept in the journal; [`pattern::ReceiverConfig`] says
//! how the control's lines look.

pub mod before;
mod correction;
mod feature;
mod guards;
pub mod job_error;
pub mod pattern;
pub mod serial;
mod teaching;
mod touch;

use heapless::{String, Vec};
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

pub use correction::{CorrectionSpec, Dialect, ProgramEnd, SendWhen, WorkOffset};
pub use feature::{Approach, Compensation, FeatureKind, FeatureSpec};
pub use guards::{
    AgainSpec, Closing, Guards, LearnedLimits, MAX_CLOSING, MAX_FIXED, ProbingSpec, WarmthSpec,
};
use pattern::ReceiverConfig;
use serial::LineSpec;
pub use teaching::{Doubt, Learned, Lessons, Reference, Teach};
pub use touch::{SkipSpec, WitnessSpec};

/// Features in a job, at most.
pub const MAX_FEATURES: usize = 12;
/// Features whose position takes part in the registration, at most.
pub const MAX_DATUMS: usize = 8;
/// Hits on one feature, at most.
pub const MAX_HITS: usize = 64;
/// Characters in a feature's or job's name, at most.
pub const MAX_NAME: usize = 16;

/// The name of a job or of a feature, as the control prints it.
pub type Name = String<MAX_NAME, u8>;

/// A name from a text, cut where it is too long.
#[must_use]
pub fn name(text: &str) -> Name {
    let mut name = Name::new();
    for c in text.chars() {
        if name.push(c).is_err() {
            break;
        }
    }
    name
}

/// What is probed, how it is judged and what is sent back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// Stands in every verdict and in the correction program's comments.
    pub name: Name,
    /// Where the nominal positions come from.
    pub reference: Reference,
    /// An unfinished setup is given up (NG) after this long without a hit, seconds.
    pub plate_timeout_s: u32,
    /// How the control's bytes become hits.
    pub receiver: ReceiverConfig,
    /// The features in the order in which the program probes them.
    pub features: Vec<FeatureSpec, MAX_FEATURES, u8>,
    /// Tip radius and pretravel: done by the macro, or here.
    pub compensation: Compensation,
    /// What an OK verdict must keep.
    pub limits: Limits,
    /// The correction wanted; without it the job only measures.
    pub correction: Option<CorrectionSpec>,
    /// The board's own encoder counts as second witness of every hit; without it
    /// the control's word is taken.
    #[serde(default)]
    pub witness: Option<WitnessSpec>,
    /// What makes a setup the reference.
    #[serde(default)]
    pub teach: Teach,
    /// What guards against errors that one setup alone cannot show.
    #[serde(default)]
    pub guards: Guards,
    /// The serial line to the control.
    #[serde(default)]
    pub line: LineSpec,
    /// Which edge of the probe's skip line is the touch.
    #[serde(default)]
    pub skip: SkipSpec,
    /// A ball's first touch is held against its last one, where the two are at one place.
    #[serde(default)]
    pub again: Option<AgainSpec>,
}

// What a job has beyond its first version stands behind all else and is zero where it is
// absent, so that a record of an earlier firmware, which ends before it, is read as a job
// without it.

/// What an OK verdict must keep. All limits apply to absolute values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Fitted against nominal radius, where the job gives one.
    pub radius_error_mm: f64,
    /// Rms of a feature's residuals.
    pub rms_mm: f64,
    /// Largest angle between a hit's surface normal and its approach. Shows
    /// what residuals cannot: a wrong single Z hit of a five-point block moves
    /// the centre and leaves no residual. Not checked where absent.
    #[serde(default)]
    pub approach_deg: Option<f64>,
    /// Where a sphere has only one hit along an axis: its height above the others
    /// against the nominal radius, by which the routine drives below the top. It
    /// holds whatever the pretravel. Not checked where absent.
    #[serde(default)]
    pub lone_hit_mm: Option<f64>,
    /// Distance between two datum positions against the reference.
    pub distance_error_mm: f64,
    /// Rms of the registration's residuals.
    pub registration_rms_mm: f64,
    /// Rotation about Z.
    pub rotation_deg: f64,
    /// Tilt of the Z axis.
    pub tilt_deg: f64,
    /// Displacement of the datum features' centroid, per axis.
    pub shift_mm: [f64; 3],
    /// Expected error (one standard deviation, from the registration's
    /// covariance) at the worst corner of the part. Not checked where absent.
    #[serde(default)]
    pub expected_error_mm: Option<f64>,
}
