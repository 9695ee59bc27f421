//! Why there is no mount, and what is said beside one.

use nalgebra::{DMatrix, DVector};
use umi_kinematics::Pose;

use super::lines::numbers_over;
use super::model::MountModel;
use super::{Artefact, SensorOptions, distance, rivals};
use crate::ScanError;
use crate::calibrate::features::SampleSights;
use crate::calibrate::misfit::Misfit;
use crate::calibrate::naming::{name_directions, open_in_words};
use crate::calibrate::solve::scatter::left_of_column;
use crate::calibrate::solve::{MOST_NOISE_MM, Model as _, Solution, descend};
use crate::rigid::rotation_vector;

/// A standard uncertainty above this is no calibration: 1 mm, 1 mrad.
const MOST_UNCERTAIN: [f64; 2] = [1e-3, 1.0];
/// Unknowns of the mount, by their names.
const NAMES: [&str; 6] = ["wx", "wy", "wz", "tx", "ty", "tz"];
/// What a radian of the mount is worth beside a millimetre.
pub(super) const REACH_MM: f64 = 100.0;

/// What the residuals say of a stated radius, where they want another one clearly.
pub(super) fn radius_wanted(
    solution: &Solution<MountModel<'_>>,
    options: &SensorOptions,
) -> Option<String> {
    /// Standard uncertainties by which it must be off.
    const CLEARLY: f64 = 5.0;
    /// What a certificate leaves open.
    const LEAST_MM: f64 = 0.001;
    /// Where the other unknowns leave less of its column, the radius is not determined: balls that are cut alike at all
    /// poses, whose distance from the laser's plane takes its place.
    const LEAST_LEFT: f64 = 1e-4;
    let stated = options
        .radius_mm
        .filter(|_| options.on == Artefact::Sphere)?;
    let mut model = solution.model.clone();
    model.radius_free = true;
    let (nuisances, targets) = model.unknowns();
    let dof = model
        .residuals()
        .checked_sub(nuisances + targets)
        .filter(|dof| *dof > 0)?;
    let (whole, left) = left_of_column(&model, nuisances - 1);
    let ssq = descend(&mut model, 60);
    let sigma_mm = (ssq / dof as f64).sqrt();
    // Noise within the laser's plane changes the distance from a ball by the less the larger that is: so the sum of squares
    // falls by 2 n / R for each mm of radius, whatever the radius is. That must be nothing beside what the data say of it.
    let by_noise = 2.0 * model.residuals() as f64 * sigma_mm / stated;
    if left <= by_noise.max(LEAST_LEFT * whole) {
        return None;
    }
    let off = model.radius_mm - stated;
    let u_mm = sigma_mm / left;
    // What the radius alone gains is (off / u)² sigma².
    let gained = (solution.ssq - ssq) / (ssq / dof as f64).max(1e-18);
    let is_off = off.abs() > LEAST_MM.max(CLEARLY * u_mm);
    (is_off && gained > CLEARLY * CLEARLY).then(|| {
        format!(
            "radius: the residuals want a radius of {:.4} mm, not {stated} mm ({:.0} standard \
             uncertainties off)",
            model.radius_mm,
            gained.sqrt()
        )
    })
}

/// A mount as far as this from where it was said to be is another one: a ball seen in a mirror fits as
/// well, half a turn away.
pub(super) fn refuse_far(mount: &Pose, start: &Pose) -> Result<(), ScanError> {
    const MOST_TURN_DEG: f64 = 30.0;
    const MOST_SHIFT_MM: f64 = 200.0;
    let turn = rotation_vector(&(mount.rotation * start.rotation.transpose()));
    let turn_deg = turn.norm().to_degrees();
    let shift_mm = (mount.translation_mm - start.translation_mm).norm();
    if turn_deg <= MOST_TURN_DEG && shift_mm <= MOST_SHIFT_MM {
        return Ok(());
    }
    Err(ScanError::refused(
        "far_from_start",
        format_args!(
            "the mount that fits is turned by {turn_deg:.1}° and shifted by {shift_mm:.1} mm from \
             [sensor] of the machine file, which must be right within 6° and 20 mm: look whether x \
             of the profiles runs the other way, or measure the sensor's place again"
        ),
    )
    .with("turn_deg", turn_deg)
    .with("shift_mm", shift_mm))
}

