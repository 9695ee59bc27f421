//! Figures that a report derives from the records. Each is defined here once
//! and shown alike on the page and in the terminal.

use umi_protocol::feature::{FeatureResult, FitReport, Shape};
use umi_protocol::job::FeatureSpec;
use umi_protocol::verdict::RegistrationReport;

use program::CorrectionMotion;
use umi_client::session::{Session, Setup, Truth};

pub mod program;

pub use crate::vector::{Vector, length, minus, transform};

/// Standard uncertainties of a sphere's centre (x, y, z) and radius, mm:
/// sigma times the square root of the unit covariance's diagonal. None without
/// degrees of freedom or for another geometry.
#[must_use]
pub fn sphere_uncertainty(fit: &FitReport) -> Option<[f64; 4]> {
    let sigma = fit.sigma_mm?;
    match &fit.shape {
        Shape::Sphere { cov_unit, .. } => {
            Some(std::array::from_fn(|i| sigma * cov_unit[i][i].sqrt()))
        }
        _ => None,
    }
}

/// What Sawula 2013 (tables 4.1 and 5.2) prints as "uncertainty of centre":
/// half the standard deviation of the residuals. It is not the uncertainty of
/// the least-squares centre; that is [`sphere_uncertainty`].
#[must_use]
pub fn half_sigma(fit: &FitReport) -> Option<f64> {
    fit.sigma_mm.map(|sigma| sigma / 2.0)
}

/// Fitted less nominal radius, mm.
#[must_use]
pub fn radius_error(spec: Option<&FeatureSpec>, fit: &FitReport) -> Option<f64> {
    Some(fit.shape.radius_mm()? - spec?.radius_mm?)
}

/// The largest residual: hit number from 1, and residual, mm.
#[must_use]
pub fn largest_residual(fit: &FitReport) -> Option<(usize, f64)> {
    (1..)
        .zip(fit.residuals_mm.iter().copied())
        .filter(|(_, d)| d.is_finite())
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
}

/// How far the side hits (approached along X or Y) lie above the fitted
/// sphere's centre, mean, mm. They were driven to the height of the ball's
/// centre, so this shows a wrong Z hit, which leaves no residual.
#[must_use]
pub fn side_hits_above_centre(spec: Option<&FeatureSpec>, feature: &FeatureResult) -> Option<f64> {
    let Some(Shape::Sphere { center_mm, .. }) = feature.fit.as_ref().map(|f| f.shape) else {
        return None;
    };
    let heights: Vec<f64> = spec?
        .approach
        .iter()
        .zip(&feature.points_mm)
        .filter(|(approach, _)| approach.axis_and_sign().0 != 2)
        .map(|(_, p)| p[2] - center_mm[2])
        .collect();
    let mean = heights.iter().sum::<f64>() / count(heights.len());
    mean.is_finite().then_some(mean)
}

#[allow(clippy::cast_precision_loss, reason = "counts of hits and features")]
fn count(n: usize) -> f64 {
    n as f64
}

/// Rotation about Z (of the rotation about Z nearest to R) and angle between
/// the two Z axes, degrees, as the limits of the job mean them.
#[must_use]
pub fn turn_and_tilt_deg(registration: &RegistrationReport) -> (f64, f64) {
    let r = &registration.rotation;
    let turn = (r[1][0] - r[0][1]).atan2(r[0][0] + r[1][1]);
    // atan2 and not acos(R33): acos loses half the digits of a small tilt.
    let tilt = r[0][2].hypot(r[1][2]).atan2(r[2][2]);
    (turn.to_degrees(), tilt.to_degrees())
}

/// Displacement of the datum features' centroid, mm, as the limits mean it.
#[must_use]
pub fn shift_mm(session: &Session, place: usize) -> Option<Vector> {
    let reference = session.reference_mm(place)?;
    let measured = session.setups.get(place)?.positions_mm(&session.job)?;
    let n = count(reference.len());
    Some(std::array::from_fn(|i| {
        reference
            .iter()
            .zip(&measured)
            .map(|(from, to)| to[i] - from[i])
            .sum::<f64>()
            / n
    }))
}

/// Standard uncertainties of the rotation about X, Y and Z, rad.
#[must_use]
pub fn rotation_uncertainty_rad(registration: &RegistrationReport) -> Option<Vector> {
    let sigma = registration.sigma_mm?;
    let cov = &registration.cov_unit_rotvec;
    Some(std::array::from_fn(|i| sigma * cov[i][i].sqrt()))
}

