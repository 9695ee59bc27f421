//! Why a job cannot be used.

use core::fmt;

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::Name;

/// A fault in a job: which field, and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum JobError {
    /// The job has no name, or one with characters that a control cannot show.
    BadName,
    /// The job has no features.
    NoFeatures,
    /// Two features have the same name or id.
    DuplicateFeature {
        /// The name.
        name: Name,
    },
    /// A feature's name is empty or has characters that a control cannot print.
    BadFeatureName {
        /// Its place in the job, from 1.
        feature: u8,
    },
    /// Too few hits for the geometry, or more than a feature can hold.
    HitCount {
        /// The feature.
        name: Name,
        /// What the job says.
        hits: u16,
        /// The least that the geometry needs.
        least: u16,
        /// The most that a feature can hold.
        most: u16,
    },
    /// `approach` has another length than `hits`.
    ApproachCount {
        /// The feature.
        name: Name,
        /// Directions given.
        got: u16,
        /// Hits.
        hits: u16,
    },
    /// A value is missing that the rest of the job needs.
    Missing {
        /// The field, as in the file.
        field: Field,
        /// The feature that needs it, if any.
        feature: Option<Name>,
    },
    /// A number is NaN, infinite, or outside what makes sense.
    BadValue {
        /// The field, as in the file.
        field: Field,
        /// The feature, if any.
        feature: Option<Name>,
        /// The value.
        value: f64,
    },
    /// A correction needs three or more datum features.
    TooFewDatums {
        /// How many there are.
        got: u8,
    },
    /// More datum features than a registration holds.
    TooManyDatums {
        /// How many there are.
        got: u8,
        /// The most.
        most: u8,
    },
    /// The given positions do not fix a rotation: they lie on one line or coincide.
    DegenerateReference,
    /// A correction would write the offset in which the next plate is probed.
    SameOffset,
    /// A correction needs lines that name their feature.
    UnnamedFeatures,
    /// A second witness needs a line right behind each touch.
    WitnessPairing,
    /// A second witness needs skip positions, not positions that the macro has changed.
    WitnessCompensation,
    /// No line pattern is given: nothing could ever be measured.
    NoPatterns,
}

/// A field of a job, by its name in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[allow(missing_docs, reason = "each is the field of the same name")]
pub enum Field {
    PlateTimeoutS,
    PositionMm,
    RadiusMm,
    Approach,
    TipRadiusMm,
    PretravelMm,
    RadiusErrorMm,
    RmsMm,
    ApproachDeg,
    LoneHitMm,
    DistanceErrorMm,
    RegistrationRmsMm,
    RotationDeg,
    TiltDeg,
    ShiftMm,
    ExpectedErrorMm,
    ProbedOriginMm,
    ProgramNumber,
    PartMinMm,
    PartMaxMm,
    LeftoverMm,
    Receiver,
    CountsPerMm,
    OriginCounts,
    FeedMmPerMin,
    DelayMs,
    ToleranceMm,
    WriteTo,
    Set,
}

impl Field {
    /// The name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PlateTimeoutS => "plate_timeout_s",
            Self::PositionMm => "position_mm",
            Self::RadiusMm => "radius_mm",
            Self::Approach => "approach",
            Self::TipRadiusMm => "tip_radius_mm",
            Self::PretravelMm => "pretravel_mm",
            Self::RadiusErrorMm => "limits.radius_error_mm",
            Self::RmsMm => "limits.rms_mm",
            Self::ApproachDeg => "limits.approach_deg",
            Self::LoneHitMm => "limits.lone_hit_mm",
            Self::DistanceErrorMm => "limits.distance_error_mm",
            Self::RegistrationRmsMm => "limits.registration_rms_mm",
            Self::RotationDeg => "limits.rotation_deg",
            Self::TiltDeg => "limits.tilt_deg",
            Self::ShiftMm => "limits.shift_mm",
            Self::ExpectedErrorMm => "limits.expected_error_mm",
            Self::ProbedOriginMm => "correction.probed_origin_mm",
            Self::ProgramNumber => "correction.program_number",
            Self::PartMinMm => "correction.part_min_mm",
            Self::PartMaxMm => "correction.part_max_mm",
            Self::LeftoverMm => "correction.leftover_mm",
            Self::Receiver => "receiver",
            Self::CountsPerMm => "witness.counts_per_mm",
            Self::OriginCounts => "witness.origin_counts",
            Self::FeedMmPerMin => "witness.feed_mm_per_min",
            Self::DelayMs => "witness.delay_ms",
            Self::ToleranceMm => "witness.tolerance_mm",
            Self::WriteTo => "correction.write_to",
            Self::Set => "correction.set",
        }
    }
}

