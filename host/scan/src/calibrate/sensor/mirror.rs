//! Mounts that are one another in a mirror.
//!
//! Balls of known centres on the other side of the laser's plane: a cut says how far a centre is from that plane, and
//! not on which side.
//!
//! Where the centres, as the flange sees them at all poses, lie in one plane, the mount that is mirrored in the laser's plane
//! and in theirs has the same residuals: both mirrors together are a motion, the first changes no cut, the second moves
//! no centre. Three cuts always lie in a plane; so do those of axes that move in one.
//!
//! Planes whose normals, as the flange sees them at all poses, are square to one direction: mirrored along that and in
//! the laser's plane, the mount sees every plane as before. The shift along the direction shows nowhere, so this is of mounts
//! of which that is held.

use nalgebra::{Matrix3, Vector3};

use super::distance::APART;
use super::model::MountModel;
use crate::calibrate::features::SampleSights;
use crate::rigid::orthonormal;
use umi_kinematics::Pose;

/// The mount that is moved across by twice the balls' distance: where some of it is held, too.
pub(super) fn moved_across<'a>(found: &MountModel<'a>) -> Option<MountModel<'a>> {
    let across_mm = across(found).filter(|mm| 2.0 * mm.abs() > APART.0)?;
    let mut mirrored = found.clone();
    let shift = mirrored.mount.rotation * Vector3::new(0.0, 2.0 * across_mm, 0.0);
    for axis in (0..3).filter(|axis| found.sought[3 + axis]) {
        mirrored.mount.translation_mm[axis] += shift[axis];
    }
    Some(mirrored)
}

/// The mount that is mirrored in the plane that comes nearest to all centres, and in the laser's.
pub(super) fn reflected<'a>(found: &MountModel<'a>) -> Option<MountModel<'a>> {
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

/// The mount that is mirrored along the direction to which the planes' normals are most nearly square, and in the laser's plane.
pub(super) fn planes_reflected(found: &MountModel<'_>) -> Option<Pose> {
    let mut scatter = Matrix3::zeros();
    let mut last = None;
    for seen in &found.all.points {
        if last == Some((seen.flange, seen.feature)) {
            continue;
        }
        last = Some((seen.flange, seen.feature));
        if let SampleSights::Plane { normal, .. } = &found.features[seen.feature] {
            let normal = found.all.flanges[seen.flange].rotation.tr_mul(normal);
            scatter += normal * normal.transpose();
        }
    }
    last?;
    let eigen = scatter.symmetric_eigen();
    let along = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let mirror = Matrix3::identity() - 2.0 * along * along.transpose();
    let laser = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    Some(Pose {
        rotation: orthonormal(&(mirror * found.mount.rotation * laser)),
        translation_mm: found.mount.translation_mm,
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
