//! A pose refined to what the noise allows, without a parameter to tune: noise and outliers are estimated on the way.

use nalgebra::{Matrix6, Vector6};

use super::uncertainty::Groups;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::{Kernel, Measured, Offset, Settled, Task, measure_within, pseudo_solve};
use crate::stock::median;
use crate::surface::CompositeSurface;

/// Tukey's limit in units of the noise: 95 % efficient where the noise is normal.
pub(super) const TUKEY: f64 = 4.685;
/// A point within this many times the noise is on the part.
pub(super) const INLIER: f64 = 4.0;

/// A refined pose.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// Scan from model.
    pub motion: Pose,
    /// The noise along the normals in mm.
    pub sigma_mm: f64,
    /// Points on the part.
    pub inliers: usize,
    /// Points that speak for it, less those that speak against it; [`settle`] does not tell.
    pub worth: i64,
}

/// The noise of distances that follow a normal law near zero and anything further out, below `limit` mm.
pub(super) fn noise(measured: &[Measured], limit: f64) -> f64 {
    let mut window = limit;
    let mut sigma = limit;
    for _ in 0..30 {
        let mut near: Vec<f64> = measured
            .iter()
            .map(|m| m.distance_mm.abs())
            .filter(|d| *d < window)
            .collect();
        if near.len() < 6 {
            return sigma;
        }
        let next = 1.4826 * median(&mut near);
        let next_window = (4.0 * next).min(limit);
        sigma = next;
        if (next_window - window).abs() < 1e-6 * window {
            break;
        }
        window = next_window;
    }
    sigma
}

/// The middle of the points.
pub(super) fn middle(points: &[Vec3]) -> Vec3 {
    let Some(first) = points.first() else {
        return Vec3::zeros();
    };
    first + points.iter().map(|p| p - first).sum::<Vec3>() / points.len() as f64
}

/// A least-squares task with everything free.
pub(super) fn task<'a>(
    surface: &'a CompositeSurface,
    points: &'a [Vec3],
    kernel: Kernel,
    steps: usize,
    threads: Threads,
) -> Task<'a> {
    Task {
        surface,
        points,
        weights: &[],
        kernel,
        offset: Offset::Zero,
        pivot: middle(points),
        locked: [false; 6],
        steps,
        within_mm: f64::INFINITY,
        enough_mm: 0.0,
        threads,
    }
}

/// The points within `limit` mm by Tukey's kernel, to a step that is small beside the noise that `limit` stands for.
pub(super) fn robust<'a>(
    surface: &'a CompositeSurface,
    points: &'a [Vec3],
    limit: f64,
    steps: usize,
    threads: Threads,
) -> Task<'a> {
    Task {
        within_mm: 3.0 * limit,
        enough_mm: 2e-5 * limit,
        ..task(surface, points, Kernel::Tukey(limit), steps, threads)
    }
}

/// From `start`, which is right to about `reach` mm, to the pose that the points on the part give.
/// `floor`: no noise is taken for less, in mm; `last`: the last steps at most.
pub(super) fn settle(
    surface: &CompositeSurface,
    points: &[Vec3],
    start: &Pose,
    reach: f64,
    floor: f64,
    last: usize,
    threads: Threads,
) -> Option<Fit> {
    let mut motion = *start;
    let mut limit = reach;
    let (mut near, mut measured) = close(surface, points, &motion, 3.0 * reach, threads);
    for round in 0..12 {
        if near.len() < 12 {
            return None;
        }
        let settled = robust(surface, &near, limit, 3, threads).solve_on(&motion, measured);
        (motion, measured) = (settled.motion, settled.measured);
        let sigma = noise(&measured, limit).max(floor);
        let next = (TUKEY * sigma).clamp(limit * 0.35, limit);
        if round > 1 && next > 0.97 * limit {
            break;
        }
        if round == 3 && near.len() > 64 {
            (near, measured) = (near.into_iter().zip(measured))
                .filter(|(_, m)| m.distance_mm.abs() < 3.0 * limit)
                .unzip();
        }
        limit = next;
    }
    let settled: Settled = robust(surface, &near, limit, last, threads).solve_on(&motion, measured);
    let sigma = noise(&settled.measured, limit).max(floor);
    let inliers = settled
        .measured
        .iter()
        .filter(|m| m.distance_mm.abs() < INLIER * sigma)
        .count();
    Some(Fit {
        motion: settled.motion,
        sigma_mm: sigma,
        inliers,
        worth: 0,
    })
}