/// The warning, where the first guess was not as near as it is asked for: the search looks no farther than that.
pub(super) fn farther_than_asked(mount: &Pose, start: &Pose) -> Option<String> {
    if rivals::is_within(mount, start, rivals::CLEARLY_FARTHER) {
        return None;
    }
    let (shift_mm, turn_deg) = distance::apart(mount, start);
    let (most_mm, most_deg) = rivals::GUESS;
    Some(format!(
        "far_from_start: the mount is turned by {turn_deg:.1}° and shifted by {shift_mm:.1} mm from [sensor] of the machine file, \
         which must be right within {most_deg}° and {most_mm} mm. Farther off the search may find another mount that fits less \
         well. Measure the sensor's place again, put it into [sensor] and calibrate once more: the answer must stay the same"
    ))
}

/// Poses that no mount brings together give no mount, however well they would determine it.
pub(super) fn refuse_apart(solution: &Solution<MountModel<'_>>) -> Result<(), ScanError> {
    let sigma_mm = solution.sigma_mm();
    if sigma_mm <= MOST_NOISE_MM {
        return Ok(());
    }
    Err(ScanError::refused(
        "no_convergence",
        format_args!(
            "no mount near the first guess brings the poses together: the best leaves {sigma_mm:.2} mm. Look whether an axis \
             counts the other way than the machine file says, at the axes' zeros and order, and at [sensor], which must be \
             right within 6° and 20 mm"
        ),
    )
    .with("sigma_mm", sigma_mm))
}

/// A cut through a ball shows three numbers: its middle, and by its radius how far the ball is from the laser's plane, but not
/// on which side. So cuts that show just as many numbers as are sought fit several mounts exactly, and none tells them apart.
pub(super) fn refuse_few_profiles(model: &MountModel<'_>) -> Result<(), ScanError> {
    if !matches!(model.features.first(), Some(SampleSights::Ball { .. })) {
        return refuse_few_lines(model);
    }
    let mut cuts: Vec<(usize, &Pose)> = Vec::new();
    let (nuisances, targets) = model.unknowns();
    let unknowns = nuisances + targets;
    for seen in &model.all.points {
        let cut = (seen.feature, &model.all.flanges[seen.flange]);
        if !cuts.contains(&cut) {
            cuts.push(cut);
        }
        if 3 * cuts.len() > unknowns {
            return Ok(());
        }
    }
    Err(ScanError::refused(
        "uncertain",
        format_args!(
            "{} poses cut balls: each shows three numbers, for {unknowns} unknowns, and not on which side of the laser's plane \
             the ball is. Several mounts fit exactly: take profiles at {} poses or more",
            cuts.len(),
            unknowns / 3 + 1
        ),
    ))
}

/// A profile of a plane is a line, which shows two numbers. Profiles that show no more numbers than are sought fit several mounts
/// exactly; of those that show a few more other mounts are looked for ([`rivals`]).
fn refuse_few_lines(model: &MountModel<'_>) -> Result<(), ScanError> {
    const LEAST_OVER: i64 = 1;
    let (over, profiles) = numbers_over(model);
    if over >= LEAST_OVER {
        return Ok(());
    }
    let (nuisances, targets) = model.unknowns();
    let unknowns = nuisances + targets;
    let wanted = (unknowns + LEAST_OVER as usize).div_ceil(2);
    Err(ScanError::refused(
        "uncertain",
        format_args!(
            "{profiles} profiles of planes differ. Each is a line and shows two numbers, fewer where no rotary axis moved between \
             them, for {unknowns} unknowns. So few fit several mounts. Take {} profiles or more, each with the rotary axes at \
             other angles",
            wanted.max(profiles + 1)
        ),
    ))
}

/// What few profiles of planes leave unsaid: with errors of the axes they fit as well, at another mount.
pub(super) fn few_lines(model: &MountModel<'_>) -> Option<String> {
    /// From so many numbers over on, errors of the axes show (of 400 sets with errors of 5 to 20 um none was silent).
    const ENOUGH: i64 = 12;
    if !matches!(model.features.first(), Some(SampleSights::Plane { .. })) {
        return None;
    }
    let (over, profiles) = numbers_over(model);
    let more = (ENOUGH - over + 1) / 2;
    (over < ENOUGH).then(|| {
        format!(
            "few_profiles: {profiles} profiles show {over} numbers more than is sought. Errors of the axes do not show by so few, and \
             no uncertainty here holds them: take {more} profiles more, at other angles"
        )
    })
}

