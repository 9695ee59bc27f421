//! One setup (one clamping): measured positions against the reference, every
//! limit, the verdict, and the correction that an OK verdict clears.

use heapless::Vec;
use nalgebra::{Matrix3, Vector3};
use umi_protocol::feature::Matrix3 as Rows;
use umi_protocol::job::{
    Closing, CorrectionSpec, Guards, Job, Limits, MAX_DATUMS, Name, WorkOffset,
};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::{
    CorrectionReport, DistanceReport, MAX_DISTANCES, RegistrationReport, SetupReason, Verdict,
};

use super::check::datums;
use super::exceeds;
use super::report::refusal;
use super::scatter::Scatter;
use crate::correction;
use crate::dprnt::Moved;
use crate::registration::{self, Registration};
use crate::units::Point;

/// Positions of the datum features, in the job's order.
pub type DatumPoints = Vec<Point, MAX_DATUMS>;

/// Keeps a reason about the setup as a whole.
pub fn add(verdict: &mut Verdict, reason: Reason) {
    add_about(verdict, None, reason);
}

/// Keeps a reason; those without room are counted.
pub fn add_about(verdict: &mut Verdict, feature: Option<&Name>, reason: Reason) {
    let reason = SetupReason {
        feature: feature.cloned(),
        reason,
    };
    if !verdict.reasons.contains(&reason) && verdict.reasons.push(reason).is_err() {
        verdict.reasons_dropped = verdict.reasons_dropped.saturating_add(1);
    }
}

/// An empty verdict on a setup: NG until [`conclude`] finds nothing against it.
pub fn blank(setup: u32) -> Verdict {
    Verdict {
        setup,
        ok: false,
        reasons: Vec::new(),
        reasons_dropped: 0,
        remarks: Vec::new(),
        distances: Vec::new(),
        registration: None,
        correction: None,
    }
}

/// Judges a setup whose features are all good, against `reference`.
///
/// Both hold the datum places, and may hold others behind them. `scatter` is known where the
/// job states a probing sigma, `run` where the lines do.
pub fn judge(
    verdict: &mut Verdict,
    job: &Job,
    reference: &[Point],
    measured: &[Point],
    scatter: Option<&Scatter>,
    run: Option<u32>,
) {
    let due = datums(job).count();
    let (Some(reference), Some(measured)) = (reference.get(..due), measured.get(..due)) else {
        // A restored reference has as many places; none without them is judged.
        return add(verdict, Reason::NoReference);
    };
    verdict.distances = distances(job, Some(reference), measured);
    nominal_reasons(verdict, job);
    let mut scaled = DatumPoints::new();
    let warmer = warmth(verdict, job, reference, scatter, &mut scaled);
    let reference = if warmer.is_some() { &scaled } else { reference };
    distance_reasons(verdict, job, &distances(job, Some(reference), measured));
    if measured.len() < 3 {
        // A job that only measures: nothing to register.
        conclude(verdict, job, None, run);
        return;
    }
    let mut pose = match registration::register(reference, measured) {
        Ok(registration) => Pose::new(registration, reference, measured),
        Err(error) => {
            add(
                verdict,
                Reason::RegistrationRefused {
                    code: refusal(&error),
                },
            );
            return;
        }
    };
    pose_reasons(verdict, &job.limits, &pose);
    if !verdict.reasons.is_empty()
        && let Some((a, b)) = exchanged(job, reference, measured)
    {
        add(verdict, Reason::SuspectExchange { a, b });
    }
    if let (Some(scale), Some(spec)) = (warmer, &job.correction) {
        growth_reasons(verdict, job, spec, scale);
    }
    let mut report = registration_report(verdict, job, &pose, reference, measured, scatter, warmer);
    if let (Some(scale), Some(spec)) = (warmer, &job.correction) {
        let arm = middle(spec) - centroid(reference);
        let grown = pose.registration.transform.rotation * arm * scale;
        pose.registration.transform.translation_mm += grown;
    }
    report.translation_mm = pose.registration.transform.translation_mm.into();
    if let (Some(error_mm), Some(limit_mm)) =
        (report.expected_error_mm, job.limits.expected_error_mm)
        && exceeds(error_mm, limit_mm)
    {
        add(verdict, Reason::ExpectedError { error_mm, limit_mm });
    }
    verdict.registration = Some(report);
    conclude(verdict, job, Some(&pose), run);
}

