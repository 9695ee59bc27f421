//! Reasons against a feature or a verdict: each by name, with its figures, so that a
//! machinist can act on it and a machine can read it.

use core::fmt;

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

use crate::job::Name;
use crate::latch::SignalLevel;

/// One reason. `hit` numbers count from 1, as a machinist counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
pub enum Reason {
    // --- a feature's hits
    /// The hits ended before the feature was complete.
    #[error("{got} of {expected} hits arrived; probe the feature again")]
    MissingPoints {
        /// Hits that arrived.
        got: u16,
        /// Hits that the job asks for.
        expected: u16,
    },
    /// The control announced or sent another number of hits than the job asks for.
    #[error("the control sent {got} hits, the job asks for {expected}; make macro and job agree")]
    WrongCount {
        /// Hits announced or sent.
        got: u16,
        /// Hits that the job asks for.
        expected: u16,
    },
    /// A line was damaged or not understood where a hit was due.
    #[error(
        "a line was damaged or not understood ({got} of {expected} hits are intact); probe the feature again and check the cable"
    )]
    DamagedLine {
        /// Hits that arrived intact.
        got: u16,
        /// Hits that the job asks for.
        expected: u16,
    },
    /// The same coordinates were printed for two hits.
    #[error("hit {hit} repeats the coordinates of hit {first}; a measurement is missing")]
    DuplicatePoint {
        /// The first hit with these coordinates.
        first: u16,
        /// The hit that repeats them.
        hit: u16,
    },
    /// All coordinates are zero: what a control prints for a missed measurement.
    #[error("hit {hit} is all zeros: what a control prints for a missed measurement")]
    NullPoint {
        /// The hit.
        hit: u16,
    },
    /// The number fills its field and may have lost its leading digits.
    #[error(
        "hit {hit} fills its number field and may have lost leading digits; widen the DPRNT format or state the machine's travel"
    )]
    OverflowSuspect {
        /// The hit.
        hit: u16,
    },
    /// A coordinate is outside the travel that the job states.
    #[error(
        "hit {hit} is outside the travel that the job states; check the number and the work offset"
    )]
    OutsideTravel {
        /// The hit.
        hit: u16,
    },
    /// The macro says that the probe did not touch.
    #[error("hit {hit}: the probe did not touch")]
    NotTouched {
        /// The hit.
        hit: u16,
    },
    /// No direction of motion is known, so it cannot be compensated.
    #[error(
        "hit {hit} has no approach direction; give `approach` in the job or print checked lines"
    )]
    NoApproach {
        /// The hit.
        hit: u16,
    },
    /// The line's approach differs from the job's.
    #[error("hit {hit} was approached in another direction than the job says")]
    ApproachMismatch {
        /// The hit.
        hit: u16,
    },
    /// The same hit or feature was sent twice with different content.
    #[error("sent twice with different coordinates; which one is right is not known: probe again")]
    ConflictingRepeat,
    /// Sequence numbers are missing: lines were lost.
    #[error("lines are missing in the sequence; probe again")]
    SequenceGap,

    // --- a feature's fit
    /// The fit was refused.
    #[error("not fitted: {code}")]
    FitRefused {
        /// Why, by its stable code.
        code: FitRefusal,
    },
    /// The radius is not the nominal one.
    #[error(
        "radius is {error_mm:+.4} mm off nominal, limit {limit_mm:.4} mm; check compensation, ball and hits"
    )]
    RadiusError {
        /// Fitted less nominal radius.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The residuals are too large.
    #[error("residuals {rms_mm:.4} mm rms, limit {limit_mm:.4} mm")]
    Rms {
        /// Rms of the residuals.
        rms_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// A hit's surface normal does not match its approach.
    #[error(
        "hit {hit} touched {angle_deg:.2} deg off its approach, limit {limit_deg:.2} deg; hits are exchanged or one is wrong"
    )]
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
    #[error("hit {hit}, the only one along {}, disagrees with the others by {offset_mm:+.4} mm, limit {limit_mm:.4} mm", axis_name(*.axis))]
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
    #[error("hit {hit} would fit with the other sign of {}: a sign was lost", axis_name(*.axis))]
    SuspectSign {
        /// The hit.
        hit: u16,
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
    },
    /// One hit alone spoils the fit.
    #[error("hit {hit} alone is off, by {off_mm:.4} mm from what the others describe")]
    SuspectHit {
        /// The hit.
        hit: u16,
        /// How far it lies from the feature that the others describe.
        off_mm: f64,
    },

    // --- a setup
    /// The feature did not arrive.
    #[error("{name} did not arrive")]
    MissingFeature {
        /// Its name.
        name: Name,
    },
    /// Two datum positions are not at their reference distance.
    #[error("{a} to {b} is {error_mm:+.4} mm off its reference distance, limit {limit_mm:.4} mm")]
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
    #[error("distances and pose would be right with {a} and {b} exchanged")]
    SuspectExchange {
        /// One feature.
        a: Name,
        /// The other.
        b: Name,
    },
    /// There is no reference yet: no setup has been taught.
    #[error(
        "no reference setup has been taught; ask for teaching (umi teach, T1. in the call of O8811, or the button) and probe the nominal clamping"
    )]
    NoReference,
    /// The registration was refused.
    #[error("not registered: {code}")]
    RegistrationRefused {
        /// Why, by its stable code.
        code: FitRefusal,
    },
    /// The registration's residuals are too large.
    #[error("registration residuals {rms_mm:.4} mm rms, limit {limit_mm:.4} mm")]
    RegistrationRms {
        /// Rms over the datum positions.
        rms_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The part is turned too far about Z.
    #[error("turned {angle_deg:+.4} deg about Z, limit {limit_deg:.4} deg")]
    Rotation {
        /// Angle about Z.
        angle_deg: f64,
        /// The job's limit.
        limit_deg: f64,
    },
    /// The part is tilted too far: a wrong height, or chips under the plate.
    #[error(
        "tilted {angle_deg:.4} deg, limit {limit_deg:.4} deg; look for chips under the part or a wrong Z hit"
    )]
    Tilt {
        /// Angle between the Z axes.
        angle_deg: f64,
        /// The job's limit.
        limit_deg: f64,
    },
    /// The part stands too far from its reference place: a wrong datum or work offset.
    #[error("displaced {shift_mm:+.4} mm in {}, limit {limit_mm:.4} mm; check datum and work offset", axis_name(*.axis))]
    Shift {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Displacement of the datum centroid.
        shift_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The registration is too uncertain at the part.
    #[error("expected error at the part {error_mm:.4} mm, limit {limit_mm:.4} mm")]
    ExpectedError {
        /// One standard deviation at the worst corner.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// What the correction cannot express is too much.
    #[error(
        "the correction would leave {error_mm:.4} mm at the part's corners, limit {limit_mm:.4} mm; shim the part or use a control with a 3-D correction"
    )]
    #[serde(rename = "Leftover")]
    #[strum(serialize = "leftover")]
    Uncorrected {
        /// Largest error left at the part's corners.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The corrected offset does not fit the control's number format.
    #[error("the corrected offset does not fit the control's number format")]
    NotExpressible,
    /// Bytes were lost before the receiver while the setup was measured.
    #[error("{count} bytes from the control were lost; probe the part again")]
    BytesLost {
        /// How many.
        count: u32,
    },
    /// The control began another run of the program before the setup was complete.
    #[error("another run of the program began before the setup was complete; probe it in one run")]
    RunChanged,
    /// Every point is that of the setup before, to the last digit: printed again,
    /// not measured again.
    #[strum(serialize = "repeated_plate")]
    #[error(
        "every point is that of the setup before, to the last digit: printed again, not measured again; probe the part"
    )]
    RepeatedSetup,
    /// No hit came for the job's setup time-out.
    #[error("no hit for {timeout_s} s; the setup was given up")]
    TimedOut {
        /// The time-out.
        timeout_s: u32,
    },
    /// The input ended.
    #[error("the input ended before the setup was complete")]
    InputEnded,

    // --- the two witnesses of a hit
    /// The probe's skip edge of this hit was not latched.
    #[error(
        "hit {hit} has no second witness: its skip edge was not latched, or its line says no feed; check the skip wire to the board, its level (`skip.active`) and what the macro prints"
    )]
    NotLatched {
        /// The hit.
        hit: u16,
    },
    /// Hits at different feeds, in a setup or against the taught one: what the control and the
    /// probe add does not cancel.
    #[error(
        "hit {hit} was probed at {feed_mm_per_min} mm/min, others or the taught ones at {expected_mm_per_min}; gauge at one feed, or teach again"
    )]
    FeedChanged {
        /// The hit.
        hit: u16,
        /// Its feed.
        feed_mm_per_min: f64,
        /// That of the taught setup; where none is known, of this one's first hit.
        expected_mm_per_min: f64,
    },
    /// The control stored a position later after the skip signal than it may, or
    /// before it.
    #[error("{}: the control stored a position {delay_ms:.2} ms after the skip edge, limit {limit_ms} ms; check its skip input and the feed", axis_name(*.axis))]
    ControlDelay {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// The delay that the positions say.
        delay_ms: f64,
        /// The job's limit.
        limit_ms: f64,
    },
    /// All of the control's positions are shifted against the encoders: the work
    /// offset or the machine's datum has changed, or counts were lost between setups.
    #[error("{}: the control's positions stand {shift_mm:+.4} mm off the encoder, limit {limit_mm:.4} mm; a work offset or the datum has changed, or counts were lost between setups: check both, then set the job again", axis_name(*.axis))]
    WitnessShift {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Control less encoder.
        shift_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// Control and encoder differ in proportion to the position: a wrong scale.
    #[error(fmt = wrong_scale)]
    WitnessScale {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Control over encoder less one, in millionths.
        ppm: f64,
    },
    /// Control and encoder part company between two hits: counts were lost.
    #[error("{}: the encoder's counter jumped by {counts:+.0} counts between two hits; check its cable and shield", axis_name(*.axis))]
    LostCounts {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// How many counts the encoder's counter is behind, with sign.
        counts: f64,
    },
    /// Control and encoder differ without a pattern.
    #[error("{}: control and encoder differ by up to {off_mm:.4} mm without a pattern, limit {limit_mm:.4} mm; check encoder wiring and what the macro prints", axis_name(*.axis))]
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
    #[error(
        "control and encoders agree; over {hits} hits the control stored positions {least_ms:.2} to {most_ms:.2} ms after the skip edge, mean {mean_ms:.2} (the tolerance is worth {resolution_ms:.1} ms)"
    )]
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
    /// This setup says where the encoders' origin is: what shifted before it, no one
    /// has seen.
    #[error("the encoders' origin was taken from this setup; a shift before it is not seen")]
    WitnessLearned,
    /// A block arrived whose name is not in the job.
    #[error("{name} is not in the job; its hits were not used")]
    UnknownFeature {
        /// The name.
        name: Name,
    },
    /// This setup became the reference.
    #[error("this setup is now the reference")]
    Taught,
    /// A refused feature was sent again and replaced.
    #[error("{name} was refused, sent again and replaced")]
    Replaced {
        /// Its name.
        name: Name,
    },
    /// Identical repeats of this feature were dropped.
    #[error("{name} was sent again unchanged; dropped")]
    RepeatDropped {
        /// Its name.
        name: Name,
    },

    // --- later reasons: behind all others, so that older journals are read as they were
    /// This setup was measured before it was known where a setup begins.
    #[error(
        "the control began with {began_with}, so it is not known which features are of one clamping; print checked lines with a run number, probe in the job's order, or read the correction after each clamping"
    )]
    OrderUnknown {
        /// The feature with which the control began.
        began_with: Name,
    },
    /// Another setup is the reference already, and nobody said that this one is to replace it.
    #[error(
        "there is a reference already; ask twice (`umi teach --again`, `G65 P8811 T2.`) if this setup is to replace it"
    )]
    AlreadyTaught,
    /// A feature's radius is not that of the taught setup.
    #[error(
        "radius is off by {error_mm:+.4} mm against the taught setup, limit {limit_mm:.4} mm; check stylus and balls"
    )]
    RadiusSinceTaught {
        /// Fitted less taught radius.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// A feature's residuals are larger than in the taught setup: a worn or loose stylus.
    #[error(
        "residuals are {rms_mm:.4} mm rms, {taught_mm:.4} mm when taught, limit {limit_mm:.4} mm more; the stylus may be worn or loose"
    )]
    RmsSinceTaught {
        /// Rms of the residuals.
        rms_mm: f64,
        /// Of the taught setup.
        taught_mm: f64,
        /// The job's limit on their difference.
        limit_mm: f64,
    },
    /// Hits were approached farther beside the centre than in the taught setup.
    #[error(
        "hits were approached {off_mm:.4} mm beside the centre, {taught_mm:.4} mm when taught, limit {limit_mm:.4} mm more; check stylus and balls"
    )]
    CentringSinceTaught {
        /// How far beside the centre.
        off_mm: f64,
        /// Of the taught setup.
        taught_mm: f64,
        /// The job's limit on their difference.
        limit_mm: f64,
    },
    /// A feature that was probed twice is not where it was the first time.
    #[error(
        "it is {name} probed again and is {off_mm:.4} mm away from it, limit {limit_mm:.4} mm; the part moved, the machine drifts, or a hit is wrong"
    )]
    NotClosed {
        /// The feature that it repeats.
        name: Name,
        /// How far apart the two are.
        off_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// A feature on the table is not where it was when the reference was taught.
    #[error("it stays on the table and is off by X{:+.4} Y{:+.4} Z{:+.4} mm since the reference was taught, limit {limit_mm:.4} mm; check probe length, stylus and work offset, or teach again", .off_mm[0], .off_mm[1], .off_mm[2])]
    FixedMoved {
        /// How far from there.
        off_mm: [f64; 3],
        /// The job's limit.
        limit_mm: f64,
    },
    /// Two datum positions are not at the distance that the job states.
    #[error(
        "distance {a} to {b} is off by {error_mm:+.4} mm against the job's `position_mm`, limit {limit_mm:.4} mm"
    )]
    NominalDistance {
        /// One feature.
        a: Name,
        /// The other.
        b: Name,
        /// Measured less stated distance.
        error_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// The plate is warmer or colder than taught by more than the job allows.
    #[error(
        "the plate is {kelvin:+.1} K warmer than taught, limit {limit_k:.1} K; let it come to temperature, or teach again"
    )]
    TooWarm {
        /// Warmer than taught, kelvin.
        kelvin: f64,
        /// The job's limit.
        limit_k: f64,
    },
    /// The run did not say in which work offset it is probed.
    #[error("the run did not say in which work offset it is probed; begin it with `G65 P8811`")]
    FrameUnknown,
    /// The run was probed in another work offset than the job states.
    #[error("probed in work offset {}, the job's `probed_in` is {}", OffsetName(*.got), OffsetName(*.expected))]
    OtherOffset {
        /// 1 for G54 to 6 for G59; from 101 on a further one.
        got: u16,
        /// The job's, likewise.
        expected: u16,
    },
    /// The work offset has other values than the job states.
    #[error("{} of the work offset is {got_mm:.4} mm on the control and {expected_mm:.4} mm in the job's `probed_origin_mm`; put it back, or set the job and teach again", axis_name(*.axis))]
    OffsetChanged {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// The control's value.
        got_mm: f64,
        /// The job's `probed_origin_mm`.
        expected_mm: f64,
    },

    // --- later remarks
    /// The plate is warmer (or colder) than taught.
    #[error(
        "{kelvin:+.1} K (sigma {sigma_k:.1} K) warmer than taught; the correction is right at the part's middle"
    )]
    Warmer {
        /// Kelvin.
        kelvin: f64,
        /// One standard deviation of that; 0 where the job states no probing sigma.
        sigma_k: f64,
    },
    /// The program's run that this setup belongs to.
    #[error("measured in run {run}")]
    OfRun {
        /// Its number.
        run: u32,
    },
    /// The stated error at the worst corner of the part: 95 of 100 setups are better.
    #[strum(serialize = "error_95")]
    #[error("95 % of such corrections are within {error_mm:.4} mm at the part's worst corner")]
    Error95 {
        /// With the taught setup's own share.
        error_mm: f64,
    },

    // --- later reasons
    /// A rotation (G68, or that of LinuxCNC's work offset) was active in the run.
    #[error("a rotation was active while it was probed; begin with G69")]
    RotationActive,
    /// The external offset is another one than the job states.
    #[error("{} of the external offset is {got_mm:.4} mm on the control and {expected_mm:.4} mm in the job's `external_mm`", axis_name(*.axis))]
    ExternalOffset {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// The control's value.
        got_mm: f64,
        /// The job's `external_mm`.
        expected_mm: f64,
    },
    /// The tool length in force is another one than the job states.
    #[error(
        "the tool length in force is {got_mm:.4} mm, the job's `tool_length_mm` {expected_mm:.4} mm; call the probe's own"
    )]
    ToolLength {
        /// The control's value.
        got_mm: f64,
        /// The job's `tool_length_mm`.
        expected_mm: f64,
    },

    // --- a later remark
    /// What nothing in this job guards against.
    #[error(fmt = not_guarded)]
    NotGuarded {
        /// Text of another clamping: no run number goes back with the correction.
        late_text: bool,
        /// A work offset that was moved, G52, G92, another tool length: no run says where its
        /// coordinates lie.
        moved_offset: bool,
        /// The same while it is probed: what prints these lines does not look again.
        while_probed: bool,
        /// A reference that nobody meant: the first OK setup is taught.
        first_ok: bool,
    },
    /// This setup has widened what was learned.
    #[error(
        "this setup teaches too: limits on radius, rms and centring are wider by what {further} further clampings have shown"
    )]
    TaughtMore {
        /// Setups that have taught after the first.
        further: u16,
    },
    /// The probe's skip line bounced, or there were sparks on it, since the verdict before: each
    /// touch is its first edge.
    #[error(
        "the skip line had {bounces} bounces and {sparks} sparks: each touch is its first edge; look at probe, cable and shield if there are many"
    )]
    SkipChatter {
        /// Pulses that belong to a touch and are not its first.
        bounces: u32,
        /// Pulses below the minimum width.
        sparks: u32,
    },
    /// The last hit of a ball is not where its first one was.
    #[error(
        "hit {hit} touches where hit {first} did, and is off by {off_mm:+.4} mm, limit {limit_mm:.4} mm; clean ball and stylus, and probe it again"
    )]
    NotRepeated {
        /// The later hit.
        hit: u16,
        /// The earlier one.
        first: u16,
        /// The later less the earlier, against their approach: negative where the first one
        /// came too early.
        off_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// Two hits that should be at one place are apart across their approach.
    #[error(
        "hit {hit} should touch where hit {first} did and is {off_mm:.3} mm beside it; the macro must touch the top once more at the end (`H2.`)"
    )]
    NotSamePlace {
        /// The later hit.
        hit: u16,
        /// The earlier one.
        first: u16,
        /// How far beside.
        off_mm: f64,
    },
    /// No line said in which run the hits were probed, and the job compares runs.
    #[error(
        "no line says in which run this was probed; the part program must call O8811 (`umi_start`) before each probing"
    )]
    RunUnknown,
    /// The run's number is not greater than that of a run that was judged before.
    #[error(
        "run {run} is not after run {last}, which was judged before: these lines are old, or were played again, or are of a second clamping in one run; call O8811 before each clamping; if the control has lost its count, set its run variable to {last}"
    )]
    OldRun {
        /// The run that the lines say.
        run: u32,
        /// The latest that was judged.
        last: u32,
    },
    /// The run's coordinates lie elsewhere than work offset, external offset and tool length say.
    #[error(
        "{} of the coordinates is shifted by {got_mm:+.3} mm while it was probed, and no offset says so; cancel G52 and G92 (on LinuxCNC a tool's offset), and see that #119 of O8811 is right", axis_name(*.axis)
    )]
    Shifted {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Machine position less work position less all offsets.
        got_mm: f64,
    },
    /// The run did not say whether anything shifts its coordinates besides the offsets.
    #[error(
        "the run did not say whether G52 or G92 shifts its coordinates: its macros are older than the job's `frame`; load all of hw/control"
    )]
    ShiftUnknown,
    /// A line asks to teach, and one taught the setup before: which of the two is meant is not
    /// known. Where a job is taught by asking alone, neither is the reference any more.
    #[error(
        "a line taught the setup before as well, so which of the two is meant is not known: take `T1.` or `T2.` out of the program if it was left there; probe once without it, then teach again, or ask at the host (`umi teach`)"
    )]
    TaughtTwice,
    /// A datum feature was not probed between the closing one and the one that it repeats: what
    /// moved there leaves no trace.
    #[error(
        "{name} was not probed between {first} and this one, so a slip of the part is not seen there: probe one that is probed twice first, and all of them again when the others are done"
    )]
    NotEnclosed {
        /// The feature that lies outside.
        name: Name,
        /// The feature that is repeated.
        first: Name,
    },
    /// The tool length in force is another one than in the taught setup.
    #[error(
        "the tool length in force is {got_mm:.4} mm, {taught_mm:.4} mm when taught; call the probe's own, or teach again"
    )]
    ToolLengthSinceTaught {
        /// The control's value.
        got_mm: f64,
        /// Of the taught setup.
        taught_mm: f64,
    },
    /// A remark: nothing says which tool length the reference rests on.
    #[error(
        "not guarded: another tool length than the reference's; give `tool_length_mm` in the job's [guards], or teach again"
    )]
    LengthNotGuarded,
    /// The part has grown with the plate by more than a rigid correction may leave.
    #[error(
        "the part's corners have grown by {grown_mm:.4} mm since it was taught, which no correction moves, limit {limit_mm:.4} mm; let it come to temperature, or teach again"
    )]
    PartGrown {
        /// At the corner that has moved most against the part's middle.
        grown_mm: f64,
        /// The job's limit.
        limit_mm: f64,
    },
    /// A remark: what a rigid correction leaves of the part's growth.
    #[error("left at the part's corners: {grown_mm:.4} mm that it has grown since it was taught")]
    GrowthLeft {
        /// At the corner that has moved most against the part's middle.
        grown_mm: f64,
    },
    /// The control rounds to steps with which a correction is not within what is stated of it.
    #[error(
        "all coordinates are whole steps of {step_mm:.3} mm, 0.010 mm at most: a correction would be off by as much; let the control measure and print finer, then teach again"
    )]
    CoarseStep {
        /// What the control rounds to.
        step_mm: f64,
    },
    /// No ball on the table was probed behind the last datum feature: what bent the stylus before
    /// that leaves no trace.
    #[error(
        "{name} was probed behind this one, so a stylus that was bent in between is not seen: probe a ball on the table last"
    )]
    FixedBefore {
        /// The datum feature that came last.
        name: Name,
    },
    /// Hits were printed that nobody has touched.
    #[error(
        "{hits} hits were printed, the skip line showed {touches} touches: text that was not probed now, or the skip line is not seen; touch the probe by hand while `umi watch` runs, check the wire and `skip.active`"
    )]
    Untouched {
        /// Hits that were printed.
        hits: u16,
        /// Those of them that had a touch; of a block, the touches before it.
        touches: u16,
    },
    /// A remark: each hit had its touch.
    #[error("each of the {hits} hits had its touch on the skip line")]
    Touched {
        /// Hits of the setup.
        hits: u16,
    },
    /// The reference was taught for a host or the button, and nobody has said that its run is the one that was meant.
    #[error(
        "run {run} has taught, and it may be an old text that came before the run that was meant: `umi teach --keep {run}` if it is the right one, `umi teach --again` if not"
    )]
    TaughtUnread {
        /// The run that taught.
        run: u32,
    },
    /// A remark of the setup that taught so.
    #[error(
        "it holds for other runs by `umi teach --keep {run}`, or once a control that compares runs has read in this one"
    )]
    TaughtByRun {
        /// The run that taught.
        run: u32,
    },
    /// The control was asked to teach in a run of which nothing was judged: what is taught is older than what was meant.
    #[error(
        "the control was asked to teach in run {asked_in}, and nothing of that run was judged: what the board was taught before is not what was meant; teach again (`T2.`, or `umi teach --again`)"
    )]
    AskedInRun {
        /// The run in which it was asked, as the control says it.
        asked_in: u32,
    },
    /// A host asked to teach anew while the setup was measured.
    #[error("it was given up: somebody asked to teach anew while it was measured")]
    GivenUp,
    /// The skip line rests at the level of a touch: each end of a touch is taken for one. The encoders show it.
    #[error(fmt = wrong_rest)]
    SkipRestsAtTouch {
        /// The level at which it rests, which is `skip.active`.
        rests: SignalLevel,
    },
    /// The skip line was at the level of a touch for most of the setup. A remark: a probe that stands on the stylus for long
    /// shows the same, and nothing but durations is known.
    #[error(fmt = perhaps_wrong_rest)]
    SkipMayRestAtTouch {
        /// That level, which is `skip.active`.
        rests: SignalLevel,
    },
}

