//! Other mounts that fit as well as the one that was found. Where one does, the first guess decides, or nobody.

use super::distance::{APART, apart};
use super::lines::{Within, at_mount, numbers_over, valleys};
use super::mirror::{moved_across, planes_reflected, reflected};
use super::model::MountModel;
use crate::ScanError;
use crate::calibrate::features::SampleSights;
use crate::calibrate::solve::{MOST_NOISE_MM, Solution, descend, solve};
use umi_kinematics::Pose;

/// So many standard deviations tell one from the other.
const CLEARLY: f64 = 5.0;
/// Residuals below are rounding.
const LEAST_SIGMA_MM: f64 = 1e-6;
/// How far off the first guess may be, as `umi scan calibrate sensor` asks for it.
pub(super) const GUESS: (f64, f64) = (20.0, 6.0);
/// A mount is none of those where it is so many times as far off.
pub(super) const CLEARLY_FARTHER: f64 = 1.1;
/// What the other mount of a mirror is told as.
const MIRRORED: [&str; 2] = ["mirrored_translation_mm", "mirrored_rotation"];
/// Lines of planes that show more numbers than this over are not brought together twice by chance.
const FEW_OVER: i64 = 8;

/// The solution, or another one where only that is near the first guess.
///
/// # Errors
/// `uncertain`: both fit alike, and the guess does not decide.
pub(super) fn decided<'a>(
    found: Solution<MountModel<'a>>,
    start: &Pose,
    scale: &[f64],
) -> Result<Solution<MountModel<'a>>, ScanError> {
    let is_plane = matches!(
        found.model.features.first(),
        Some(SampleSights::Plane { .. })
    );
    if is_plane {
        return of_planes(found, start, scale);
    }
    let mut best = found;
    for mirrored in [moved_across, reflected] {
        if let Some(mirrored) = mirrored(&best.model) {
            best = better(
                best,
                solve(mirrored, scale),
                start,
                MIRRORED,
                |shift_mm, turn_deg| {
                    format!(
                        "two mounts fit alike, {shift_mm:.3} mm and {turn_deg:.3}° apart: nothing says on which side of the \
                     laser's plane the balls are. Scan from more poses, so that the centres do not lie in one plane \
                     as the sensor sees them: move the axis across the plane, too"
                    )
                },
            )?;
        }
    }
    Ok(best)
}

/// The same of planes: their mirrored mount, and those that few profiles bring together by chance.
fn of_planes<'a>(
    found: Solution<MountModel<'a>>,
    start: &Pose,
    scale: &[f64],
) -> Result<Solution<MountModel<'a>>, ScanError> {
    // What no mount brings together is refused for that.
    if found.sigma_mm() > MOST_NOISE_MM {
        return Ok(found);
    }
    let mut best = found;
    if let Some(mount) = planes_reflected(&best.model) {
        let mut mirrored = at_mount(&best.model, mount);
        if descends_as_low(&mut mirrored, &best) {
            best = better(
                best,
                solve(mirrored, scale),
                start,
                MIRRORED,
                |shift_mm, turn_deg| {
                    format!(
                        "two mounts fit alike, {shift_mm:.3} mm and {turn_deg:.3}° apart: each is the other one in a mirror. As the \
                     sensor's flange sees them, the planes all stand square to one plane. Turn another rotary axis, too, or \
                     scan a plane that is inclined otherwise"
                    )
                },
            )?;
        }
    }
    if numbers_over(&best.model).0 > FEW_OVER {
        return Ok(best);
    }
    for mut other in valleys(&best.model, start) {
        if descends_as_low(&mut other, &best) {
            best = better(
                best,
                solve(other, scale),
                start,
                ["other_translation_mm", "other_rotation"],
                |shift_mm, turn_deg| {
                    format!(
                        "two mounts fit alike, {shift_mm:.3} mm and {turn_deg:.3}° apart: the profiles are too few, or too much \
                     alike, to tell which it is. Take more profiles, with the rotary axes at other angles"
                    )
                },
            )?;
        }
    }
    Ok(best)
}

/// Whether a descent from a mount comes near the sum of squares of another one.
fn descends_as_low<'a>(model: &mut MountModel<'a>, best: &Solution<MountModel<'a>>) -> bool {
    /// What the last steps may still gain.
    const NEARLY: f64 = 4.0;
    const STEPS: usize = 60;
    let ssq = descend(model, STEPS);
    ssq - best.ssq <= NEARLY * CLEARLY * CLEARLY * variance(&best.model, best.ssq)
}

/// What a residual scatters, in mm².
fn variance(model: &MountModel<'_>, ssq: f64) -> f64 {
    let is_plane = matches!(model.features.first(), Some(SampleSights::Plane { .. }));
    let within = if is_plane { Within::of(model) } else { None };
    let variance = within.map_or_else(
        || ssq / model.all.points.len() as f64,
        |within| within.variance(ssq),
    );
    variance.max(LEAST_SIGMA_MM * LEAST_SIGMA_MM)
}

/// Of two solutions the one that fits; where both do, the only one that is near the first guess. `names`, `in_words`: how the other one
/// and both are told.
fn better<'a>(
    best: Solution<MountModel<'a>>,
    other: Solution<MountModel<'a>>,
    start: &Pose,
    names: [&'static str; 2],
    in_words: impl Fn(f64, f64) -> String,
) -> Result<Solution<MountModel<'a>>, ScanError> {
    let (this, that) = (best.model.mount, other.model.mount);
    let (shift_mm, turn_deg) = apart(&this, &that);
    let is_one = shift_mm < APART.0 && turn_deg < APART.1;
    let clearly = |by: f64, of: &Solution<MountModel<'_>>| {
        by > CLEARLY * CLEARLY * variance(&of.model, of.ssq)
    };
    if is_one || clearly(other.ssq - best.ssq, &best) {
        return Ok(best);
    }
    let is_plane = matches!(
        best.model.features.first(),
        Some(SampleSights::Plane { .. })
    );
    if is_plane && clearly(best.ssq - other.ssq, &other) {
        return Ok(other);
    }
    let decides = |one: &Pose, other: &Pose| {
        is_within(one, start, 1.0 + 1e-6) && !is_within(other, start, CLEARLY_FARTHER)
    };
    match (decides(&this, &that), decides(&that, &this)) {
        (true, _) => Ok(best),
        (_, true) => Ok(other),
        _ => Err(
            ScanError::refused("uncertain", in_words(shift_mm, turn_deg))
                .with(names[0], that.translation_mm.as_slice())
                .with(names[1], that.rows()),
        ),
    }
}

/// Whether a mount is as near the first guess as is asked for, or so many times that.
pub(super) fn is_within(mount: &Pose, start: &Pose, times: f64) -> bool {
    let (shift_mm, turn_deg) = apart(mount, start);
    shift_mm <= times * GUESS.0 && turn_deg <= times * GUESS.1
}
