//! Whether a job can be used: everything that could surprise later is refused
//! here, by the name of its field.

use umi_protocol::job::{
    Approach, Closing, Compensation, CorrectionSpec, FeatureKind, FeatureSpec, Guards, Job, Limits,
    MAX_DATUMS, MAX_HITS, Name, Reference, SendWhen, Teach, WitnessSpec,
};
use umi_protocol::job_error::{Field, JobError};
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_protocol::pattern::{Coding, LinePattern};
use umi_protocol::reason::Reason;
use umi_protocol::serial::{LEAST_BAUD, MOST_BAUD};

use crate::correction;
use crate::registration;
use crate::units::Point;

/// Checks a job.
///
/// # Errors
/// The first fault found, in the order of the file.
pub fn check(job: &Job) -> Result<(), JobError> {
    if !is_printable(&job.name) {
        return Err(JobError::BadName);
    }
    if job.plate_timeout_s == 0 {
        return Err(bad(Field::PlateTimeoutS, None, 0.0));
    }
    crate::dprnt::check_config(&job.receiver).map_err(|refusal| match refusal {
        crate::dprnt::ConfigError::NoPatterns => JobError::NoPatterns,
        _ => bad(Field::Receiver, None, f64::NAN),
    })?;
    if job.features.is_empty() {
        return Err(JobError::NoFeatures);
    }
    for (number, feature) in (1u8..).zip(&job.features) {
        check_feature(job, number, feature)?;
    }
    for (at, one) in job.features.iter().enumerate() {
        for other in job.features.iter().skip(at + 1) {
            if one.name == other.name || (one.id.is_some() && one.id == other.id) {
                return Err(JobError::DuplicateFeature {
                    name: other.name.clone(),
                });
            }
        }
    }
    check_compensation(job.compensation)?;
    check_limits(&job.limits)?;
    check_line(job)?;
    check_skip(job)?;
    check_again(job)?;
    if let Some(witness) = &job.witness {
        check_witness(job, witness)?;
    }
    check_guards(job, &job.guards)?;
    let places = place_count(job);
    if places > MAX_DATUMS {
        return Err(JobError::TooManyDatums {
            got: narrow(places),
            most: narrow(MAX_DATUMS),
        });
    }
    let datums = datums(job).count();
    if job.correction.is_some() && datums < LEAST_DATUMS {
        return Err(JobError::TooFewDatums {
            got: narrow(datums),
        });
    }
    if datums >= 3 && job.reference == Reference::Given {
        check_reference(job)?;
    }
    let Some(correction) = &job.correction else {
        return Ok(());
    };
    if !job.receiver.patterns.iter().all(names_feature) {
        return Err(JobError::UnnamedFeatures);
    }
    check_coding(job, correction)?;
    check_correction(correction)
}

/// The features whose position takes part in the registration, with their
/// place in the job.
pub fn datums(job: &Job) -> impl Iterator<Item = (usize, &FeatureSpec)> {
    let guards = &job.guards;
    job.features
        .iter()
        .enumerate()
        .filter(|(_, f)| f.datum && f.kind.has_position())
        .filter(|(_, f)| !guards.fixed.contains(&f.name))
        .filter(|(_, f)| closes(guards, &f.name) == 0)
}

/// How many features this one is, probed once more: one at most in a job that is good.
fn closes(guards: &Guards, name: &Name) -> usize {
    let closings = guards.closing.iter();
    closings.filter(|closing| closing.feature == *name).count()
}

/// The features that stay on the table, with their place in the job.
pub fn fixed(job: &Job) -> impl Iterator<Item = (usize, &FeatureSpec)> {
    let features = job.features.iter().enumerate();
    features.filter(|(_, f)| job.guards.fixed.contains(&f.name))
}

/// The features that are another one, probed once more, and which.
pub fn closing(job: &Job) -> impl Iterator<Item = (usize, &Closing)> {
    job.guards.closing.iter().filter_map(|closing| {
        let place = job.features.iter().position(|f| f.name == closing.feature);
        place.map(|place| (place, closing))
    })
}