/// Why a fit or a registration was refused.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum FitRefusal {
    /// Fewer points than parameters need.
    #[error("too few points: probe more")]
    TooFewPoints,
    /// NaN or infinity.
    #[error("a coordinate is not a number, or beyond any machine")]
    NotFinite,
    /// Coplanar, collinear or coinciding points.
    #[error("the points coincide or lie on one line or in one plane: probe places that lie apart")]
    Degenerate,
    /// Worse conditioned than the stated limit.
    #[error(
        "the points say too little about the shape: spread them wider, or check what was probed"
    )]
    IllConditioned,
    /// The points cover too little of the surface.
    #[error("the points cover too little of the surface to say a radius: probe a larger part")]
    CapTooSmall,
    /// The iteration did not reach a proven minimum.
    #[error("the points do not look like this shape: check the feature and its hits")]
    NoConvergence,
    /// Two lists of different length.
    #[error("the two lists of points differ in length")]
    LengthMismatch,
}

impl FitRefusal {
    /// The stable code.
    #[must_use]
    pub fn code(self) -> &'static str {
        self.into()
    }
}

impl Reason {
    /// The stable code of the reason.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::FitRefused { code } | Self::RegistrationRefused { code } => code.code(),
            other => other.into(),
        }
    }
}

/// The letter of an axis number.
pub(crate) const fn axis_name(axis: u8) -> char {
    match axis {
        0 => 'X',
        1 => 'Y',
        _ => 'Z',
    }
}

