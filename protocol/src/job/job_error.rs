//! Job errors: the reasons why a job cannot be used.

use core::fmt;

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

use crate::job::Name;

/// What a value cannot be, where it is one that was given: NaN stands for what is no number.
struct CannotBe<'a>(&'a f64);

impl fmt::Display for CannotBe<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_nan() {
            return f.write_str("cannot be used as it is");
        }
        write!(f, "cannot be {}", self.0)
    }
}

/// A fault in a job: which field, and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
pub enum JobError {
    /// The job has no name, or one with characters that a control cannot show.
    #[error(
        "`name` must be 1 to 16 characters A-Z, a-z, 0-9, blank, - or _ (it stands in the correction's comments)"
    )]
    BadName,
    /// The job has no features.
    #[error("the job has no `features`; add at least one")]
    NoFeatures,
    /// Two features have the same name or id.
    #[error("feature {name}: its name or id is used twice; make them unique")]
    DuplicateFeature {
        /// The name.
        name: Name,
    },
    /// A feature's name is empty or has characters that a control cannot print.
    #[error("feature number {feature}: `name` must be 1 to 16 characters A-Z, a-z, 0-9, - or _")]
    BadFeatureName {
        /// Its place in the job, from 1.
        feature: u8,
    },
    /// Too few hits for the geometry, or more than a feature can hold.
    #[error(
        "feature {name}: `hits` is {hits}; this feature needs {least} to {most} (one to spare where a correction rests on it)"
    )]
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
    #[error(
        "feature {name}: `approach` has {got} directions for {hits} hits; give one for each, or none"
    )]
    ApproachCount {
        /// The feature.
        name: Name,
        /// Directions given.
        got: u16,
        /// Hits.
        hits: u16,
    },
    /// A value is missing that the rest of the job needs.
    #[error("`{}`{} is missing and the rest of the job needs it", .field.name(), OfFeature(.feature))]
    Missing {
        /// The field, as in the file.
        field: Field,
        /// The feature that needs it, if any.
        feature: Option<Name>,
    },
    /// A number is NaN, infinite, or outside what makes sense.
    #[error("`{}`{} {}", .field.name(), OfFeature(.feature), CannotBe(.value))]
    BadValue {
        /// The field, as in the file.
        field: Field,
        /// The feature, if any.
        feature: Option<Name>,
        /// The value.
        value: f64,
    },
    /// A correction needs three or more datum features.
    #[error(
        "a correction needs three or more datum features (sphere, circle or cone); the job has {got}"
    )]
    TooFewDatums {
        /// How many there are.
        got: u8,
    },
    /// More datum features than a registration holds.
    #[error(
        "{got} datum features are more than the {most} that a registration holds; set `datum = false` on some"
    )]
    TooManyDatums {
        /// How many there are.
        got: u8,
        /// The most.
        most: u8,
    },
    /// The given positions do not fix a rotation: they lie on one line or coincide.
    #[error("the features' `position_mm` lie on one line or coincide; they do not fix a rotation")]
    DegenerateReference,
    /// A correction would write the offset in which the next setup is probed.
    #[error(
        "`correction.write_to` is `correction.probed_in`: the next setup would be probed in a changed offset; write another one"
    )]
    SameOffset,
    /// A correction needs lines that name their feature.
    #[error(
        "a correction needs lines that name their feature (block, checked, or a template with {{name}}): with others a lost line moves every later hit"
    )]
    UnnamedFeatures,
    /// A second witness needs a line right behind each touch.
    #[error(
        "`witness` needs a line right behind each touch (checked, point, words, template or probe lines): a block is printed when its touches are over"
    )]
    WitnessPairing,
    /// A second witness needs skip positions, not positions that the macro has changed.
    #[error(
        "`witness` needs skip positions as the control stored them: print these, and set `compensation` to `on_board`"
    )]
    WitnessCompensation,
    /// No line pattern is given: nothing could ever be measured.
    #[error("`receiver.patterns` is empty; name at least one line pattern")]
    NoPatterns,
    /// The job asks for something that this board does not have.
    #[error("`{}` asks for what this board does not have: see its README", .field.name())]
    NotOnThisBoard {
        /// The field, as in the file.
        field: Field,
    },
    /// Seven data bits come with a parity bit.
    #[error(
        "`line.data_bits` is 7 and `receiver.coding` is `ascii`: seven bits come with a parity bit; set `coding` to `auto`, or the control to 8 bits"
    )]
    ParityMissing,
    /// A limit is wider than the board's owner allows.
    #[error(
        "`{}`{}: the board's owner allows {ceiling} at most; set a narrower limit, or ask the owner (umi config get)", .field.name(), GivenLimit(.given)
    )]
    BeyondCeiling {
        /// The limit.
        field: Field,
        /// The widest that is allowed.
        ceiling: f64,
        /// The job's; none: it has no such limit.
        given: Option<f64>,
    },
    /// The board's owner demands a second witness.
    #[strum(serialize = "beyond_ceiling")]
    #[error(
        "the job has no [witness], and the board's owner demands one (umi config get: ceilings.require_witness)"
    )]
    WitnessDemanded,
    /// The board's record would fill with changes.
    #[error(
        "what is in force was changed more often than the board's record can hold; wait two seconds, then set it again"
    )]
    TooOften,
    /// A correction has characters that the control's tape code does not have.
    #[error(
        "`receiver.coding` is `eia`, which has no #, = or brackets, and the correction needs some (its dialect, or `guards.run_variable`): set the control to ISO or ASCII, or take `haas-e`, or `g10-g68` without `run_variable`"
    )]
    CodingLacks,
}