/// Datum features that a registration needs.
const LEAST_DATUMS: usize = 3;

/// Whether something is moved by a job's verdicts: by a correction, or by a registration, by
/// which a program is rewritten.
#[must_use]
pub fn moves_something(job: &Job) -> bool {
    job.correction.is_some() || datums(job).count() >= LEAST_DATUMS
}

/// What nothing in a job guards against by whose verdicts something is moved: a correction, or
/// a rewritten program, which needs a registration only. A remark in each of its verdicts.
#[must_use]
pub fn not_guarded(job: &Job) -> Option<Reason> {
    if !moves_something(job) {
        return None;
    }
    let late_text = job.guards.run_variable.is_none();
    let moved_offset = !job.guards.frame;
    // The macros that print checked lines look before each hit, and before each line.
    let while_probed = !job.receiver.patterns.iter().all(says_approach);
    let first_ok = job.reference == Reference::Taught && job.teach == Teach::FirstOk;
    let is_open = late_text || moved_offset || while_probed || first_ok;
    is_open.then_some(Reason::NotGuarded {
        late_text,
        moved_offset,
        while_probed,
        first_ok,
    })
}

/// Places that a reference has: of the datum features and of those on the table.
pub fn place_count(job: &Job) -> usize {
    datums(job).count() + fixed(job).count()
}

fn check_line(job: &Job) -> Result<(), JobError> {
    let line = job.line.settings();
    if !(LEAST_BAUD..=MOST_BAUD).contains(&line.baud) {
        return Err(bad(Field::LineBaud, None, line.baud.into()));
    }
    if !matches!(line.data_bits, 7 | 8) {
        return Err(bad(Field::LineDataBits, None, line.data_bits.into()));
    }
    if !matches!(line.stop_bits, 1 | 2) {
        return Err(bad(Field::LineStopBits, None, line.stop_bits.into()));
    }
    match (line.data_bits, job.receiver.coding) {
        (7, Coding::Ascii) => Err(JobError::ParityMissing),
        _ => Ok(()),
    }
}

fn check_skip(job: &Job) -> Result<(), JobError> {
    let skip = &job.skip;
    // Wider than any contact's first closure it would throw touches away.
    if skip.min_width_us() > 10_000 {
        return Err(bad(Field::SkipMinWidthUs, None, skip.min_width_us().into()));
    }
    if !(1..=1000).contains(&skip.hold_off_ms()) {
        return Err(bad(Field::SkipHoldOffMs, None, skip.hold_off_ms().into()));
    }
    if !(0.0..=100_000.0).contains(&skip.delay_us) {
        return Err(bad(Field::SkipDelayUs, None, skip.delay_us));
    }
    // What nobody looks at guards nothing.
    let missing = if job.witness.is_none() && skip.delay_us != 0.0 {
        // A way is taken off positions, and these are the encoders'.
        Field::CountsPerMm
    } else if !judges_touches(job) && (skip.min_width_us.is_some() || skip.hold_off_ms.is_some()) {
        Field::SkipEachHit
    } else {
        return Ok(());
    };
    Err(JobError::Missing {
        field: missing,
        feature: None,
    })
}

fn check_again(job: &Job) -> Result<(), JobError> {
    let Some(again) = job.again else {
        // Unless the two are held against each other, two that are alike look like one line
        // that was printed twice.
        return match job.features.iter().find(|feature| touches_again(feature)) {
            None => Ok(()),
            Some(feature) => Err(JobError::Missing {
                field: Field::Again,
                feature: Some(feature.name.clone()),
            }),
        };
    };
    positive(again.within_mm, Field::Again, None)?;
    if job.features.iter().any(touches_again) {
        Ok(())
    } else {
        // It would guard nothing.
        Err(bad(Field::Again, None, again.within_mm))
    }
}

