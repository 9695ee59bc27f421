//! How large the scan is beside the part.
//!
//! A pose alone lies on three faces that meet in a corner whatever the size is, and takes all else for stray points: the
//! better the scan, the fewer of them it needs. So the size is sought with all points that a part of another size would
//! explain, and the pose of that size is asked how many of them lie on it.

use nalgebra::{SMatrix, SVector, Vector6};

use super::fit::{self, row};
use super::search::pairs;
use super::uncertainty::{self, Certainty, Groups};
use super::{LocaliseTask, near, spread};
use crate::cloud::curve;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::{Kernel, Measured, measure_within};
use crate::surface::CompositeSurface;

/// What is off by more than this is no question of a few parts in a thousand.
const SIZE: f64 = 0.1;
/// Points that the size is sought with.
const SIZED: usize = 6000;
/// How far from the part the points may lie at first, over its diagonal: what clutter spoils from afar, the next one finds.
const REACHES: [f64; 3] = [0.06, 0.02, 0.006];
/// The kernel becomes so many times as wide with every round, and so many steps are made in each.
const NARROWER: f64 = 0.6;
const STEPS: usize = 3;
const LAST: usize = 8;
/// Another size explains more if it does so by this share of the points on the part, by what stray points make of it, and
/// by so many. These make so many times the root of their number of it, and no more than the root of those on the part.
const MORE: f64 = 0.005;
const CHANCE: f64 = 3.0;
const LEAST: f64 = 10.0;
/// So many times as many points as a size takes off the part must be more on it.
const OTHERS: f64 = 4.0;
/// A size is right within so many times its own doubt.
const SURE: f64 = 4.0;
/// What keeps a motion still that nothing holds, over what holds all.
const STILL: f64 = 1e-9;

/// A size with the pose that goes with it.
struct Sized {
    scale: f64,
    motion: Pose,
    noise_mm: f64,
    /// The points on the part, by number.
    on: Vec<usize>,
}

impl Sized {
    /// Whether it is a size of the part that these points are on by the pose alone. Of a size that is right they lie on it as
    /// well; one that takes more than chance of them off, for not many times as many others, has found another body.
    fn is_of(&self, before: &[usize], least: f64) -> bool {
        let is_off = |k: &&usize| self.on.binary_search(k).is_err();
        let lost = before.iter().filter(is_off).count() as f64;
        lost <= least || self.on.len() as f64 - before.len() as f64 > OTHERS * lost
    }
}