impl JobError {
    /// The stable code.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::BadName => "bad_name",
            Self::NoFeatures => "no_features",
            Self::DuplicateFeature { .. } => "duplicate_feature",
            Self::BadFeatureName { .. } => "bad_feature_name",
            Self::HitCount { .. } => "hit_count",
            Self::ApproachCount { .. } => "approach_count",
            Self::Missing { .. } => "missing",
            Self::BadValue { .. } => "bad_value",
            Self::TooFewDatums { .. } => "too_few_datums",
            Self::TooManyDatums { .. } => "too_many_datums",
            Self::DegenerateReference => "degenerate_reference",
            Self::SameOffset => "same_offset",
            Self::UnnamedFeatures => "unnamed_features",
            Self::WitnessPairing => "witness_pairing",
            Self::WitnessCompensation => "witness_compensation",
            Self::NoPatterns => "no_patterns",
        }
    }
}

impl fmt::Display for JobError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = |f: &mut fmt::Formatter<'_>, feature: &Option<Name>| match feature {
            Some(name) => write!(f, " of feature {name}"),
            None => Ok(()),
        };
        match self {
            Self::BadName => f.write_str(
                "`name` must be 1 to 16 characters A-Z, a-z, 0-9, blank, - or _ (it stands in the correction's comments)",
            ),
            Self::NoFeatures => f.write_str("the job has no `features`; add at least one"),
            Self::DuplicateFeature { name } => {
                write!(f, "feature {name}: its name or id is used twice; make them unique")
            }
            Self::BadFeatureName { feature } => write!(
                f,
                "feature number {feature}: `name` must be 1 to 16 characters A-Z, a-z, 0-9, - or _"
            ),
            Self::HitCount { name, hits, least, most } => write!(
                f,
                "feature {name}: `hits` is {hits}; this feature needs {least} to {most} (one to spare where a correction rests on it)"
            ),
            Self::ApproachCount { name, got, hits } => write!(
                f,
                "feature {name}: `approach` has {got} directions for {hits} hits; give one for each, or none"
            ),
            Self::Missing { field, feature } => {
                write!(f, "`{}`", field.name())?;
                of(f, feature)?;
                f.write_str(" is missing and the rest of the job needs it")
            }
            Self::BadValue { field, feature, value } => {
                write!(f, "`{}`", field.name())?;
                of(f, feature)?;
                write!(f, " cannot be {value}")
            }
            Self::TooFewDatums { got } => write!(
                f,
                "a correction needs three or more datum features (sphere, circle or cone); the job has {got}"
            ),
            Self::TooManyDatums { got, most } => write!(
                f,
                "{got} datum features are more than the {most} that a registration holds; set `datum = false` on some"
            ),
            Self::DegenerateReference => f.write_str(
                "the features' `position_mm` lie on one line or coincide; they do not fix a rotation",
            ),
            Self::SameOffset => f.write_str(
                "`correction.write_to` is `correction.probed_in`: the next plate would be probed in a changed offset; write another one",
            ),
            Self::UnnamedFeatures => f.write_str(
                "a correction needs lines that name their feature (block, checked, or a template with {name}): with others a lost line moves every later hit",
            ),
            Self::WitnessPairing => f.write_str(
                "`witness` needs a line right behind each touch (checked, point, words, template or probe lines): a block is printed when its touches are over",
            ),
            Self::WitnessCompensation => f.write_str(
                "`witness` needs skip positions as the control stored them: print these, and set `compensation` to `on_board`",
            ),
            Self::NoPatterns => f.write_str(
                "`receiver.patterns` is empty; name at least one line pattern",
            ),
        }
    }
}
