//! Poses against each other: which points one explains and the other does not.

use super::fit::{Fit, INLIER, boxed};
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::measure;
use crate::surface::CompositeSurface;

/// Which points lie on the part where `motion` puts it.
pub(super) fn explained(
    surface: &CompositeSurface,
    points: &[Vec3],
    motion: &Pose,
    sigma_mm: f64,
    threads: Threads,
) -> Vec<bool> {
    let limit = INLIER * sigma_mm;
    let inside = boxed(surface, motion, limit);
    let place: Vec<usize> = (0..points.len()).filter(|&i| inside(&points[i])).collect();
    let near: Vec<Vec3> = place.iter().map(|&i| points[i]).collect();
    let mut seen = vec![false; points.len()];
    for (m, i) in measure(surface, &near, motion, &[], threads)
        .iter()
        .zip(place)
    {
        seen[i] = m.distance_mm.abs() < limit;
    }
    seen
}

/// By how many points the first explains more than the second, and what of that chance can be.
pub(super) fn advantage(first: &[bool], second: &[bool]) -> (f64, f64) {
    let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count() as f64;
    let (mine, theirs) = (only(first, second), only(second, first));
    (mine - theirs, 5.0 * (mine + theirs).sqrt() + 8.0)
}

/// The best first.
pub(super) fn sort(fits: &mut [Fit]) {
    fits.sort_by(|a, b| {
        b.inliers
            .cmp(&a.inliers)
            .then(a.sigma_mm.total_cmp(&b.sigma_mm))
    });
}