/// A work offset by its number: 1 for G54, from 101 on the further ones.
struct OffsetName(u16);

impl fmt::Display for OffsetName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            number @ 1..=6 => write!(f, "G{}", 53 + number),
            number => write!(f, "G54.1 P{}", number.saturating_sub(100)),
        }
    }
}

fn not_guarded(
    late_text: &bool,
    moved_offset: &bool,
    while_probed: &bool,
    first_ok: &bool,
    f: &mut fmt::Formatter<'_>,
) -> fmt::Result {
    let mut separator = "not guarded: ";
    for (is_open, what) in [
        (*late_text, "text of another clamping"),
        (*moved_offset, "a moved offset, G52, G92, tool length"),
        (
            // What is not seen at all is not seen then either.
            *while_probed && !*moved_offset,
            "a moved offset, G52 or G92 while probing",
        ),
        (*first_ok, "teaching by chance"),
    ] {
        if is_open {
            write!(f, "{separator}{what}")?;
            separator = ", ";
        }
    }
    Ok(())
}

/// A level, and the other one.
const fn levels(level: SignalLevel) -> (&'static str, &'static str) {
    match level {
        SignalLevel::High => ("high", "low"),
        SignalLevel::Low => ("low", "high"),
    }
}

fn perhaps_wrong_rest(rests: &SignalLevel, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let (rests, other) = levels(*rests);
    write!(
        f,
        "the skip line may rest at {rests}, which the job takes for a touch: it was {rests} for most of the setup, as it also is where the probe stays pressed for long; look at it with the probe free (`umi watch`, or a lamp), and set `skip.active = \"{other}\"` only if it is {rests} then"
    )
}

fn wrong_rest(rests: &SignalLevel, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let (rests, other) = levels(*rests);
    write!(
        f,
        "the skip line rests at {rests}, which the job takes for a touch, so each release counted as one; set `skip.active = \"{other}\"`, or look for a broken wire or a probe that is off"
    )
}

/// Counted the other way is not a matter of parts per million.
fn wrong_scale(axis: &u8, ppm: &f64, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let axis = axis_name(*axis);
    if *ppm < -1e6 {
        write!(
            f,
            "{axis}: the encoder counts the other way; change the sign of `counts_per_mm`, or its wires"
        )
    } else {
        write!(
            f,
            "{axis}: control and encoder differ by {ppm:+.0} ppm; check `counts_per_mm`, inch or mm, the control's scaling"
        )
    }
}