/// A field of a job, by its name in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[allow(missing_docs, reason = "each is the field of the same name")]
pub enum Field {
    PlateTimeoutS,
    PositionMm,
    RadiusMm,
    Approach,
    TipRadiusMm,
    PretravelMm,
    #[strum(serialize = "limits.radius_error_mm")]
    RadiusErrorMm,
    #[strum(serialize = "limits.rms_mm")]
    RmsMm,
    #[strum(serialize = "limits.approach_deg")]
    ApproachDeg,
    #[strum(serialize = "limits.lone_hit_mm")]
    LoneHitMm,
    #[strum(serialize = "limits.distance_error_mm")]
    DistanceErrorMm,
    #[strum(serialize = "limits.registration_rms_mm")]
    RegistrationRmsMm,
    #[strum(serialize = "limits.rotation_deg")]
    RotationDeg,
    #[strum(serialize = "limits.tilt_deg")]
    TiltDeg,
    #[strum(serialize = "limits.shift_mm")]
    ShiftMm,
    #[strum(serialize = "limits.expected_error_mm")]
    ExpectedErrorMm,
    #[strum(serialize = "correction.probed_origin_mm")]
    ProbedOriginMm,
    #[strum(serialize = "correction.program_number")]
    ProgramNumber,
    #[strum(serialize = "correction.part_min_mm")]
    PartMinMm,
    #[strum(serialize = "correction.part_max_mm")]
    PartMaxMm,
    #[serde(rename = "LeftoverMm")]
    #[strum(serialize = "correction.leftover_mm")]
    UncorrectedMm,
    Receiver,
    #[strum(serialize = "guards.closing")]
    Closing,
    #[strum(serialize = "guards.fixed")]
    Fixed,
    #[strum(serialize = "guards.fixed_mm")]
    FixedMm,
    #[strum(serialize = "guards.nominal_distance_mm")]
    NominalDistanceMm,
    #[strum(serialize = "guards.learned")]
    Learned,
    #[strum(serialize = "guards.probing")]
    Probing,
    #[strum(serialize = "guards.warmth")]
    Warmth,
    #[strum(serialize = "guards.run_variable")]
    RunVariable,
    #[strum(serialize = "guards.frame")]
    Frame,
    #[strum(serialize = "witness.counts_per_mm")]
    CountsPerMm,
    #[strum(serialize = "witness.origin_counts")]
    OriginCounts,
    #[strum(serialize = "witness.feed_mm_per_min")]
    FeedMmPerMin,
    #[strum(serialize = "witness.delay_ms")]
    DelayMs,
    #[strum(serialize = "witness.tolerance_mm")]
    ToleranceMm,
    #[strum(serialize = "correction.write_to")]
    WriteTo,
    #[strum(serialize = "correction.set")]
    Set,
    #[strum(serialize = "line.baud")]
    LineBaud,
    #[strum(serialize = "line.data_bits")]
    LineDataBits,
    #[strum(serialize = "line.stop_bits")]
    LineStopBits,
    #[strum(serialize = "line.rts_cts")]
    LineRtsCts,
    #[strum(serialize = "skip.active")]
    SkipActive,
    #[strum(serialize = "skip.min_width_us")]
    SkipMinWidthUs,
    #[strum(serialize = "skip.hold_off_ms")]
    SkipHoldOffMs,
    #[strum(serialize = "skip.delay_us")]
    SkipDelayUs,
    #[strum(serialize = "skip.each_hit")]
    SkipEachHit,
    #[strum(serialize = "again.within_mm")]
    Again,
}

impl Field {
    /// The name in the file.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl JobError {
    /// The stable code.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.into()
    }
}

/// What a job gives for a limit, behind its name.
struct GivenLimit<'a>(&'a Option<f64>);

impl fmt::Display for GivenLimit<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(given) => write!(f, " is {given}"),
            None => f.write_str(" is not in the job"),
        }
    }
}

/// Whose a field is, behind its name.
struct OfFeature<'a>(&'a Option<Name>);

impl fmt::Display for OfFeature<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(name) => write!(f, " of feature {name}"),
            None => Ok(()),
        }
    }
}
