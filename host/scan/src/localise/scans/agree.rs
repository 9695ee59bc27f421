//! Whether several scans show one part in one place.

use crate::ScanError;
use crate::localise::fit::{self, Fit};
use crate::localise::search::pairs::spread;
use crate::localise::uncertainty::Groups;
use crate::localise::verdict::each::EachScan;
use crate::localise::{LocaliseTask, Located, misfits};
use crate::rigid::Vec3;
use crate::solve::measure;
use crate::surface::CompositeSurface;

/// Points of a scan that its own pose is settled with.
const SETTLED: usize = 20_000;
/// Scans do not lie on one part if together they are so many times as rough as the roughest of them alone,
const TOGETHER: f64 = 2.0;
/// and one by itself leaves the common pose by so many times what its doubts and its noise allow, in squares and for each
/// motion.
const DOUBTS: f64 = 25.0;

/// Refuses scans each of which fits the part to its noise, and which together do not: where one of them is a little off, all
/// of its points are near enough to the common pose to be taken for noise.
pub(super) fn agree(
    task: &LocaliseTask<'_>,
    scans: &[EachScan<'_>],
    located: &Located,
) -> Result<(), ScanError> {
    if scans.len() < 2 {
        return Ok(());
    }
    let surface = CompositeSurface::from(task.model.clone());
    let (common, reach, threads) = (&located.motion, 10.0 * located.sigma_mm, task.threads);
    let inside = fit::boxed(&surface, common, reach);
    let near = |scan: &EachScan<'_>| -> Vec<Vec3> {
        let all: Vec<&Vec3> = scan.points.iter().filter(|q| inside(q)).collect();
        let some = spread(all.len(), SETTLED).into_iter();
        some.map(|i| *all[i]).collect()
    };
    let points: Vec<Vec<Vec3>> = scans.iter().map(near).collect();
    let floor = task.model.diagonal_mm() * 1e-7;
    let settle = |points: &[Vec3]| fit::settle(&surface, points, common, reach, floor, 8, threads);
    let own: Vec<Option<Fit>> = points.iter().map(|points| settle(points)).collect();
    let noise = |of: &Option<Fit>| of.as_ref().map_or(f64::INFINITY, |fit| fit.sigma_mm);
    let rough = own.iter().map(noise).filter(|mm| mm.is_finite());
    if located.sigma_mm < TOGETHER * rough.fold(0.0, f64::max) {
        return Ok(());
    }
    let leaves = |k: usize| {
        let Some(fit) = &own[k] else { return false };
        let there = measure(&surface, &points[k], &fit.motion, &[], threads);
        let is_on = |&i: &usize| there[i].distance_mm.abs() < fit::INLIER * fit.sigma_mm;
        let on: Vec<usize> = (0..there.len()).filter(is_on).collect();
        let here = measure(&surface, &points[k], common, &[], threads);
        let groups = Groups {
            all: &task.groups.all[k..=k],
            of: &[],
        };
        let (misfit, held) = misfits(&points[k], &here, &on, fit.sigma_mm, groups)[0];
        misfit > DOUBTS * held as f64
    };
    if !(0..scans.len()).any(leaves) {
        return Ok(());
    }
    // Without the one that is off the others are one part; of two nobody knows which it is.
    let others = |k: usize| {
        let others = (0..points.len()).filter(|&i| i != k);
        let others: Vec<Vec3> = others.flat_map(|i| points[i].iter().copied()).collect();
        settle(&others)
    };
    let without: Vec<Option<Fit>> = (0..scans.len()).map(others).collect();
    let one = (0..scans.len()).min_by(|&a, &b| noise(&without[a]).total_cmp(&noise(&without[b])));
    let (Some(one), corners) = (one, task.model.corners()) else {
        return Ok(());
    };
    let (Some(fit), Some(others)) = (&own[one], &without[one]) else {
        return Ok(());
    };
    let off_mm = fit.motion.apart_mm(&others.motion, &corners);
    Err(ScanError::refused(
        "scans_disagree",
        format_args!(
            "each scan fits the part to {:.4} mm and all together to {:.4} mm: {} puts it {off_mm:.3} mm from where the other \
             scans put it. Does `moved` of each say how the machine had moved the part, to the angle?",
            fit.sigma_mm, located.sigma_mm, scans[one].name
        ),
    )
    .with("scan", scans[one].name)
    .with("off_mm", off_mm))
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix6;

    use super::*;
    use crate::localise::tests::{Random, bracket, scan, task};
    use crate::localise::uncertainty::Group;
    use crate::rigid::{Pose, rotation};
    use crate::solve::Kernel;

    fn turned(degrees: f64, about: Vec3) -> Pose {
        let rotation = rotation(&(about * degrees.to_radians()));
        Pose {
            rotation,
            translation_mm: Vec3::zeros(),
        }
    }

    /// Three views of a bracket 150 mm from the axis; one of them turned by so much more than its `moved` says. How sure each
    /// scan's place is, in mm.
    fn three(degrees: f64, u_mm: f64) -> Result<(), ScanError> {
        let part = bracket();
        let mut random = Random(73);
        let at = Pose {
            translation_mm: Vec3::new(0.0, 150.0, 0.0),
            ..Pose::identity()
        };
        let views = [[0.3, -0.2, 0.9], [-0.5, 0.8, 0.3], [0.6, 0.5, -0.6]];
        let names = ["first.ply", "second.ply", "third.ply"];
        let mut scans = Vec::new();
        for (k, (eye, name)) in views.iter().zip(names).enumerate() {
            let eye = Vec3::from(*eye).normalize();
            let off = turned(if k == 2 { degrees } else { 0.0 }, Vec3::x()).after(&at);
            let points = scan(&part, 4000, 0.01, &off, &mut random, |n| n.dot(&eye) > 0.1);
            scans.push(EachScan {
                name,
                points,
                on_fiducials: Vec::new(),
            });
        }
        let points: Vec<Vec3> = scans.iter().flat_map(|s| s.points.clone()).collect();
        let of: Vec<usize> = (0..3)
            .flat_map(|k| vec![k; scans[k].points.len()])
            .collect();
        let sure = Group {
            at: Vec3::new(0.0, 150.0, 0.0),
            cov: Matrix6::identity() * u_mm.powi(2),
            common: Vec::new(),
        };
        let groups = [sure.clone(), sure.clone(), sure];
        let task = LocaliseTask {
            groups: Groups {
                all: &groups,
                of: &of,
            },
            ..task(&part, &points)
        };
        // Of all points alike: none of the scan that is off counts less.
        let all = LocaliseTask {
            start: Some(at),
            kernel: Some(Kernel::None),
            ..task.clone()
        };
        agree(&task, &scans, &all.find()?)
    }

    /// A turn that the machine made 0.2 degrees wider than the file says is 0.5 mm at the part: all points of that scan are
    /// near the part then, and look like noise.
    #[test]
    fn a_scan_that_was_turned_a_little_wrong_is_named() {
        assert_eq!(three(0.0, 1e-3).map_err(|e| e.message), Ok(()));
        for degrees in [0.1, 0.2, 0.5] {
            let error = three(degrees, 1e-3).unwrap_err();
            assert_eq!(error.code, "scans_disagree", "{degrees}");
            assert!(
                error.message.contains("third.ply puts"),
                "{degrees}: {error}"
            );
        }
        // Where the scans' places are that unsure, it is no contradiction.
        assert_eq!(three(0.2, 1.0).map_err(|e| e.message), Ok(()));
    }
}