/// A registration against the true pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Small rotation that carries the true orientation into the measured one, rad.
    pub rotation_rad: Vector,
    /// Its angle, rad.
    pub angle_rad: f64,
    /// Difference of the translations (at the frame's origin), mm.
    pub translation_mm: Vector,
}

/// A registration against the true pose.
#[must_use]
pub fn pose_error(registration: &RegistrationReport, truth: &Truth) -> PoseError {
    let (r, u) = (&registration.rotation, &truth.rotation);
    // E = R Uᵀ; its skew part is the rotation vector to first order.
    let e: [Vector; 3] = std::array::from_fn(|i| {
        std::array::from_fn(|j| r[i].iter().zip(&u[j]).map(|(a, b)| a * b).sum())
    });
    let difference: f64 = (0..3).map(|i| length(minus(r[i], u[i])).powi(2)).sum();
    PoseError {
        rotation_rad: [
            (e[2][1] - e[1][2]) / 2.0,
            (e[0][2] - e[2][0]) / 2.0,
            (e[1][0] - e[0][1]) / 2.0,
        ],
        // |R - U| = 2 sqrt(2) sin(angle / 2) for any two rotations.
        angle_rad: 2.0 * (difference / 8.0).sqrt().min(1.0).asin(),
        translation_mm: minus(registration.translation_mm, truth.translation_mm),
    }
}

/// Errors at one point of the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointError {
    /// The point, CAD frame, mm.
    pub point_mm: Vector,
    /// Where the registration puts it, less where it truly is; none without a
    /// true answer.
    pub registration_mm: Option<Vector>,
    /// Where the correction program puts it, less where it truly is (or, without
    /// a true answer, less where the registration puts it).
    pub program_mm: Option<Vector>,
}

/// Errors at the path points; at the part's corners where none are given.
#[must_use]
pub fn point_errors(session: &Session, setup: &Setup) -> Vec<PointError> {
    let Some(registration) = &setup.verdict.registration else {
        return Vec::new();
    };
    let program = motion(session, setup);
    points_of_interest(session)
        .into_iter()
        .map(|p| {
            let found = transform(&registration.rotation, registration.translation_mm, p);
            let truly = setup
                .truth
                .map(|t| transform(&t.rotation, t.translation_mm, p));
            PointError {
                point_mm: p,
                registration_mm: truly.map(|truly| minus(found, truly)),
                program_mm: program.map(|m| minus(m.apply(p), truly.unwrap_or(found))),
            }
        })
        .collect()
}

/// What the setup's correction program does, read from its text.
#[must_use]
pub fn motion(session: &Session, setup: &Setup) -> Option<CorrectionMotion> {
    let correction = setup.verdict.correction.as_ref()?;
    let origin = session.job.correction.as_ref()?.probed_origin_mm;
    CorrectionMotion::read(&correction.text, origin)
}

/// The path points, or the part's upper corners.
#[must_use]
pub fn points_of_interest(session: &Session) -> Vec<Vector> {
    if !session.path_points_mm.is_empty() {
        return session.path_points_mm.clone();
    }
    let Some(outline) = part_outline(session) else {
        return Vec::new();
    };
    outline.to_vec()
}

/// The part's upper corners, counter-clockwise, CAD frame.
#[must_use]
pub fn part_outline(session: &Session) -> Option<[Vector; 4]> {
    let spec = session.job.correction.as_ref()?;
    let ([x0, y0, _], [x1, y1, z]) = (spec.part_min_mm, spec.part_max_mm);
    Some([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
}

/// The largest length in a list of vectors, mm; none if there is none.
pub fn largest(vectors: impl Iterator<Item = Option<Vector>>) -> Option<f64> {
    vectors.flatten().map(length).max_by(f64::total_cmp)
}

/// The largest of a list by magnitude, with its sign.
pub fn extreme(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.max_by(|a, b| a.abs().total_cmp(&b.abs()))
}

/// Errors of the distances between datum positions, where there is a reference.
pub fn distance_errors(setup: &Setup) -> impl Iterator<Item = f64> {
    setup
        .verdict
        .distances
        .iter()
        .filter_map(|d| Some(d.measured_mm - d.reference_mm?))
}

/// The latest result of each feature of the job, in the job's order.
pub fn in_job_order<'a>(
    session: &'a Session,
    setup: &'a Setup,
) -> impl Iterator<Item = (&'a FeatureSpec, Option<&'a FeatureResult>)> {
    session
        .job
        .features
        .iter()
        .map(|spec| (spec, setup.feature(&spec.name)))
}