/// Judges the setup that is taught: it has nothing to be compared with but
/// itself, so its features alone decide.
pub fn judge_taught(verdict: &mut Verdict, job: &Job, measured: &[Point]) {
    let measured = measured.get(..datums(job).count()).unwrap_or_default();
    verdict.distances = distances(job, None, measured);
    nominal_reasons(verdict, job);
    if measured.len() >= 3
        && let Err(error) = registration::register(measured, measured)
    {
        add(
            verdict,
            Reason::RegistrationRefused {
                code: refusal(&error),
            },
        );
    }
    conclude(verdict, job, None, None);
}

/// Holds what a run says of its work offset against what the correction rests on: the
/// correction moves that offset from where the job says it is.
pub fn against_frame(
    verdict: &mut Verdict,
    spec: Option<&CorrectionSpec>,
    offset: u16,
    origin: Point,
) {
    let expected = match spec.map_or(WorkOffset::G54, |spec| spec.probed_in) {
        WorkOffset::Extended(number) => number.saturating_add(100),
        standard => standard.p_number(),
    };
    if offset != expected {
        let got = offset;
        return add(verdict, Reason::OtherOffset { got, expected });
    }
    let Some(spec) = spec else {
        return;
    };
    let values = origin.to_array_mm().into_iter().zip(spec.probed_origin_mm);
    for (axis, (got_mm, expected_mm)) in (0u8..).zip(values) {
        if exceeds((got_mm - expected_mm).abs(), PRINTED_MM) {
            add(
                verdict,
                Reason::OffsetChanged {
                    axis,
                    got_mm,
                    expected_mm,
                },
            );
        }
    }
}

/// Holds what else moves a run's coordinates against the job. Without guards, an external offset
/// moves programs as it has moved the probe.
pub fn against_moved(verdict: &mut Verdict, guards: Option<&Guards>, moved: &Moved) {
    if moved.is_rotated {
        add(verdict, Reason::RotationActive);
    }
    let Some(guards) = guards else {
        return;
    };
    let values = moved.external.to_array_mm().into_iter();
    for (axis, (got_mm, expected_mm)) in (0u8..).zip(values.zip(guards.external_mm)) {
        if exceeds((got_mm - expected_mm).abs(), PRINTED_MM) {
            add(
                verdict,
                Reason::ExternalOffset {
                    axis,
                    got_mm,
                    expected_mm,
                },
            );
        }
    }
}

/// Holds the tool length in force against the job's, or else against that of the taught setup.
pub fn against_length(verdict: &mut Verdict, guards: &Guards, taught_mm: Option<f64>, got_mm: f64) {
    let differs = |from_mm: f64, by_mm: f64| exceeds((got_mm - from_mm).abs(), by_mm);
    match (guards.tool_length_mm, taught_mm) {
        (Some(expected_mm), _) if differs(expected_mm, PRINTED_MM) => add(
            verdict,
            Reason::ToolLength {
                got_mm,
                expected_mm,
            },
        ),
        // That was printed, too.
        (None, Some(taught_mm)) if differs(taught_mm, 2.0 * PRINTED_MM) => {
            add(verdict, Reason::ToolLengthSinceTaught { got_mm, taught_mm });
        }
        _ => {}
    }
}

/// Holds by what a run's coordinates lie elsewhere than its offsets say: by nothing.
pub fn against_shift(verdict: &mut Verdict, by: Point) {
    for (axis, got_mm) in (0u8..).zip(by.to_array_mm()) {
        if exceeds(got_mm.abs(), SHIFT_MM) {
            add(verdict, Reason::Shifted { axis, got_mm });
        }
    }
}

/// Two positions, an offset and an external offset, each rounded to 0.001 mm, and as printed.
const SHIFT_MM: f64 = 4.0 * 0.0005 + PRINTED_MM;

/// Half the last digit that a macro prints (`[53]`), and what rounding in decimals needs.
const PRINTED_MM: f64 = 0.000_501;

/// Holds a feature that was probed twice against itself.
pub fn against_closing(verdict: &mut Verdict, closing: &Closing, first: Point, again: Point) {
    let off_mm = (again.mm - first.mm).norm();
    if exceeds(off_mm, closing.within_mm) {
        add_about(
            verdict,
            Some(&closing.feature),
            Reason::NotClosed {
                name: closing.repeats.clone(),
                off_mm,
                limit_mm: closing.within_mm,
            },
        );
    }
}

/// Holds what stays on the table against where it was when the reference was taught.
pub fn against_fixed(verdict: &mut Verdict, limit_mm: f64, name: &Name, taught: Point, now: Point) {
    let off = now.mm - taught.mm;
    if exceeds(off.norm(), limit_mm) {
        let off_mm = off.into();
        add_about(verdict, Some(name), Reason::FixedMoved { off_mm, limit_mm });
    }
}