pub(super) fn refuse_unseen(
    solution: &Solution<MountModel<'_>>,
    scale: &[f64],
    give_centres: &str,
) -> Result<(), ScanError> {
    if solution.unseen.is_empty() {
        return Ok(());
    }
    let unobservable = name_directions(&solution.unseen, &names(&solution.model.sought), scale);
    let free = solution.unseen.len();
    Err(ScanError::refused(
        "unidentifiable",
        format_args!(
            "{}. {}",
            open_in_words(&unobservable, scale.len()),
            to_show(&solution.model, give_centres)
        ),
    )
    .with("free", free)
    .with("unobservable", unobservable)
    .with("singular_values", solution.seen.clone()))
}

/// The names of what is sought.
fn names(sought: &[bool; 6]) -> Vec<&'static str> {
    let names = NAMES.iter().zip(sought).filter(|(_, sought)| **sought);
    names.map(|(name, _)| *name).collect()
}

/// What would show what is open.
fn to_show(model: &MountModel<'_>, give_centres: &str) -> String {
    let is_ball = matches!(model.features.first(), Some(SampleSights::Ball { .. }));
    let of = if is_ball {
        "a ball"
    } else {
        "an inclined plane"
    };
    let turned = |flange: &Pose| (flange.rotation - model.all.flanges[0].rotation).amax() > 1e-6;
    // On three axes there is nothing to turn.
    let take = if model.all.flanges.iter().any(turned) {
        format!("Take profiles of {of} at more poses, with all rotary axes moved")
    } else {
        format!(
            "No rotary axis moved. On a machine with one take profiles of {of} at several of its angles"
        )
    };
    let centres = if is_ball && !model.centres_known {
        format!("; or {give_centres}")
    } else {
        String::new()
    };
    format!("{take}{centres}; or hold a shift with --hold")
}

pub(super) fn refuse_uncertain(covariance: &[[f64; 6]; 6]) -> Result<(), ScanError> {
    let Some(worst) = uncertain(covariance) else {
        return Ok(());
    };
    Err(ScanError::refused(
        "uncertain",
        format_args!("{worst}: use more poses that differ more, or look for outliers"),
    )
    .with("component", worst.component)
    .with("standard_uncertainty", worst.uncertainty))
}

/// A component of a mount that is too uncertain.
pub(in crate::calibrate) struct UncertainComponent {
    pub component: &'static str,
    /// In mm or rad.
    pub uncertainty: f64,
    most: f64,
    unit: &'static str,
}

impl std::fmt::Display for UncertainComponent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            component,
            uncertainty,
            most,
            unit,
        } = self;
        write!(
            f,
            "the standard uncertainty of {component} would be {uncertainty:.3e} {unit} (at most {most} {unit})"
        )
    }
}

/// The first component that nobody could use.
pub(in crate::calibrate) fn uncertain(covariance: &[[f64; 6]; 6]) -> Option<UncertainComponent> {
    (0..6).find_map(|i| {
        let (most, unit) = if i < 3 {
            (MOST_UNCERTAIN[0], "rad")
        } else {
            (MOST_UNCERTAIN[1], "mm")
        };
        let uncertainty = covariance[i][i].sqrt();
        // A covariance that is no number is no certainty either.
        (uncertainty.is_nan() || uncertainty > most).then_some(UncertainComponent {
            component: NAMES[i],
            uncertainty,
            most,
            unit,
        })
    })
}

/// The motion of which the least is known, in words: where a covariance is widest, turns worth 100 mm a radian.
pub(in crate::calibrate) fn widest_in_words(covariance: &[[f64; 6]; 6]) -> String {
    let scale = |i: usize| if i < 3 { 1.0 / REACH_MM } else { 1.0 };
    let scaled = DMatrix::from_fn(6, 6, |i, k| covariance[i][k] / scale(i) / scale(k));
    let eigen = scaled.symmetric_eigen();
    let widest = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let direction = DVector::from_fn(6, |i, _| widest[i] * scale(i));
    name_directions(&[direction], &NAMES, &[0, 1, 2, 3, 4, 5].map(scale)).join(", ")
}

pub(super) fn refused(misfit: &Misfit) -> ScanError {
    let error = ScanError::refused(
        "misfit",
        format_args!(
            "{}. The mount is wrong by far more than its uncertainty says: put that right and scan again; or see the \
             answer all the same with --allow-misfit",
            misfit.words()
        ),
    );
    match serde_json::to_value(misfit) {
        Ok(value) => error.with("misfit", value),
        Err(_) => error,
    }
}