/// Whether the last hit of a feature touches once more where its first one did.
///
/// A sphere that is probed from one side twice has no other hit there. Without the last one
/// enough are left for a fit with a degree of freedom.
pub fn touches_again(feature: &FeatureSpec) -> bool {
    feature.kind == FeatureKind::Sphere
        && feature.hits > feature.kind.min_hits() + 1
        && feature.approach.first() == feature.approach.last()
        && feature.approach.first().is_some_and(|first| {
            let alike = |of: &&Approach| *of == first;
            feature.approach.iter().filter(alike).count() == 2
        })
}

/// The first closing feature of the part which in the job's order shows less than it should: one
/// that a datum feature follows, or any where none repeats the first of these.
fn not_enclosing(job: &Job) -> Option<&Closing> {
    let place = |name: &Name| job.features.iter().position(|f| f.name == *name);
    let mut due = datums(job).map(|(of, _)| of);
    let first = due.next()?;
    let last = due.last().unwrap_or(first);
    let on_part = |closing: &&Closing| !job.guards.fixed.contains(&closing.repeats);
    let mut closings = job.guards.closing.iter().filter(on_part);
    let any = closings.clone().next()?;
    let begins = |closing: &Closing| place(&closing.repeats) <= Some(first);
    let repeats_first = closings.clone().any(begins);
    let followed = closings.find(|closing| place(&closing.feature) < Some(last));
    followed.or((!repeats_first).then_some(any))
}

fn check_guards(job: &Job, guards: &Guards) -> Result<(), JobError> {
    let feature = |name: &Name, field| {
        let found = job.features.iter().find(|f| f.name == *name);
        let found = found.filter(|f| f.kind.has_position());
        found.ok_or_else(|| bad(field, Some(name), f64::NAN))
    };
    for closing in &guards.closing {
        let again = feature(&closing.feature, Field::Closing)?;
        let first = feature(&closing.repeats, Field::Closing)?;
        // A wrong one of either is as good as no closing at all.
        if again.name == first.name
            || again.kind != first.kind
            || guards.fixed.contains(&again.name)
            || closes(guards, &first.name) > 0
            || closes(guards, &again.name) > 1
        {
            return Err(bad(Field::Closing, Some(&again.name), f64::NAN));
        }
        positive(closing.within_mm, Field::Closing, Some(&closing.feature))?;
    }
    if !says_run(job)
        && let Some(closing) = not_enclosing(job)
    {
        // Without runs the order is the job's, and no setup could be OK.
        return Err(bad(Field::Closing, Some(&closing.feature), f64::NAN));
    }
    for name in &guards.fixed {
        feature(name, Field::Fixed)?;
        // Where it is, is learned with the reference.
        if job.reference == Reference::Given {
            return Err(bad(Field::Fixed, Some(name), f64::NAN));
        }
    }
    if let Some(limit) = guards.fixed_mm {
        positive(limit, Field::FixedMm, None)?;
    } else if let Some(name) = guards.fixed.first() {
        let (field, feature) = (Field::FixedMm, Some(name.clone()));
        return Err(JobError::Missing { field, feature });
    }
    if let Some(limit) = guards.nominal_distance_mm {
        positive(limit, Field::NominalDistanceMm, None)?;
        if let Some((_, without)) = datums(job).find(|(_, f)| f.position_mm.is_none()) {
            let (field, feature) = (Field::PositionMm, Some(without.name.clone()));
            return Err(JobError::Missing { field, feature });
        }
    }
    if let Some(learned) = guards.learned {
        for limit in [learned.radius_mm, learned.rms_mm, learned.centring_mm] {
            positive(limit, Field::Learned, None)?;
        }
    }
    if let Some(probing) = guards.probing {
        for sigma in probing.sigma_mm {
            if !(LEAST_SIGMA_MM..=MOST_SIGMA_MM).contains(&sigma) {
                return Err(bad(Field::Probing, None, sigma));
            }
        }
        positive(probing.dof.into(), Field::Probing, None)?;
    }
    if let Some(warmth) = guards.warmth {
        positive(warmth.expansion_ppm_per_k, Field::Warmth, None)?;
        positive(warmth.at_most_k, Field::Warmth, None)?;
    }
    let says_run = says_run(job);
    if let Some(variable) = guards.run_variable {
        let dialect = job.correction.as_ref().map(|spec| spec.dialect);
        let can = dialect.is_some_and(|dialect| {
            correction::dialect::compares_runs(dialect)
                && correction::dialect::keeps_runs(dialect, variable)
        });
        if !(says_run && can) {
            return Err(bad(Field::RunVariable, None, variable.into()));
        }
    }
    if guards.frame && !(says_run && job.correction.is_some()) {
        return Err(bad(Field::Frame, None, f64::NAN));
    }
    let [x, y, z] = guards.external_mm;
    for value in [x, y, z, guards.tool_length_mm.unwrap_or(0.0)] {
        if !value.is_finite() {
            return Err(bad(Field::Frame, None, value));
        }
    }
    Ok(())
}