/// Holds the distances between datum places against those that the job states.
fn nominal_reasons(verdict: &mut Verdict, job: &Job) {
    let Some(limit_mm) = job.guards.nominal_distance_mm else {
        return;
    };
    let nominal = |name: &Name| {
        let feature = job.features.iter().find(|feature| feature.name == *name)?;
        feature.position_mm.map(Vector3::from)
    };
    for pair in verdict.distances.clone() {
        let (Some(a), Some(b)) = (nominal(&pair.a), nominal(&pair.b)) else {
            continue;
        };
        let error_mm = pair.measured_mm - (a - b).norm();
        if exceeds(error_mm.abs(), limit_mm) {
            add(
                verdict,
                Reason::NominalDistance {
                    a: pair.a,
                    b: pair.b,
                    error_mm,
                    limit_mm,
                },
            );
        }
    }
}

/// What a rigid correction leaves of a warm part's growth. A known error of each corner: the
/// part grows about its middle, which the correction takes along.
fn growth_reasons(verdict: &mut Verdict, job: &Job, spec: &CorrectionSpec, scale: f64) {
    let leftover_mm = spec.leftover_mm;
    let limit_mm = (job.limits.expected_error_mm).map_or(leftover_mm, |mm| mm.min(leftover_mm));
    let grown_mm = left_at_corners(spec, scale);
    if exceeds(grown_mm, limit_mm) {
        add(verdict, Reason::PartGrown { grown_mm, limit_mm });
    } else {
        add_remark(verdict, Reason::GrowthLeft { grown_mm });
    }
}

/// By how much each corner of a part that has grown moves against its middle.
fn left_at_corners(spec: &CorrectionSpec, scale: f64) -> f64 {
    let diagonal = Vector3::from(spec.part_max_mm) - Vector3::from(spec.part_min_mm);
    libm::fabs(scale) * 0.5 * diagonal.norm()
}

fn middle(spec: &CorrectionSpec) -> Vector3<f64> {
    (Vector3::from(spec.part_min_mm) + Vector3::from(spec.part_max_mm)) * 0.5
}

fn centroid(places: &[Point]) -> Vector3<f64> {
    let count = f64::from(u8::try_from(places.len()).unwrap_or(u8::MAX));
    places.iter().map(|p| p.mm).sum::<Vector3<f64>>() / count
}

/// Tells how much warmer than taught the part is, and whether that is allowed: then `scaled`
/// is the reference as it is when so warm, and the scale's excess over 1 is given.
///
/// One scale, fitted to the distances by least squares. The registration's rotation and its
/// place at the centroid are the same with it and without it, because the reference is scaled
/// about its centroid; only the residuals lose what the warmth has put into them. The part has
/// grown with its balls, so its middle lies that much farther from the centroid: the translation
/// takes it along, and what a rigid correction leaves is the growth of the part itself.
fn warmth(
    verdict: &mut Verdict,
    job: &Job,
    reference: &[Point],
    scatter: Option<&Scatter>,
    scaled: &mut DatumPoints,
) -> Option<f64> {
    let spec = job.guards.warmth?;
    let (mut along, mut square) = (0.0, 0.0);
    for pair in &verdict.distances {
        let nominal = pair.reference_mm.unwrap_or(f64::NAN);
        along += nominal * (pair.measured_mm - nominal);
        square += nominal * nominal;
    }
    let scale = along / square;
    let per_kelvin = spec.expansion_ppm_per_k * 1e-6;
    let kelvin = scale / per_kelvin;
    if exceeds(kelvin.abs(), spec.at_most_k) {
        let limit_k = spec.at_most_k;
        add(verdict, Reason::TooWarm { kelvin, limit_k });
        return None;
    }
    let sigma_k = scatter.map_or(0.0, |scatter| scatter.scale_sigma(reference)) / per_kelvin;
    add_remark(verdict, Reason::Warmer { kelvin, sigma_k });
    let centroid = centroid(reference);
    for place in reference {
        let mm = centroid + (place.mm - centroid) * (1.0 + scale);
        // Bounded: it is as long as the reference.
        let _ = scaled.push(Point { mm });
    }
    Some(scale)
}

/// Keeps what was noticed and changes nothing.
pub fn add_remark(verdict: &mut Verdict, reason: Reason) {
    // Remarks beyond the room are dropped: they change nothing.
    let _ = verdict.remarks.push(SetupReason {
        feature: None,
        reason,
    });
}

