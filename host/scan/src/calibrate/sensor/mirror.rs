//! Balls of known centres on the other side of the laser's plane. A cut says how far a centre is from that plane, and
//! not on which side.
//!
//! Where the centres, as the flange sees them at all poses, lie in one plane, the mount that is mirrored in the laser's plane
//! and in theirs has the same residuals: both mirrors together are a motion, the first changes no cut, the second moves
//! no centre. Three cuts always lie in a plane; so do those of axes that move in one.

use nalgebra::{Matrix3, Vector3};

use super::{MountModel, SampleSights};
use crate::ScanError;
use crate::calibrate::solve::{Solution, solve};
use crate::rigid::{orthonormal, rotation_vector};
use umi_kinematics::Pose;

/// Mounts that are less apart are one: 0.05 mm, 0.03°.
const APART: (f64, f64) = (0.05, 0.03);
/// So many standard deviations tell one from the other.
const CLEARLY: f64 = 5.0;
/// Residuals below are rounding.
const LEAST_SIGMA_MM: f64 = 1e-6;
/// How far off the first guess may be, as `umi scan calibrate sensor` asks for it.
const GUESS: (f64, f64) = (20.0, 6.0);
/// A mount is none of those where it is so many times as far off.
const CLEARLY_FARTHER: f64 = 1.1;

/// The solution, or a mirrored one where only that is near the first guess.
///
/// # Errors
/// `uncertain`: both fit alike, and the guess does not decide.
pub(super) fn decided<'a>(
    found: Solution<MountModel<'a>>,
    start: &Pose,
    scale: &[f64],
) -> Result<Solution<MountModel<'a>>, ScanError> {
    let mut best = found;
    for mirrored in [moved_across, reflected] {
        let Some(mirrored) = mirrored(&best.model) else {
            continue;
        };
        let other = solve(mirrored, scale);
        let n = best.model.all.points.len() as f64;
        let sigma_mm = (best.ssq / n).sqrt().max(LEAST_SIGMA_MM);
        let worse = (other.ssq - best.ssq) / (sigma_mm * sigma_mm);
        let (shift_mm, turn_deg) = apart(&best.model.mount, &other.model.mount);
        let is_one = shift_mm < APART.0 && turn_deg < APART.1;
        if is_one || worse > CLEARLY * CLEARLY {
            continue;
        }
        let is_within = |mount: &Pose, times: f64| {
            let (shift_mm, turn_deg) = apart(mount, start);
            shift_mm <= times * GUESS.0 && turn_deg <= times * GUESS.1
        };
        let decides = |one: &Pose, other: &Pose| {
            is_within(one, 1.0 + 1e-6) && !is_within(other, CLEARLY_FARTHER)
        };
        let (this, that) = (best.model.mount, other.model.mount);
        best = match (decides(&this, &that), decides(&that, &this)) {
            (true, _) => best,
            (_, true) => other,
            _ => {
                return Err(ScanError::refused(
                    "uncertain",
                    format_args!(
                        "two mounts fit alike, {shift_mm:.3} mm and {turn_deg:.3}° apart: nothing says on which side of the \
                         laser's plane the balls are. Scan from more poses, so that the centres do not lie in one plane \
                         as the sensor sees them: move the axis across the plane, too"
                    ),
                )
                .with("mirrored_translation_mm", other.model.mount.translation_mm.as_slice())
                .with("mirrored_rotation", other.model.mount.rows()));
            }
        };
    }
    Ok(best)
}

/// The mount that is moved across by twice the balls' distance: where some of it is held, too.
fn moved_across<'a>(found: &MountModel<'a>) -> Option<MountModel<'a>> {
    let across_mm = across(found).filter(|mm| 2.0 * mm.abs() > APART.0)?;
    let mut mirrored = found.clone();
    let shift = mirrored.mount.rotation * Vector3::new(0.0, 2.0 * across_mm, 0.0);
    for axis in (0..3).filter(|axis| found.sought[3 + axis]) {
        mirrored.mount.translation_mm[axis] += shift[axis];
    }
    Some(mirrored)
}

/// The mount that is mirrored in the plane that comes nearest to all centres, and in the laser's.
fn reflected<'a>(found: &MountModel<'a>) -> Option<MountModel<'a>> {
    if !found.centres_known || found.sought != [true; 6] {
        return None;
    }
    let centres = || {
        let of = found.all.points.iter();
        of.filter_map(|seen| match &found.features[seen.feature] {
            SampleSights::Ball { centre_mm } => {
                Some(found.all.flanges[seen.flange].undo(centre_mm))
            }
            SampleSights::Plane { .. } => None,
        })
    };
    let n = centres().count();
    let mean = centres().sum::<Vector3<f64>>() / n.max(1) as f64;
    let scatter: Matrix3<f64> = centres()
        .map(|centre| (centre - mean) * (centre - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    // From the flange to the laser: over the mirror of the centres, and then that of the laser.
    let mirror = Matrix3::identity() - 2.0 * normal * normal.transpose();
    let laser = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    let inverse = found.mount.inverse();
    let turn = laser * inverse.rotation * mirror;
    let image = laser * inverse.point(&mean);
    let to_laser = Pose {
        rotation: orthonormal(&turn),
        translation_mm: image - turn * mean,
    };
    (n > 0).then(|| MountModel {
        mount: to_laser.inverse(),
        ..found.clone()
    })
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

/// How far one mount is from another: mm, degrees.
pub(super) fn apart(a: &Pose, b: &Pose) -> (f64, f64) {
    let turn = rotation_vector(&(a.rotation * b.rotation.transpose()));
    let shift = a.translation_mm - b.translation_mm;
    (shift.norm(), turn.norm().to_degrees())
}