fn check_feature(job: &Job, number: u8, feature: &FeatureSpec) -> Result<(), JobError> {
    let name = &feature.name;
    if !is_printable(name) || name.contains(' ') {
        return Err(JobError::BadFeatureName { feature: number });
    }
    // Those that close or stay on the table carry a verdict as a datum does.
    let guards = &job.guards;
    let carries = feature.datum || guards.fixed.contains(name) || closes(guards, name) > 0;
    let is_datum = carries && feature.kind.has_position();
    // What a correction rests on has at least one hit more than it needs, else
    // nothing in it can contradict a wrong one.
    let spare = u16::from(is_datum && job.correction.is_some());
    let least = feature.kind.min_hits() + spare;
    if feature.hits < least || usize::from(feature.hits) > MAX_HITS {
        return Err(JobError::HitCount {
            name: name.clone(),
            hits: feature.hits,
            least,
            most: narrow(MAX_HITS).into(),
        });
    }
    let approaches = feature.approach.len();
    if approaches != 0 && approaches != usize::from(feature.hits) {
        return Err(JobError::ApproachCount {
            name: name.clone(),
            got: narrow(approaches).into(),
            hits: feature.hits,
        });
    }
    if let Some(position) = feature.position_mm {
        all_finite(position, Field::PositionMm, Some(name))?;
    }
    if let Some(radius) = feature.radius_mm {
        positive(radius, Field::RadiusMm, Some(name))?;
    }
    if job.reference == Reference::Given && is_datum && feature.position_mm.is_none() {
        return Err(JobError::Missing {
            field: Field::PositionMm,
            feature: Some(name.clone()),
        });
    }
    // A sphere without a nominal radius could be anything round: the radius is
    // the only check that sees a wrong compensation.
    if job.correction.is_some()
        && is_datum
        && feature.kind.has_radius()
        && feature.radius_mm.is_none()
    {
        return Err(JobError::Missing {
            field: Field::RadiusMm,
            feature: Some(name.clone()),
        });
    }
    // Residuals cannot show a wrong lone hit of a sphere: the approach does.
    if job.correction.is_some() && is_datum && feature.kind == FeatureKind::Sphere {
        let printed = job.receiver.patterns.iter().all(says_approach);
        for (missing, field) in [
            (job.limits.approach_deg.is_none(), Field::ApproachDeg),
            (approaches == 0 && !printed, Field::Approach),
        ] {
            if missing {
                return Err(JobError::Missing {
                    field,
                    feature: Some(name.clone()),
                });
            }
        }
    }
    Ok(())
}

/// Whether lines of this pattern carry the direction of motion, and the feed.
const fn says_approach(pattern: &LinePattern) -> bool {
    matches!(pattern, LinePattern::Checked(_))
}

/// Whether lines of this pattern come when all of a feature has been touched, not after each hit.
const fn is_printed_later(pattern: &LinePattern) -> bool {
    matches!(pattern, LinePattern::Block(_) | LinePattern::RingCsv(_))
}

