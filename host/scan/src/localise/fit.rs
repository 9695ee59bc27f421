//! A pose refined to what the noise allows, without a parameter to tune: noise and outliers are estimated on the way.

use nalgebra::{Matrix6, Vector6};

use super::search::pairs::spread;
use super::uncertainty::Groups;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::median;
use crate::solve::{Kernel, Measured, Offset, Settled, Task, measure_within, pseudo_solve};
use crate::surface::CompositeSurface;

/// Tukey's limit in units of the noise: 95 % efficient where the noise is normal.
pub(super) const TUKEY: f64 = 4.685;
/// A point within this many times the noise is on the part.
pub(super) const INLIER: f64 = 4.0;
/// A pose of the part on itself is right to this many times the noise.
pub(super) const CLOSE: f64 = 10.0;

/// A fit ends at a step below this share of Tukey's limit.
pub(super) const ENOUGH: f64 = 2e-5;

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

/// The points within `limit` mm by Tukey's kernel, to a step that is small beside the noise that `limit` stands
/// for. What is measured before must reach to `limit`, and so does what is measured then.
pub(super) fn robust<'a>(
    surface: &'a CompositeSurface,
    points: &'a [Vec3],
    limit: f64,
    steps: usize,
    threads: Threads,
) -> Task<'a> {
    Task {
        within_mm: limit,
        enough_mm: ENOUGH * limit,
        ..task(surface, points, Kernel::Tukey(limit), steps, threads)
    }
}

/// Where a pose has come that is not refined to the end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Approach {
    /// Scan from model.
    pub motion: Pose,
    /// Points farther than this, in mm, do not count any more.
    limit: f64,
}

/// The first rounds: what they bring is coarser than what few points say.
const FIRST: usize = 3;
const FEW: usize = 400;

/// From `start`, which is right to about `reach` mm, to where a part of the points, and few steps, lead.
/// `floor`: no noise is taken for less, in mm.
pub(super) fn approach(
    surface: &CompositeSurface,
    points: &[Vec3],
    start: &Pose,
    reach: f64,
    floor: f64,
    threads: Threads,
) -> Option<Approach> {
    let (near, measured) = close(surface, points, start, 3.0 * reach, threads);
    let (near, mut measured): (Vec<Vec3>, Vec<Measured>) =
        spread(near.len(), FEW.max(near.len() / 3))
            .into_iter()
            .map(|i| (near[i], measured[i]))
            .unzip();
    let mut at = Approach {
        motion: *start,
        limit: reach,
    };
    for _ in 0..FIRST {
        if near.len() < LEAST {
            return None;
        }
        measured = at.round(surface, &near, measured, floor, threads);
    }
    Some(at)
}

/// Points that a fit needs.
const LEAST: usize = 12;

impl Approach {
    /// A few steps, and what counts from then on.
    fn round(
        &mut self,
        surface: &CompositeSurface,
        near: &[Vec3],
        measured: Vec<Measured>,
        floor: f64,
        threads: Threads,
    ) -> Vec<Measured> {
        let settled =
            robust(surface, near, self.limit, 3, threads).solve_on(&self.motion, measured);
        self.motion = settled.motion;
        let sigma = noise(&settled.measured, self.limit).max(floor);
        self.limit = (TUKEY * sigma).clamp(self.limit * 0.35, self.limit);
        settled.measured
    }

    /// From there to the pose that the points on the part give; `last`: the last steps at most.
    pub fn settle(
        mut self,
        surface: &CompositeSurface,
        points: &[Vec3],
        floor: f64,
        last: usize,
        threads: Threads,
    ) -> Option<Fit> {
        let (near, mut measured) = close(surface, points, &self.motion, 3.0 * self.limit, threads);
        if near.len() < LEAST {
            return None;
        }
        for _ in FIRST..12 {
            let before = self.limit;
            measured = self.round(surface, &near, measured, floor, threads);
            if self.limit > 0.97 * before {
                break;
            }
        }
        let settled: Settled =
            robust(surface, &near, self.limit, last, threads).solve_on(&self.motion, measured);
        let sigma = noise(&settled.measured, self.limit).max(floor);
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
    approach(surface, points, start, reach, floor, threads)?
        .settle(surface, points, floor, last, threads)
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
