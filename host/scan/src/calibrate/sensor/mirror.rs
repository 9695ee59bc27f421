//! A ball of known centre on the other side of the laser's plane: where it keeps its distance from that plane at
//! all poses, the mount that is moved across by twice that distance has the same residuals.

use nalgebra::Vector3;

use super::{MountModel, SampleSights};
use crate::ScanError;
use crate::calibrate::solve::{Solution, solve};
use crate::rigid::rotation_vector;
use umi_kinematics::Pose;

/// Mounts that are less apart are one.
const APART_MM: f64 = 0.05;
/// So many standard deviations tell one from the other.
const CLEARLY: f64 = 5.0;
/// Residuals below are rounding.
const LEAST_SIGMA_MM: f64 = 1e-6;
/// How far off the first guess may be, as `umi scan calibrate sensor` asks for it.
const GUESS: (f64, f64) = (6.0, 20.0);

/// The solution, or the mirrored one where only that is near the first guess.
///
/// # Errors
/// `uncertain`: both fit alike, and the guess does not decide.
pub(super) fn decided<'a>(
    found: Solution<MountModel<'a>>,
    start: &Pose,
    scale: &[f64],
) -> Result<Solution<MountModel<'a>>, ScanError> {
    let Some(across_mm) = across(&found.model).filter(|mm| 2.0 * mm.abs() > APART_MM) else {
        return Ok(found);
    };
    let mut mirrored = found.model.clone();
    let shift = mirrored.mount.rotation * Vector3::new(0.0, 2.0 * across_mm, 0.0);
    for axis in (0..3).filter(|axis| found.model.sought[3 + axis]) {
        mirrored.mount.translation_mm[axis] += shift[axis];
    }
    let other = solve(mirrored, scale);
    let shift_mm = other.model.mount.translation_mm - found.model.mount.translation_mm;
    let n = found.model.all.points.len() as f64;
    let sigma_mm = (found.ssq / n).sqrt().max(LEAST_SIGMA_MM);
    let worse = (other.ssq - found.ssq) / (sigma_mm * sigma_mm);
    if shift_mm.norm() < APART_MM || worse > CLEARLY * CLEARLY {
        return Ok(found);
    }
    match (
        is_near(&found.model.mount, start),
        is_near(&other.model.mount, start),
    ) {
        (true, false) => Ok(found),
        (false, true) => Ok(other),
        _ => Err(ScanError::refused(
            "uncertain",
            format_args!(
                "two mounts fit alike, {:.3} mm apart: the ball keeps its distance from the laser's plane at all poses, and \
                 nothing says on which side it is. Move the axis across the plane, too, so that the ball is cut in \
                 other places",
                shift_mm.norm()
            ),
        )
        .with("mirrored_translation_mm", other.model.mount.translation_mm.as_slice())),
    }
}

/// How far balls of known centres are from the laser's plane, in mean over all observations.
fn across(model: &MountModel<'_>) -> Option<f64> {
    if !model.centres_known || model.all.points.is_empty() {
        return None;
    }
    let of = model.all.points.iter().map(|seen| {
        let flange = &model.all.flanges[seen.flange];
        match &model.features[seen.feature] {
            SampleSights::Ball { centre_mm } => {
                let in_flange = flange.inverse().point(centre_mm);
                model.mount.inverse().point(&in_flange).y
            }
            SampleSights::Plane { .. } => 0.0,
        }
    });
    Some(of.sum::<f64>() / model.all.points.len() as f64)
}

fn is_near(mount: &Pose, start: &Pose) -> bool {
    let turn = rotation_vector(&(mount.rotation * start.rotation.transpose()));
    let shift = mount.translation_mm - start.translation_mm;
    turn.norm().to_degrees() <= GUESS.0 && shift.norm() <= GUESS.1
}