/// Whether the probe's touches are judged: by where the axes were, or only whether there was one.
#[must_use]
pub fn judges_touches(job: &Job) -> bool {
    job.witness.is_some() || job.skip.each_hit
}

/// Whether falls of the skip line are looked at: both edges where touches are judged, else the one that is a touch.
#[must_use]
pub fn looks_at_falls(job: &Job) -> bool {
    judges_touches(job) || job.skip.touches_by() == LatchCause::SkipEnd
}

/// Whether a touch of the probe behind a verdict says that another setup is being probed: where
/// features are printed when they have been touched, the probe is free when a verdict comes. Not
/// asked where runs have numbers, which say it better.
#[must_use]
pub fn touch_begins_anew(job: &Job) -> bool {
    job.guards.run_variable.is_none() && job.receiver.patterns.iter().all(is_printed_later)
}

/// Whether this capture is such a touch: what was released before it is taken back.
#[must_use]
pub fn begins_anew(job: &Job, latch: &LatchReport) -> bool {
    latch.cause == job.skip.touches_by() && touch_begins_anew(job)
}

/// Whether each run can say its number: by checked lines, or by those of O8811 (`umi_start`)
/// before blocks.
pub fn says_run(job: &Job) -> bool {
    let patterns = &job.receiver.patterns;
    let or_block = |p: &LinePattern| matches!(p, LinePattern::Checked(_) | LinePattern::Block(_));
    patterns.iter().all(or_block) && patterns.iter().any(says_approach)
}

/// Whether lines of this pattern say to which feature they belong.
fn names_feature(pattern: &LinePattern) -> bool {
    match pattern {
        LinePattern::Block(_) | LinePattern::RingCsv(_) | LinePattern::Checked(_) => true,
        LinePattern::Template(template) => template
            .text
            .as_bytes()
            .windows(6)
            .any(|at| at == b"{name}"),
        LinePattern::PointLine(_)
        | LinePattern::LabelledWords(_)
        | LinePattern::GrblProbe
        | LinePattern::LinuxCncProbe => false,
    }
}

fn check_compensation(compensation: Compensation) -> Result<(), JobError> {
    let Compensation::OnBoard {
        tip_radius_mm,
        pretravel_mm,
    } = compensation
    else {
        return Ok(());
    };
    positive(tip_radius_mm, Field::TipRadiusMm, None)?;
    for pretravel in pretravel_mm {
        if !(0.0..tip_radius_mm).contains(&pretravel) {
            return Err(bad(Field::PretravelMm, None, pretravel));
        }
    }
    Ok(())
}

fn check_limits(limits: &Limits) -> Result<(), JobError> {
    let all = [
        (limits.radius_error_mm, Field::RadiusErrorMm),
        (limits.rms_mm, Field::RmsMm),
        (limits.distance_error_mm, Field::DistanceErrorMm),
        (limits.registration_rms_mm, Field::RegistrationRmsMm),
        (limits.rotation_deg, Field::RotationDeg),
        (limits.tilt_deg, Field::TiltDeg),
        (limits.approach_deg.unwrap_or(1.0), Field::ApproachDeg),
        (limits.lone_hit_mm.unwrap_or(1.0), Field::LoneHitMm),
        (
            limits.expected_error_mm.unwrap_or(1.0),
            Field::ExpectedErrorMm,
        ),
    ];
    for (value, field) in all {
        positive(value, field, None)?;
    }
    for value in limits.shift_mm {
        positive(value, Field::ShiftMm, None)?;
    }
    Ok(())
}