/// The last step: plans the correction, and lets the verdict be OK if there is
/// no reason against it. Only then is the program written.
fn conclude(verdict: &mut Verdict, job: &Job, pose: Option<&Pose>, run: Option<u32>) {
    let mut planned = None;
    if let (Some(spec), Some(pose)) = (job.correction.as_ref(), pose) {
        match correction::plan(spec, &pose.registration.transform) {
            Ok(plan) if plan.uncorrected.0 <= spec.leftover_mm => {
                planned = Some((spec, plan, pose))
            }
            Ok(plan) => add(
                verdict,
                Reason::Uncorrected {
                    error_mm: plan.uncorrected.0,
                    limit_mm: spec.leftover_mm,
                },
            ),
            Err(correction::NotExpressible) => add(verdict, Reason::NotExpressible),
        }
    }
    let against = verdict.reasons.len() + usize::from(verdict.reasons_dropped);
    let Some(cleared) = correction::Cleared::if_no_reasons(against) else {
        return;
    };
    if let Some((spec, plan, pose)) = planned {
        let figures = correction::Figures {
            job: &job.name,
            setup: verdict.setup,
            rms_mm: pose.registration.stats.rms.0,
            turn_deg: pose.turn_deg,
            tilt_deg: pose.tilt_deg,
            run: job.guards.run_variable.zip(run),
        };
        match correction::write(&cleared, spec, &plan, &figures) {
            Ok(text) => {
                verdict.correction = Some(CorrectionReport {
                    dialect: spec.dialect,
                    text,
                    leftover_mm: plan.uncorrected.0,
                });
            }
            Err(correction::NotExpressible) => {
                add(verdict, Reason::NotExpressible);
                return;
            }
        }
    }
    verdict.ok = true;
}

/// A registration with the angles that a machinist sees.
struct Pose {
    registration: Registration,
    /// Rotation about Z, degrees: of the rotation about Z nearest to R.
    turn_deg: f64,
    /// Angle between the two Z axes, degrees.
    tilt_deg: f64,
    /// Displacement of the datum features' centroid. The translation itself
    /// is that of a far-off origin and grows with every rotation.
    shift_mm: Vector3<f64>,
}

impl Pose {
    fn new(registration: Registration, reference: &[Point], measured: &[Point]) -> Self {
        let (turn_deg, tilt_deg) = registration.transform.turn_and_tilt_deg();
        let count = f64::from(u8::try_from(reference.len()).unwrap_or(u8::MAX));
        let mut shift = Vector3::zeros();
        for (from, to) in reference.iter().zip(measured) {
            shift += to.mm - from.mm;
        }
        Self {
            turn_deg,
            tilt_deg,
            shift_mm: shift / count,
            registration,
        }
    }
}

fn pose_reasons(verdict: &mut Verdict, limits: &Limits, pose: &Pose) {
    let rms_mm = pose.registration.stats.rms.0;
    if exceeds(rms_mm, limits.registration_rms_mm) {
        let limit_mm = limits.registration_rms_mm;
        add(verdict, Reason::RegistrationRms { rms_mm, limit_mm });
    }
    if exceeds(pose.turn_deg.abs(), limits.rotation_deg) {
        let (angle_deg, limit_deg) = (pose.turn_deg, limits.rotation_deg);
        add(
            verdict,
            Reason::Rotation {
                angle_deg,
                limit_deg,
            },
        );
    }
    if exceeds(pose.tilt_deg, limits.tilt_deg) {
        let (angle_deg, limit_deg) = (pose.tilt_deg, limits.tilt_deg);
        add(
            verdict,
            Reason::Tilt {
                angle_deg,
                limit_deg,
            },
        );
    }
    for (axis, (shift_mm, limit_mm)) in
        (0u8..).zip(pose.shift_mm.iter().copied().zip(limits.shift_mm))
    {
        if exceeds(shift_mm.abs(), limit_mm) {
            add(
                verdict,
                Reason::Shift {
                    axis,
                    shift_mm,
                    limit_mm,
                },
            );
        }
    }
}

/// Distances between all pairs of datum positions. It needs
/// no registration and sees what a registration averages away.
fn distances(
    job: &Job,
    reference: Option<&[Point]>,
    measured: &[Point],
) -> Vec<DistanceReport, MAX_DISTANCES> {
    let mut reports = Vec::new();
    let Ok(pairs) = registration::distances(reference.unwrap_or(measured), measured) else {
        return reports;
    };
    for pair in pairs {
        let (Some(a), Some(b)) = (datum_name(job, pair.first), datum_name(job, pair.second)) else {
            continue;
        };
        // Bounded: the list holds all pairs of the most datums.
        let _ = reports.push(DistanceReport {
            a,
            b,
            measured_mm: pair.measured.0,
            reference_mm: reference.map(|_| pair.nominal.0),
        });
    }
    reports
}