impl LocaliseTask<'_> {
    /// The certainty with the scale by a fit of all seven, where that explains more of the scan. The pose stays as it is;
    /// how far the size puts a corner off is in its covariance then.
    pub(super) fn sized(
        &self,
        surface: &CompositeSurface,
        motion: &Pose,
        sigma: f64,
        six: Certainty,
    ) -> (Certainty, Option<Pose>) {
        if !six.free.is_empty() {
            return (six, None);
        }
        let diagonal = self.model.diagonal_mm();
        let widest = (REACHES[0] * diagonal).max(10.0 * sigma);
        let about = self.within(surface, motion, widest);
        let few = pairs::spread(about.len(), SIZED).into_iter();
        let few = curve::in_order(self.points, few.map(|k| about[k]).collect());
        let points: Vec<Vec3> = few.iter().map(|&k| self.points[k]).collect();
        let of: Vec<usize> = few.iter().map(|&k| self.groups.of(k)).collect();
        let groups = Groups {
            of: &of,
            ..self.groups
        };
        let limit = fit::INLIER * sigma;
        let there = measure_within(surface, &points, motion, &[], limit, self.threads);
        let before = near(&there, limit);
        let start = Sized {
            scale: 1.0,
            motion: *motion,
            noise_mm: sigma,
            on: before.clone(),
        };
        let all = before.len() as f64;
        let stray = few.len() as f64 - all;
        let chance = (CHANCE * stray.sqrt()).min(all.sqrt());
        let least = (MORE * all).max(chance).max(LEAST);
        let mut best: Option<Sized> = None;
        for (k, share) in REACHES.iter().enumerate() {
            let reach = share * diagonal;
            if k > 0 && reach < 10.0 * sigma {
                break;
            }
            let reach = reach.max(10.0 * sigma);
            let found = self.seven(surface, &points, &six.about_mm, &start, reach, limit);
            if let Some(found) = found
                && found.is_of(&before, least)
                && best
                    .as_ref()
                    .is_none_or(|best| found.on.len() > best.on.len())
            {
                best = Some(found);
            }
        }
        let Some(best) = best else {
            return (six, None);
        };
        let more = best.on.len().saturating_sub(before.len());
        let is_more = more as f64 > least;
        let is_worse = best.noise_mm > sigma || best.on.len() < before.len();
        // Of what both explain, more points say more; where they say the same, at once.
        let agrees = |u: f64, scale: f64| (scale - six.scale).abs() <= 3.0 * u;
        let is_same = six.u_scale.is_finite() && agrees(six.u_scale, best.scale);
        if !is_more && (is_worse || is_same) {
            return (six, None);
        }
        let shrunk = shrunk(&points, &six.about_mm, best.scale);
        let reach = fit::INLIER * best.noise_mm;
        let there = measure_within(surface, &shrunk, &best.motion, &[], reach, self.threads);
        let noise = best.noise_mm;
        let on = near(&there, reach);
        let on = uncertainty::on_faces(
            surface,
            &shrunk,
            &there,
            &on,
            &best.motion,
            noise,
            self.threads,
        );
        let seven = uncertainty::certainty(&shrunk, &there, &on, &best.motion, noise, groups)
            .widened(spread(&shrunk, &there, &on, noise, groups));
        if !seven.free.is_empty() {
            return (six, None);
        }
        // What was made smaller by s, and is s' too large then, is too large by both.
        let scale = best.scale * seven.scale;
        let u_scale = seven.u_scale;
        if !is_more && agrees(u_scale, scale) {
            return (six, None);
        }
        let sized = Certainty {
            scale,
            u_scale,
            by_size: if is_more { more } else { 0 },
            ..six
        };
        if !sized.is_off_size() {
            return (sized, None);
        }
        let off = self
            .model
            .corners()
            .iter()
            .map(|p| {
                let image = sized.about_mm + (best.motion.point(p) - sized.about_mm) * scale;
                (image - motion.point(p)).norm()
            })
            .fold(0.0, f64::max);
        // By a size that is right, more points are a better pose.
        let is_right = (scale - 1.0).abs() <= SURE * u_scale;
        (sized.off_by(off), is_right.then_some(best.motion))
    }

    /// The size by these points, from a fit that is about right: they are so many times as large as the part; and the pose
    /// on them as they lie when they are made as much smaller about `about`.
    pub(super) fn size_near(
        &self,
        surface: &CompositeSurface,
        points: &[Vec3],
        about: &Vec3,
        fit: &fit::Fit,
    ) -> Option<(f64, Pose)> {
        let start = Sized {
            scale: 1.0,
            motion: fit.motion,
            noise_mm: fit.sigma_mm,
            on: Vec::new(),
        };
        let reach = REACHES[0] * self.model.diagonal_mm();
        let found = self.seven(surface, points, about, &start, reach, 0.0)?;
        Some((found.scale, found.motion))
    }

    /// Pose and size by the points within `reach` mm, which narrows to what the noise leaves. On the part is what lies within
    /// `limit` mm.
    fn seven(
        &self,
        surface: &CompositeSurface,
        points: &[Vec3],
        about: &Vec3,
        start: &Sized,
        reach: f64,
        limit: f64,
    ) -> Option<Sized> {
        let floor = self.model.diagonal_mm() * 1e-7;
        let (mut scale, mut motion, mut reach) = (start.scale, start.motion, reach);
        let arm = (self.model.diagonal_mm() / 2.0).max(1e-6);
        loop {
            let mut noise = reach;
            let mut is_last = false;
            for step in 0..LAST {
                let there = shrunk(points, about, scale);
                let measured = measure_within(surface, &there, &motion, &[], reach, self.threads);
                noise = fit::noise(&measured, reach).max(floor);
                is_last = fit::TUKEY * noise >= NARROWER * reach;
                let x = linear(&there, &measured, about, arm, reach)?;
                let grown = x[6] / arm;
                scale *= 1.0 + grown;
                if !scale.is_finite() || (scale - 1.0).abs() > SIZE {
                    return None;
                }
                let turn = [x[0] / arm, x[1] / arm, x[2] / arm];
                let by = Vector6::new(turn[0], turn[1], turn[2], x[3], x[4], x[5]);
                motion = stepped(&motion, &by, about);
                let is_still = x.amax() < 1e-3 * noise;
                if is_still || !is_last && step + 1 >= STEPS {
                    break;
                }
            }
            if is_last {
                let there = shrunk(points, about, scale);
                let far = reach.max(limit);
                let measured = measure_within(surface, &there, &motion, &[], far, self.threads);
                return Some(Sized {
                    scale,
                    motion,
                    noise_mm: noise,
                    on: near(&measured, limit),
                });
            }
            reach = (NARROWER * reach).max(fit::TUKEY * noise);
        }
    }
}

/// The points, made smaller about a place.
fn shrunk(points: &[Vec3], about: &Vec3, scale: f64) -> Vec<Vec3> {
    points.iter().map(|q| about + (q - about) / scale).collect()
}

/// One step of all seven by Tukey's kernel: turns and the size in units of the arm, and shifts. None without points.
fn linear(
    points: &[Vec3],
    measured: &[Measured],
    about: &Vec3,
    arm: f64,
    reach: f64,
) -> Option<SVector<f64, 7>> {
    let kernel = Kernel::Tukey(reach);
    let mut matrix = SMatrix::<f64, 7, 7>::zeros();
    let mut right = SVector::<f64, 7>::zeros();
    for (q, m) in points.iter().zip(measured) {
        if m.distance_mm.abs() >= reach {
            continue;
        }
        let weight = kernel.weight(m.distance_mm);
        let r = row(q, m, about, arm);
        // Of the foot on the model: the point's own noise would look like growth.
        let foot = q - m.direction * m.distance_mm;
        let grow = -m.direction.dot(&(foot - about)) / arm;
        let full = SVector::<f64, 7>::from([r[0], r[1], r[2], r[3], r[4], r[5], grow]);
        matrix += full * full.transpose() * weight;
        right -= full * (weight * m.distance_mm);
    }
    let trace = matrix.trace();
    if trace <= 0.0 || !trace.is_finite() {
        return None;
    }
    for k in 0..7 {
        matrix[(k, k)] += STILL * trace;
    }
    let x = matrix.cholesky()?.solve(&right);
    x.iter().all(|x| x.is_finite()).then_some(x)
}