/// What moves a measured distance: turns times `arm` about `about`, and shifts in mm.
pub(super) fn row(q: &Vec3, m: &Measured, about: &Vec3, arm: f64) -> Vector6<f64> {
    let n = m.direction;
    let turn = (q - about).cross(&n) / arm;
    Vector6::new(-turn.x, -turn.y, -turn.z, -n.x, -n.y, -n.z)
}

/// The fit with each group's own doubt in it: its own motion is solved for beside the pose.
pub(super) fn weighed(
    surface: &CompositeSurface,
    points: &[Vec3],
    groups: Groups<'_>,
    start: &Pose,
    sigma: f64,
    threads: Threads,
) -> Pose {
    let kernel = Kernel::Tukey(TUKEY * sigma);
    let about = middle(points);
    let arm = points
        .iter()
        .map(|q| (q - about).norm())
        .fold(1e-3, f64::max);
    let mut motion = *start;
    for _ in 0..30 {
        let reach = 3.0 * TUKEY * sigma;
        let measured = measure_within(surface, points, &motion, &[], reach, threads);
        let mut h = vec![Matrix6::zeros(); groups.all.len()];
        let mut g = vec![Vector6::zeros(); groups.all.len()];
        for (i, (q, m)) in points.iter().zip(&measured).enumerate() {
            let weight = kernel.weight(m.distance_mm);
            let r = row(q, m, &about, arm);
            h[groups.of(i)] += r * r.transpose() * weight;
            g[groups.of(i)] -= r * (weight * m.distance_mm);
        }
        let damping = groups.damping(&h, &about, arm, sigma * sigma);
        let left: Matrix6<f64> = h.iter().zip(&damping).map(|(h, d)| d * h).sum();
        let right: Vector6<f64> = g.iter().zip(&damping).map(|(g, d)| d * g).sum();
        let x = pseudo_solve(&((left + left.transpose()) / 2.0), &right, 1e-13);
        let step = Vector6::new(x[0] / arm, x[1] / arm, x[2] / arm, x[3], x[4], x[5]);
        motion = stepped(&motion, &step, &about);
        if x.amax() < (1e-12 * (1.0 + arm)).max(1e-6 * sigma) {
            break;
        }
    }
    motion
}

/// The points nearer than `limit` mm to the model, and how they lie there.
fn close(
    surface: &CompositeSurface,
    points: &[Vec3],
    motion: &Pose,
    limit: f64,
    threads: Threads,
) -> (Vec<Vec3>, Vec<Measured>) {
    let inside = boxed(surface, motion, limit);
    let boxed: Vec<Vec3> = points.iter().filter(|q| inside(q)).copied().collect();
    let measured = measure_within(surface, &boxed, motion, &[], limit, threads);
    (boxed.into_iter().zip(measured))
        .filter(|(_, m)| m.distance_mm.abs() < limit)
        .unzip()
}

/// Whether a point lies in the model's box, widened by `limit` mm: most of a large scan does not.
pub(super) fn boxed(
    surface: &CompositeSurface,
    motion: &Pose,
    limit: f64,
) -> impl Fn(&Vec3) -> bool + use<> {
    let (low, high) = surface.bounds();
    let motion = *motion;
    move |q| {
        let p = motion.undo(q);
        (0..3).all(|i| p[i] > low[i] - limit && p[i] < high[i] + limit)
    }
}
