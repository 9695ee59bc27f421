//! Why a feature is refused or a verdict is NG: every reason by name, with its
//! figures, so that a machinist can act on it and a machine can read it.

use core::fmt;

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::Name;

/// One reason. `hit` numbers count from 1, as a machinist counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Reason {
    // --- a feature's hits
    /// The hits ended before the feature was complete.
    MissingPoints {
        /// Hits that arrived.
        got: u16,
        /// Hits that the job asks for.
        expected: u16,
    },
    /// The control announced or sent another number of hits than the job asks for.
    WrongCount {
        /// Hits announced or sent.
        got: u16,
        /// Hits that the job asks for.
        expected: u16,
    },
    /// A line was damaged or not understood where a hit was due.
    DamagedLine {
        /// Hits that arrived intact.
        got: u16,
        /// Hits that the job asks for.
        expected: u16,
    },
    /// The same coordinates were printed for two hits.
    DuplicatePoint {
        /// The first hit with these coordinates.
        first: u16,
        /// The hit that repeats them.
        hit: u16,
    },
    /// All coordinates are zero: what a control prints for a missed measurement.
    NullPoint {
        /// The hit.
        hit: u16,
    },
    /// The number fills its field and may have lost its leading digits.
    OverflowSuspect {
        /// The hit.
        hit: u16,
    },
    /// A coordinate is outside the travel that the job states.
    OutsideTravel {
        /// The hit.
        hit: u16,
    },
    /// The macro says that the probe did not touch.
    NotTouched {
        /// The hit.
        hit: u16,
    },
    /// No direction of motion is known, so it cannot be compensated.
    NoApproach {
        /// The hit.
        hit: u16,
    },
    /// The line's approach differs from the job's.
    ApproachMismatch {
        /// The hit.
        hit: u16,
    },
    /// The same hit or feature was sent twice with different content.
    ConflictingRepeat,
    /// Sequence numbers are missing: lines were lost.
    SequenceGap,

    // --- a feature's fit
    /// The fit was refused.
    FitRefused {
        /// Why, by its stable code.
        code: FitRefusal,
    },
    /// The radius is not the nominal one.
    RadiusError {
        /// Fitted less nominal radius.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The residuals are too large.
    Rms {
        /// Rms of the residuals.
        rms_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// A hit's surface normal does not match its approach.
    ApproachAngle {
        /// The hit that is worst.
        hit: u16,
        /// Angle between normal and approach.
        angle_deg: f64,
        /// The job's limit.
        limit_deg: f64,
    },
    /// The only hit along this axis disagrees with the other hits: residuals
    /// cannot show it, it moves the centre.
    LoneHitOffset {
        /// The hit.
        hit: u16,
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// How far it is from where the other hits and the nominal radius put it,
        /// or how far those lie from the fitted centre's height.
        offset_mm: f64,
        /// The job's limit on that, or its approach limit at the radius.
        limit_mm: f64,
    },
    /// With the other sign this coordinate would fit: the sign was lost.
    SuspectSign {
        /// The hit.
        hit: u16,
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
    },
    /// One hit alone spoils the fit.
    SuspectHit {
        /// The hit.
        hit: u16,
        /// How far it lies from the feature that the others describe.
        off_mm: f64,
    },

    // --- a plate
    /// The feature did not arrive.
    MissingFeature {
        /// Its name.
        name: Name,
    },
    /// Two datum positions are not at their reference distance.
    DistanceError {
        /// One feature.
        a: Name,
        /// The other.
        b: Name,
        /// Measured less reference distance.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The distances would be right with these two features exchanged.
    SuspectExchange {
        /// One feature.
        a: Name,
        /// The other.
        b: Name,
    },
    /// There is no reference yet: no plate has been taught.
    NoReference,
    /// The registration was refused.
    RegistrationRefused {
        /// Why, by its stable code.
        code: FitRefusal,
    },
    /// The registration's residuals are too large.
    RegistrationRms {
        /// Rms over the datum positions.
        rms_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The part is turned too far about Z.
    Rotation {
        /// Angle about Z.
        angle_deg: f64,
        /// The job's limit.
        limit_deg: f64,
    },
    /// The part is tilted too far: a wrong height, or chips under the plate.
    Tilt {
        /// Angle between the Z axes.
        angle_deg: f64,
        /// The job's limit.
        limit_deg: f64,
    },
    /// The part stands too far from its reference place: a wrong datum or work offset.
    Shift {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Displacement of the datum centroid.
        shift_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The registration is too uncertain at the part.
    ExpectedError {
        /// One standard deviation at the worst corner.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// What the correction cannot express is too much.
    Leftover {
        /// Largest error left at the part's corners.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The corrected offset does not fit the control's number format.
    NotExpressible,
    /// Bytes were lost before the receiver while the plate was measured.
    BytesLost {
        /// How many.
        count: u32,
    },
    /// The control began another run of the program before the plate was complete.
    RunChanged,
    /// Every point is that of the plate before, to the last digit: printed again,
    /// not measured again.
    RepeatedPlate,
    /// No hit came for the job's plate time-out.
    TimedOut {
        /// The time-out.
        timeout_s: u32,
    },
    /// The input ended.
    InputEnded,

    // --- the two witnesses of a hit
    /// The probe's skip edge of this hit was not latched.
    NotLatched {
        /// The hit.
        hit: u16,
    },
    /// Hits at different feeds: the control's delay does not cancel.
    FeedChanged {
        /// The hit.
        hit: u16,
        /// Its feed.
        feed_mm_per_min: f64,
        /// The feed of the plate's first hit.
        expected_mm_per_min: f64,
    },
    /// The control stored a position later after the skip signal than it may, or
    /// before it.
    ControlDelay {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// The delay that the positions say.
        delay_ms: f64,
        /// The job's limit.
        limit_ms: f64,
    },
    /// All of the control's positions are shifted against the encoders: the work
    /// offset or the machine's datum has changed, or counts were lost between plates.
    WitnessShift {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Control less encoder.
        shift_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// Control and encoder differ in proportion to the position: a wrong scale.
    WitnessScale {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Control over encoder less one, in millionths.
        ppm: f64,
    },
    /// Control and encoder part company between two hits: counts were lost.
    LostCounts {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// How many counts the encoder's counter is behind, with sign.
        counts: f64,
    },
    /// Control and encoder differ without a pattern.
    WitnessDisagrees {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// The range of the differences.
        off_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },

    // --- remarks: they do not change the verdict
    /// Both witnesses agree; this is the control's delay between the skip signal and
    /// the position that it stores.
    Witnessed {
        /// Hits along an axis.
        hits: u16,
        /// Shortest.
        least_ms: f64,
        /// Mean.
        mean_ms: f64,
        /// Longest.
        most_ms: f64,
        /// What the job's tolerance is worth at this feed: smaller delays are not told apart.
        resolution_ms: f64,
    },
    /// This plate says where the encoders' origin is: what shifted before it, no one
    /// has seen.
    WitnessLearned,
    /// A block arrived whose name is not in the job.
    UnknownFeature {
        /// The name.
        name: Name,
    },
    /// This plate became the reference.
    Taught,
    /// A refused feature was sent again and replaced.
    Replaced {
        /// Its name.
        name: Name,
    },
    /// Identical repeats of this feature were dropped.
    RepeatDropped {
        /// Its name.
        name: Name,
    },
}

/// Why a fit or a registration was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum FitRefusal {
    /// Fewer points than parameters need.
    TooFewPoints,
    /// NaN or infinity.
    NotFinite,
    /// Coplanar, collinear or coinciding points.
    Degenerate,
    /// Worse conditioned than the stated limit.
    IllConditioned,
    /// The points cover too little of the surface.
    CapTooSmall,
    /// The iteration did not reach a proven minimum.
    NoConvergence,
    /// Two lists of different length.
    LengthMismatch,
}

impl FitRefusal {
    /// The stable code.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::TooFewPoints => "too_few_points",
            Self::NotFinite => "not_finite",
            Self::Degenerate => "degenerate",
            Self::IllConditioned => "ill_conditioned",
            Self::CapTooSmall => "cap_too_small",
            Self::NoConvergence => "no_convergence",
            Self::LengthMismatch => "length_mismatch",
        }
    }
}

impl fmt::Display for FitRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooFewPoints => "too few points: probe more",
            Self::NotFinite => "a coordinate is not a number, or beyond any machine",
            Self::Degenerate => {
                "the points coincide or lie on one line or in one plane: probe places that lie apart"
            }
            Self::IllConditioned => {
                "the points say too little about the shape: spread them wider, or check what was probed"
            }
            Self::CapTooSmall => {
                "the points cover too little of the surface to say a radius: probe a larger part"
            }
            Self::NoConvergence => {
                "the points do not look like this shape: check the feature and its hits"
            }
            Self::LengthMismatch => "the two lists of points differ in length",
        })
    }
}