fn check_witness(job: &Job, witness: &WitnessSpec) -> Result<(), JobError> {
    if job.compensation == Compensation::InMacro {
        return Err(JobError::WitnessCompensation);
    }
    if job.receiver.patterns.iter().any(is_printed_later) {
        return Err(JobError::WitnessPairing);
    }
    all_finite(witness.counts_per_mm, Field::CountsPerMm, None)?;
    if witness.counts_per_mm.contains(&0.0) {
        return Err(bad(Field::CountsPerMm, None, 0.0));
    }
    if let Some(origin) = witness.origin_counts {
        all_finite(origin, Field::OriginCounts, None)?;
    }
    match witness.feed_mm_per_min {
        Some(feed) => positive(feed, Field::FeedMmPerMin, None)?,
        None if job.receiver.patterns.iter().all(says_approach) => {}
        None => {
            return Err(JobError::Missing {
                field: Field::FeedMmPerMin,
                feature: None,
            });
        }
    }
    positive(witness.delay_ms, Field::DelayMs, None)?;
    positive(witness.tolerance_mm, Field::ToleranceMm, None)
}

fn check_reference(job: &Job) -> Result<(), JobError> {
    let mut positions = heapless::Vec::<Point, MAX_DATUMS>::new();
    for (_, feature) in datums(job) {
        let position = feature.position_mm.unwrap_or([f64::NAN; 3]);
        // Bounded: the count of datums was checked.
        let _ = positions.push(Point::from_array_mm(position));
    }
    registration::register(&positions, &positions)
        .map(|_| ())
        .map_err(|_| JobError::DegenerateReference)
}

/// Whether the control's tape code has all that the correction is made of.
fn check_coding(job: &Job, spec: &CorrectionSpec) -> Result<(), JobError> {
    let compares = job.guards.run_variable.is_some();
    let is_carried = spec.send == SendWhen::Never
        || job.receiver.coding != Coding::Eia
        || correction::dialect::eia_carries(spec.dialect, compares);
    is_carried.then_some(()).ok_or(JobError::CodingLacks)
}

fn check_correction(spec: &CorrectionSpec) -> Result<(), JobError> {
    if spec.write_to == spec.probed_in {
        return Err(JobError::SameOffset);
    }
    correction::dialect::check(spec).map_err(|field| {
        let value = match field {
            Field::Set => spec.set.unwrap_or_default(),
            _ => spec.write_to.p_number(),
        };
        bad(field, None, value.into())
    })?;
    all_finite(spec.probed_origin_mm, Field::ProbedOriginMm, None)?;
    // Those are the shipped macros' (`hw/control`): a correction must not take the place of one.
    let is_macro = (8811..=8849).contains(&spec.program_number);
    if is_macro || !(1..=9999).contains(&spec.program_number) {
        let value = f64::from(spec.program_number);
        return Err(bad(Field::ProgramNumber, None, value));
    }
    all_finite(spec.part_min_mm, Field::PartMinMm, None)?;
    all_finite(spec.part_max_mm, Field::PartMaxMm, None)?;
    for (low, high) in spec.part_min_mm.iter().zip(spec.part_max_mm) {
        if *low > high {
            return Err(bad(Field::PartMaxMm, None, high));
        }
    }
    positive(spec.leftover_mm, Field::UncorrectedMm, None)
}

/// Characters that stand safely in a program's comment and in a DPRNT line.
fn is_printable(name: &Name) -> bool {
    !name.is_empty()
        && name
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | ' '))
}

/// No touch scatters less than a nanometre, and none that measures more than a millimetre: its square would leave what the
/// stated error can be worked out of.
const LEAST_SIGMA_MM: f64 = 1e-6;
const MOST_SIGMA_MM: f64 = 1.0;

fn positive(value: f64, field: Field, feature: Option<&Name>) -> Result<(), JobError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(bad(field, feature, value))
    }
}

fn all_finite(values: [f64; 3], field: Field, feature: Option<&Name>) -> Result<(), JobError> {
    values
        .iter()
        .find(|v| !v.is_finite())
        .map_or(Ok(()), |v| Err(bad(field, feature, *v)))
}

fn bad(field: Field, feature: Option<&Name>, value: f64) -> JobError {
    JobError::BadValue {
        field,
        feature: feature.cloned(),
        value,
    }
}

/// Counts in a job are below 256 by the size of its lists.
fn narrow(count: usize) -> u8 {
    u8::try_from(count).unwrap_or(u8::MAX)
}