/// Name of a datum feature, by its place among the datum features.
fn datum_name(job: &Job, place: usize) -> Option<Name> {
    datums(job)
        .nth(place)
        .map(|(_, feature)| feature.name.clone())
}

fn distance_reasons(verdict: &mut Verdict, job: &Job, pairs: &[DistanceReport]) {
    let limit_mm = job.limits.distance_error_mm;
    for pair in pairs {
        let Some(reference_mm) = pair.reference_mm else {
            continue;
        };
        let error_mm = pair.measured_mm - reference_mm;
        if exceeds(error_mm.abs(), limit_mm) {
            add(
                verdict,
                Reason::DistanceError {
                    a: pair.a.clone(),
                    b: pair.b.clone(),
                    error_mm,
                    limit_mm,
                },
            );
        }
    }
}

/// The one pair of features whose exchange would make everything right. Balls
/// at one height and legs of one length leave no residual when exchanged: the
/// setup then seems turned over, and only the limits on the pose show it.
fn exchanged(job: &Job, reference: &[Point], measured: &[Point]) -> Option<(Name, Name)> {
    let mut found = None;
    for at in 0..measured.len() {
        for other in at + 1..measured.len() {
            let mut trial: DatumPoints = measured.iter().copied().collect();
            trial.swap(at, other);
            let mut scratch = blank(0);
            distance_reasons(&mut scratch, job, &distances(job, Some(reference), &trial));
            let Ok(registration) = registration::register(reference, &trial) else {
                continue;
            };
            let pose = Pose::new(registration, reference, &trial);
            pose_reasons(&mut scratch, &job.limits, &pose);
            if scratch.reasons.is_empty() {
                if found.is_some() {
                    return None;
                }
                found = datum_name(job, at).zip(datum_name(job, other));
            }
        }
    }
    found
}

fn registration_report(
    verdict: &mut Verdict,
    job: &Job,
    pose: &Pose,
    reference: &[Point],
    measured: &[Point],
    scatter: Option<&Scatter>,
    scale: Option<f64>,
) -> RegistrationReport {
    let fit = &pose.registration;
    let spec = job.correction.as_ref();
    let residuals_mm = reference
        .iter()
        .zip(measured)
        .map(|(from, to)| fit.residual_mm(*from, *to).into())
        .collect();
    let honest = scatter
        .zip(spec)
        .and_then(|(scatter, spec)| scatter.expected(fit, measured, spec, scale));
    if let Some(expected) = honest {
        let error_mm = expected.error_95_mm;
        add_remark(verdict, Reason::Error95 { error_mm });
    }
    let from_residuals = || {
        let spec = spec?;
        let (min, max) = (spec.part_min_mm.into(), spec.part_max_mm.into());
        let mut worst: Option<f64> = None;
        for corner in correction::corners(&min, &max) {
            let scatter_mm = fit.expected_error_at(Point { mm: corner })?.0;
            let left_mm = scale.map_or(0.0, |scale| left_at_corners(spec, scale));
            let error = libm::sqrt(scatter_mm * scatter_mm + left_mm * left_mm);
            worst = Some(worst.map_or(error, |most| most.max(error)));
        }
        worst
    };
    let expected_error_mm = honest.map_or_else(from_residuals, |honest| Some(honest.rms_mm));
    RegistrationReport {
        rotation: rows(&fit.transform.rotation),
        translation_mm: fit.transform.translation_mm.into(),
        angle_deg: fit.angle.to_degrees(),
        axis: fit.axis.map_or([0.0, 0.0, 1.0], Into::into),
        dof: u32::try_from(fit.stats.dof).unwrap_or(u32::MAX),
        rms_mm: fit.stats.rms.0,
        sigma_mm: fit.stats.sigma.map(|s| s.0),
        residuals_mm,
        cov_unit_rotvec: fit.cov_unit_rotvec,
        cov_unit_t: fit.cov_unit_at(Point::from_mm(0.0, 0.0, 0.0)),
        expected_error_mm,
    }
}

/// A matrix by rows (nalgebra stores columns).
fn rows(matrix: &Matrix3<f64>) -> Rows {
    matrix.transpose().into()
}