impl Reason {
    /// The stable code of the reason.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::MissingPoints { .. } => "missing_points",
            Self::WrongCount { .. } => "wrong_count",
            Self::DamagedLine { .. } => "damaged_line",
            Self::DuplicatePoint { .. } => "duplicate_point",
            Self::NullPoint { .. } => "null_point",
            Self::OverflowSuspect { .. } => "overflow_suspect",
            Self::OutsideTravel { .. } => "outside_travel",
            Self::NotTouched { .. } => "not_touched",
            Self::NoApproach { .. } => "no_approach",
            Self::ApproachMismatch { .. } => "approach_mismatch",
            Self::ConflictingRepeat => "conflicting_repeat",
            Self::SequenceGap => "sequence_gap",
            Self::FitRefused { code } | Self::RegistrationRefused { code } => code.code(),
            Self::RadiusError { .. } => "radius_error",
            Self::Rms { .. } => "rms",
            Self::ApproachAngle { .. } => "approach_angle",
            Self::LoneHitOffset { .. } => "lone_hit_offset",
            Self::SuspectSign { .. } => "suspect_sign",
            Self::SuspectHit { .. } => "suspect_hit",
            Self::MissingFeature { .. } => "missing_feature",
            Self::DistanceError { .. } => "distance_error",
            Self::SuspectExchange { .. } => "suspect_exchange",
            Self::NoReference => "no_reference",
            Self::RegistrationRms { .. } => "registration_rms",
            Self::Rotation { .. } => "rotation",
            Self::Tilt { .. } => "tilt",
            Self::Shift { .. } => "shift",
            Self::ExpectedError { .. } => "expected_error",
            Self::Leftover { .. } => "leftover",
            Self::NotExpressible => "not_expressible",
            Self::BytesLost { .. } => "bytes_lost",
            Self::RunChanged => "run_changed",
            Self::RepeatedPlate => "repeated_plate",
            Self::TimedOut { .. } => "timed_out",
            Self::InputEnded => "input_ended",
            Self::NotLatched { .. } => "not_latched",
            Self::FeedChanged { .. } => "feed_changed",
            Self::ControlDelay { .. } => "control_delay",
            Self::WitnessShift { .. } => "witness_shift",
            Self::WitnessScale { .. } => "witness_scale",
            Self::LostCounts { .. } => "lost_counts",
            Self::WitnessDisagrees { .. } => "witness_disagrees",
            Self::Witnessed { .. } => "witnessed",
            Self::WitnessLearned => "witness_learned",
            Self::UnknownFeature { .. } => "unknown_feature",
            Self::Taught => "taught",
            Self::Replaced { .. } => "replaced",
            Self::RepeatDropped { .. } => "repeat_dropped",
        }
    }
}

