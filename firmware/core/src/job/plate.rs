//! One plate (one clamping): measured positions against the reference, every
//! limit, the verdict, and the correction that an OK verdict clears.

use heapless::Vec;
use nalgebra::{Matrix3, Vector3};
use umi_protocol::feature::Matrix3 as Rows;
use umi_protocol::job::{CorrectionSpec, Job, Limits, MAX_DATUMS, Name};
use umi_protocol::reason::Reason;
use umi_protocol::verdict::{
    CorrectionReport, DistanceReport, MAX_DISTANCES, PlateReason, RegistrationReport, Verdict,
};

use super::check::datums;
use super::exceeds;
use super::report::refusal;
use crate::nc;
use crate::registration::{self, Registration};
use crate::units::Point;

/// Positions of the datum features, in the job's order.
pub type Positions = Vec<Point, MAX_DATUMS>;

/// Keeps a reason about the plate as a whole.
pub fn add(verdict: &mut Verdict, reason: Reason) {
    add_about(verdict, None, reason);
}

/// Keeps a reason; those without room are counted.
pub fn add_about(verdict: &mut Verdict, feature: Option<&Name>, reason: Reason) {
    let reason = PlateReason {
        feature: feature.cloned(),
        reason,
    };
    if !verdict.reasons.contains(&reason) && verdict.reasons.push(reason).is_err() {
        verdict.reasons_dropped = verdict.reasons_dropped.saturating_add(1);
    }
}

/// An empty verdict on a plate: NG until [`conclude`] finds nothing against it.
pub fn blank(plate: u32) -> Verdict {
    Verdict {
        plate,
        ok: false,
        reasons: Vec::new(),
        reasons_dropped: 0,
        remarks: Vec::new(),
        distances: Vec::new(),
        registration: None,
        correction: None,
    }
}

/// Judges a plate whose features are all good, against `reference`.
pub fn judge(verdict: &mut Verdict, job: &Job, reference: &[Point], measured: &[Point]) {
    verdict.distances = distances(job, Some(reference), measured);
    if measured.len() < 3 {
        // A job that only measures: nothing to register.
        distance_reasons(verdict, job);
        conclude(verdict, job, None);
        return;
    }
    distance_reasons(verdict, job);
    let pose = match registration::register(reference, measured) {
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
    let report = registration_report(job.correction.as_ref(), &pose, reference, measured);
    if let (Some(error_mm), Some(limit_mm)) =
        (report.expected_error_mm, job.limits.expected_error_mm)
        && exceeds(error_mm, limit_mm)
    {
        add(verdict, Reason::ExpectedError { error_mm, limit_mm });
    }
    verdict.registration = Some(report);
    conclude(verdict, job, Some(&pose));
}

/// Judges the plate that is taught: it has nothing to be compared with but
/// itself, so its features alone decide.
pub fn judge_taught(verdict: &mut Verdict, job: &Job, measured: &[Point]) {
    verdict.distances = distances(job, None, measured);
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
    conclude(verdict, job, None);
}

/// The last step: plans the correction, and lets the verdict be OK if there is
/// no reason against it. Only then is the program written.
fn conclude(verdict: &mut Verdict, job: &Job, pose: Option<&Pose>) {
    let mut planned = None;
    if let (Some(spec), Some(pose)) = (job.correction.as_ref(), pose) {
        match nc::plan(spec, &pose.registration.transform) {
            Ok(plan) if plan.leftover.0 <= spec.leftover_mm => planned = Some((spec, plan, pose)),
            Ok(plan) => add(
                verdict,
                Reason::Leftover {
                    error_mm: plan.leftover.0,
                    limit_mm: spec.leftover_mm,
                },
            ),
            Err(nc::NotExpressible) => add(verdict, Reason::NotExpressible),
        }
    }
    let against = verdict.reasons.len() + usize::from(verdict.reasons_dropped);
    let Some(cleared) = nc::Cleared::if_no_reasons(against) else {
        return;
    };
    if let Some((spec, plan, pose)) = planned {
        let figures = nc::Figures {
            job: &job.name,
            plate: verdict.plate,
            rms_mm: pose.registration.stats.rms.0,
            turn_deg: pose.turn_deg,
            tilt_deg: pose.tilt_deg,
        };
        match nc::write(&cleared, spec, &plan, &figures) {
            Ok(text) => {
                verdict.correction = Some(CorrectionReport {
                    dialect: spec.dialect,
                    text,
                    leftover_mm: plan.leftover.0,
                });
            }
            Err(nc::NotExpressible) => {
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

/// Distances between all pairs of datum positions: the plate check. It needs
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

fn distance_reasons(verdict: &mut Verdict, job: &Job) {
    let limit_mm = job.limits.distance_error_mm;
    let pairs = verdict.distances.clone();
    for pair in pairs {
        let Some(reference_mm) = pair.reference_mm else {
            continue;
        };
        let error_mm = pair.measured_mm - reference_mm;
        if exceeds(error_mm.abs(), limit_mm) {
            add(
                verdict,
                Reason::DistanceError {
                    a: pair.a,
                    b: pair.b,
                    error_mm,
                    limit_mm,
                },
            );
        }
    }
}

/// The one pair of features whose exchange would make everything right. Balls
/// at one height and legs of one length leave no residual when exchanged: the
/// plate then seems turned over, and only the limits on the pose show it.
fn exchanged(job: &Job, reference: &[Point], measured: &[Point]) -> Option<(Name, Name)> {
    let mut found = None;
    for at in 0..measured.len() {
        for other in at + 1..measured.len() {
            let mut trial: Positions = measured.iter().copied().collect();
            trial.swap(at, other);
            let mut scratch = blank(0);
            scratch.distances = distances(job, Some(reference), &trial);
            distance_reasons(&mut scratch, job);
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
    spec: Option<&CorrectionSpec>,
    pose: &Pose,
    reference: &[Point],
    measured: &[Point],
) -> RegistrationReport {
    let fit = &pose.registration;
    let residuals_mm = reference
        .iter()
        .zip(measured)
        .map(|(from, to)| fit.residual_mm(*from, *to).into())
        .collect();
    let expected_error_mm = spec.and_then(|spec| {
        let (min, max) = (spec.part_min_mm.into(), spec.part_max_mm.into());
        let mut worst: Option<f64> = None;
        for corner in nc::corners(&min, &max) {
            let error = fit.expected_error_at(Point { mm: corner })?.0;
            worst = Some(worst.map_or(error, |most| most.max(error)));
        }
        worst
    });
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