const fn axis_name(axis: u8) -> char {
    match axis {
        0 => 'X',
        1 => 'Y',
        _ => 'Z',
    }
}

impl fmt::Display for Reason {
    #[allow(clippy::too_many_lines, reason = "one arm per reason: a table")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MissingPoints { got, expected } => write!(
                f,
                "{got} of {expected} hits arrived; probe the feature again"
            ),
            Self::WrongCount { got, expected } => write!(
                f,
                "the control sent {got} hits, the job asks for {expected}; make macro and job agree"
            ),
            Self::DamagedLine { got, expected } => write!(
                f,
                "a line was damaged or not understood ({got} of {expected} hits are intact); probe the feature again and check the cable"
            ),
            Self::DuplicatePoint { first, hit } => write!(
                f,
                "hit {hit} repeats the coordinates of hit {first}; a measurement is missing"
            ),
            Self::NullPoint { hit } => write!(
                f,
                "hit {hit} is all zeros: what a control prints for a missed measurement"
            ),
            Self::OverflowSuspect { hit } => write!(
                f,
                "hit {hit} fills its number field and may have lost leading digits; widen the DPRNT format or state the machine's travel"
            ),
            Self::OutsideTravel { hit } => write!(
                f,
                "hit {hit} is outside the travel that the job states; check the number and the work offset"
            ),
            Self::NotTouched { hit } => write!(f, "hit {hit}: the probe did not touch"),
            Self::NoApproach { hit } => write!(
                f,
                "hit {hit} has no approach direction; give `approach` in the job or print checked lines"
            ),
            Self::ApproachMismatch { hit } => write!(
                f,
                "hit {hit} was approached in another direction than the job says"
            ),
            Self::ConflictingRepeat => f.write_str(
                "sent twice with different coordinates; which one is right is not known: probe again",
            ),
            Self::SequenceGap => f.write_str("lines are missing in the sequence; probe again"),
            Self::FitRefused { code } => write!(f, "not fitted: {code}"),
            Self::RadiusError { error_mm, limit_mm } => write!(
                f,
                "radius is {error_mm:+.4} mm off nominal, limit {limit_mm:.4} mm; check compensation, ball and hits"
            ),
            Self::Rms { rms_mm, limit_mm } => {
                write!(f, "residuals {rms_mm:.4} mm rms, limit {limit_mm:.4} mm")
            }
            Self::ApproachAngle {
                hit,
                angle_deg,
                limit_deg,
            } => write!(
                f,
                "hit {hit} touched {angle_deg:.2} deg off its approach, limit {limit_deg:.2} deg; hits are exchanged or one is wrong"
            ),
            Self::LoneHitOffset {
                hit,
                axis,
                offset_mm,
                limit_mm,
            } => write!(
                f,
                "hit {hit}, the only one along {}, disagrees with the others by {offset_mm:+.4} mm, limit {limit_mm:.4} mm",
                axis_name(*axis)
            ),
            Self::SuspectSign { hit, axis } => write!(
                f,
                "hit {hit} would fit with the other sign of {}: a sign was lost",
                axis_name(*axis)
            ),
            Self::SuspectHit { hit, off_mm } => write!(
                f,
                "hit {hit} alone is off, by {off_mm:.4} mm from what the others describe"
            ),
            Self::MissingFeature { name } => write!(f, "{name} did not arrive"),
            Self::DistanceError {
                a,
                b,
                error_mm,
                limit_mm,
            } => write!(
                f,
                "{a} to {b} is {error_mm:+.4} mm off its reference distance, limit {limit_mm:.4} mm"
            ),
            Self::SuspectExchange { a, b } => {
                write!(f, "distances and pose would be right with {a} and {b} exchanged")
            }
            Self::NoReference => {
                f.write_str("no reference plate has been taught; probe the nominal clamping first")
            }
            Self::RegistrationRefused { code } => {
                write!(f, "not registered: {code}")
            }
            Self::RegistrationRms { rms_mm, limit_mm } => write!(
                f,
                "registration residuals {rms_mm:.4} mm rms, limit {limit_mm:.4} mm"
            ),
            Self::Rotation {
                angle_deg,
                limit_deg,
            } => write!(
                f,
                "turned {angle_deg:+.4} deg about Z, limit {limit_deg:.4} deg"
            ),
            Self::Tilt {
                angle_deg,
                limit_deg,
            } => write!(
                f,
                "tilted {angle_deg:.4} deg, limit {limit_deg:.4} deg; look for chips under the part or a wrong Z hit"
            ),
            Self::Shift {
                axis,
                shift_mm,
                limit_mm,
            } => write!(
                f,
                "displaced {shift_mm:+.4} mm in {}, limit {limit_mm:.4} mm; check datum and work offset",
                axis_name(*axis)
            ),
            Self::ExpectedError { error_mm, limit_mm } => write!(
                f,
                "expected error at the part {error_mm:.4} mm, limit {limit_mm:.4} mm"
            ),
            Self::Leftover { error_mm, limit_mm } => write!(
                f,
                "the correction would leave {error_mm:.4} mm at the part's corners, limit {limit_mm:.4} mm; shim the part or use a control with a 3-D correction"
            ),
            Self::NotExpressible => {
                f.write_str("the corrected offset does not fit the control's number format")
            }
            Self::BytesLost { count } => write!(
                f,
                "{count} bytes from the control were lost; probe the part again"
            ),
            Self::RunChanged => f.write_str(
                "another run of the program began before the plate was complete; probe it in one run",
            ),
            Self::RepeatedPlate => f.write_str(
                "every point is that of the plate before, to the last digit: printed again, not measured again; probe the part",
            ),
            Self::TimedOut { timeout_s } => {
                write!(f, "no hit for {timeout_s} s; the plate was given up")
            }
            Self::InputEnded => f.write_str("the input ended before the plate was complete"),
            Self::UnknownFeature { name } => write!(
                f,
                "{name} is not in the job; its hits were not used"
            ),
            Self::NotLatched { hit } => write!(
                f,
                "hit {hit} has no second witness: its skip edge was not latched, or its line says no feed; check the skip wire to the board and what the macro prints"
            ),
            Self::FeedChanged {
                hit,
                feed_mm_per_min,
                expected_mm_per_min,
            } => write!(
                f,
                "hit {hit} was probed at {feed_mm_per_min} mm/min, others at {expected_mm_per_min}; gauge at one feed"
            ),
            Self::ControlDelay {
                axis,
                delay_ms,
                limit_ms,
            } => write!(
                f,
                "{}: the control stored a position {delay_ms:.2} ms after the skip edge, limit {limit_ms} ms; check its skip input and the feed",
                axis_name(*axis)
            ),
            Self::WitnessShift {
                axis,
                shift_mm,
                limit_mm,
            } => write!(
                f,
                "{}: the control's positions stand {shift_mm:+.4} mm off the encoder, limit {limit_mm:.4} mm; a work offset or the datum has changed, or counts were lost between plates: check both, then set the job again",
                axis_name(*axis)
            ),
            Self::WitnessScale { axis, ppm } if *ppm < -1e6 => write!(
                f,
                "{}: the encoder counts the other way; change the sign of `counts_per_mm`, or its wires",
                axis_name(*axis)
            ),
            Self::WitnessScale { axis, ppm } => write!(
                f,
                "{}: control and encoder differ by {ppm:+.0} ppm; check `counts_per_mm`, inch or mm, the control's scaling",
                axis_name(*axis)
            ),
            Self::LostCounts { axis, counts } => write!(
                f,
                "{}: the encoder's counter jumped by {counts:+.0} counts between two hits; check its cable and shield",
                axis_name(*axis)
            ),
            Self::WitnessDisagrees {
                axis,
                off_mm,
                limit_mm,
            } => write!(
                f,
                "{}: control and encoder differ by up to {off_mm:.4} mm without a pattern, limit {limit_mm:.4} mm; check encoder wiring and what the macro prints",
                axis_name(*axis)
            ),
            Self::Witnessed {
                hits,
                least_ms,
                mean_ms,
                most_ms,
                resolution_ms,
            } => write!(
                f,
                "control and encoders agree; over {hits} hits the control stored positions {least_ms:.2} to {most_ms:.2} ms after the skip edge, mean {mean_ms:.2} (the tolerance is worth {resolution_ms:.1} ms)"
            ),
            Self::WitnessLearned => f.write_str(
                "the encoders' origin was taken from this plate; a shift before it is not seen",
            ),
            Self::Taught => f.write_str("this plate is now the reference"),
            Self::Replaced { name } => write!(f, "{name} was refused, sent again and replaced"),
            Self::RepeatDropped { name } => write!(f, "{name} was sent again unchanged; dropped"),
        }
    }
}
