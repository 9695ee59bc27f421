//! Whether a face of what was scanned stands off, and the part lies as well on that one.
//!
//! A plate that is 1 mm too thick lies on its bottom and its sides, or on its top and its sides. Either pose has a face of
//! the scan 1 mm off, and which of the two is meant the scan does not say. Seen from above, its top has most of the points;
//! that the floors of its pockets lie 1 mm deep in the part then says that the top stands off.
//!
//! What stands off by little, as any face that is machined to a tolerance, is a doubt of the pose along that way; by more,
//! it is refused. And where a fit ended between such a face and the others, it is begun anew from where either lies on the
//! part: most of the scan is as the model has it then, to its own noise.

use std::collections::BTreeMap;

use super::symmetry::ambiguous;
use super::{Decided, Judge};
use crate::ScanError;
use crate::localise::fit::{self, Fit};
use crate::localise::search::scene::Scene;
use crate::localise::verdict::rivals::{is_clearly_off, on};
use crate::rigid::{Pose, Vec3};
use crate::solve::median;
use crate::solve::{Measured, measure_within};

/// What lies farther off than this, over the part's diagonal, is another body's.
const REACH: f64 = 0.04;
/// A side with fewer points says nothing, nor one of which a smaller share lies at one distance.
const LEAST: usize = 15;
const EVEN: f64 = 0.6;
/// Sides stand off if they have this share of the points on the part.
const SHARE: f64 = 0.04;
/// Or this share, where they are as many as those that lie on the part.
const FEW: f64 = 0.01;
/// The part lies as well on them if it has this share of the points there.
const AS_WELL: f64 = 0.85;
/// A fit beside another one is better if most of that one's points lie on the part by it, and what is off has this share.
const MOST: f64 = 0.55;
const BETTER: f64 = 0.9;
/// Faces that a fit can have ended beside, one after the other.
const TURNS: usize = 4;
/// The least that is taken for noise, over what is measured of it.
const FLOOR: f64 = 0.3;
/// Stray points have made the noise larger where it is so many times that of the sides.
const STRAY: f64 = 2.0;
/// The standard deviation over the median of what is normally distributed, without its sign.
const NORMAL: f64 = 1.4826;
/// Sides are parallel if their normals have this cosine.
const PARALLEL: f64 = 0.9998;

/// A flat side of which the scan shows how far it lies off the part.
struct Side {
    /// Its number.
    side: u32,
    /// In the scan.
    normal: Vec3,
    /// Along the normal, in mm.
    off_mm: f64,
    points: usize,
}

impl Side {
    /// How far it lies off along the normal of another one; none if the two are not parallel.
    fn off_along(&self, normal: &Vec3) -> Option<f64> {
        let cosine = self.normal.dot(normal);
        (cosine.abs() > PARALLEL).then_some(self.off_mm * cosine.signum())
    }
}

impl Judge<'_> {
    /// With the refusal of a part that lies as well on a face that stands off, or with the doubt by it.
    pub(super) fn with_aside(
        &self,
        scene: &Scene,
        mut decided: Decided,
    ) -> Result<Decided, ScanError> {
        let begun = decided.fit.motion;
        decided.fit = self.sharp(scene, &decided.fit);
        for _ in 0..TURNS {
            let Some(better) = self.better_beside(scene, &decided.fit) else {
                break;
            };
            decided.fit = better;
        }
        let even = self.evenness(scene, &decided.fit);
        let sigma = even.unwrap_or_else(|| self.noise(scene, &decided.fit));
        for (shift, other) in self.aside(scene, &decided.fit, sigma) {
            if is_clearly_off(shift.norm() / sigma) {
                let why = format!(
                    "a face of what was scanned stands {:.3} mm off the part, which lies as well on that face and off another one",
                    shift.norm()
                );
                let what = "measure the part, and crop the scan to the faces that are as the model has them";
                decided.aside = Some(ambiguous(&[], &[decided.fit.motion, other], &why, what));
            } else if decided
                .doubts
                .iter()
                .all(|known| (known - shift).norm() > sigma)
            {
                decided.doubts.push(shift);
            }
        }
        // Another fit has passed nothing of what the one before it had to.
        if decided.fit.motion != begun && decided.aside.is_none() {
            self.stands(scene, &decided.fit)?;
        }
        Ok(decided)
    }

    /// A fit from where some of a large side lie on the part, if more of the scan is as the model has it by that one.
    fn better_beside(&self, scene: &Scene, fit: &Fit) -> Option<Fit> {
        let even = self.evenness(scene, fit);
        let (noise, floor) = match even {
            Some(even) => (even, FLOOR * even),
            None => (scene.noise_mm, self.floor(scene)),
        };
        let limit = fit::INLIER * noise;
        let reach = REACH * self.prepared.diagonal;
        let measure = |motion: &Pose| {
            let threads = self.task.threads;
            measure_within(self.surface, &scene.fine, motion, &[], reach, threads)
        };
        let off = |measured: &[Measured]| {
            let squares = measured
                .iter()
                .map(|m| m.distance_mm.abs().min(limit).powi(2));
            squares.sum::<f64>()
        };
        let here = measure(&fit.motion);
        let near = |limit: f64, measured: &[Measured]| {
            let near = measured.iter().filter(|m| m.distance_mm.abs() < limit);
            near.count() as f64
        };
        let all = near(fit::INLIER * fit.sigma_mm.max(scene.noise_mm), &here);
        let mut best = (BETTER * off(&here), None);
        for (mut offs, normal) in self.by_side(&here, &fit.motion).into_values() {
            if (offs.len() as f64) < SHARE * all {
                continue;
            }
            offs.sort_by(f64::total_cmp);
            for quarter in 1..4 {
                let by = offs[quarter * offs.len() / 4];
                if by.abs() < limit / 2.0 {
                    continue;
                }
                let moved = Pose::shift_mm(normal * by).after(&fit.motion);
                let close = fit::CLOSE * noise;
                let Some(other) = self.refine_to(scene, &moved, close, floor) else {
                    continue;
                };
                let there = measure(&other.motion);
                let left = off(&there);
                if left < best.0 && near(limit, &there) > MOST * all {
                    best = (left, Some(other));
                }
            }
        }
        best.1
    }

    /// Other places of the part, each a face that stands off: by how much and which way, and the pose.
    fn aside(&self, scene: &Scene, fit: &Fit, sigma: f64) -> Vec<(Vec3, Pose)> {
        let threads = self.task.threads;
        let reach = REACH * self.prepared.diagonal;
        let measure =
            |motion: &Pose| measure_within(self.surface, &scene.fine, motion, &[], reach, threads);
        let count_on = |measured: &[Measured]| {
            let on = measured.iter().filter(|m| on(m.distance_mm / sigma));
            on.count() as f64
        };
        let here = measure(&fit.motion);
        let all = count_on(&here);
        let sides = self.sides_of(&here, &fit.motion, sigma);
        let off = sides.iter().filter(|side| !on(side.off_mm / sigma));
        let there = off.filter_map(|side| {
            let along = |by: f64| {
                let beside = sides.iter().filter(move |other| {
                    let there = other.off_along(&side.normal);
                    there.is_some_and(|there| on((there - by) / sigma))
                });
                beside.fold((0, 0), |(count, points), s| (count + 1, points + s.points))
            };
            let shift = side.normal * side.off_mm;
            let moved = Pose::shift_mm(shift).after(&fit.motion);
            let (with, points) = along(side.off_mm);
            let (on_it, leave) = along(0.0);
            // Several that are sunk into the part by the same amount, where fewer lie on it: these stand off.
            if side.off_mm < 0.0 && with > on_it.max(1) {
                return Some((shift, moved));
            }
            // As many sides as lie on it say as much as these, however many points each has: what else was scanned must lie on
            // it there, too.
            let is_as_many = on_it > 0 && with >= on_it;
            let share = if is_as_many { FEW } else { SHARE };
            if (points as f64) < share * all {
                return None;
            }
            let other = self.refine_to(scene, &moved, fit::CLOSE * sigma, FLOOR * sigma)?;
            let least = if is_as_many { all - leave as f64 } else { all };
            let as_well = count_on(&measure(&other.motion)) > AS_WELL * least;
            // A chuck's face behind the part goes on beyond it.
            let is_part = || !self.passed(scene, &other.motion).contains(&side.side);
            (as_well && is_part()).then_some((shift, other.motion))
        });
        there.collect()
    }

    /// The fit, or a finer one where there is one.
    pub(super) fn sharp(&self, scene: &Scene, fit: &Fit) -> Fit {
        self.finer(scene, fit).unwrap_or_else(|| fit.clone())
    }

    /// The noise of the sides, where stray points have made the other one much more.
    pub(super) fn sharp_noise(&self, scene: &Scene, fit: &Fit) -> f64 {
        let even = self.evenness(scene, fit);
        even.unwrap_or_else(|| fit.sigma_mm.max(scene.noise_mm))
    }

    /// The fit to the noise of the sides, where stray points have kept it from that, if about as much of the scan lies on the part.
    fn finer(&self, scene: &Scene, fit: &Fit) -> Option<Fit> {
        let even = self.evenness(scene, fit)?;
        let close = fit::CLOSE * fit.sigma_mm;
        let finer = self.refine_to(scene, &fit.motion, close, FLOOR * even)?;
        let near = |fit: &Fit| {
            let (limit, threads) = (fit::INLIER * fit.sigma_mm, self.task.threads);
            let all = measure_within(self.surface, &scene.fine, &fit.motion, &[], limit, threads);
            let near = all.iter().filter(|m| m.distance_mm.abs() < limit);
            near.count() as f64
        };
        (near(&finer) > MOST * near(fit)).then_some(finer)
    }

    /// The noise by how even the sides are that the scan shows, wherever they lie, where that of neighbourhoods is much more: stray
    /// points make it many times as large, and with it the least that is taken for noise.
    fn evenness(&self, scene: &Scene, fit: &Fit) -> Option<f64> {
        let reach = REACH * self.prepared.diagonal;
        let threads = self.task.threads;
        let here = measure_within(self.surface, &scene.fine, &fit.motion, &[], reach, threads);
        let sides = self.by_side(&here, &fit.motion).into_values();
        let mut uneven: Vec<f64> = Vec::new();
        for (mut offs, _) in sides.filter(|(offs, _)| offs.len() >= LEAST) {
            let middle = median(&mut offs);
            uneven.extend(offs.iter().map(|off| (off - middle).abs()));
        }
        let noise = NORMAL * median(&mut uneven);
        let is_less = !uneven.is_empty() && STRAY * noise < scene.noise_mm;
        is_less.then(|| noise.max(1e-7 * self.prepared.diagonal))
    }

    /// The flat sides of the part that the scan shows, each at one distance.
    fn sides_of(&self, measured: &[Measured], motion: &Pose, sigma: f64) -> Vec<Side> {
        let flat = |(side, (mut off, normal)): (u32, (Vec<f64>, Vec3))| {
            let off_mm = median(&mut off);
            let even = off.iter().filter(|d| on((*d - off_mm) / sigma)).count();
            (off.len() >= LEAST && even as f64 >= EVEN * off.len() as f64).then_some(Side {
                side,
                normal,
                off_mm,
                points: off.len(),
            })
        };
        let sides = self.by_side(measured, motion).into_iter();
        sides.filter_map(flat).collect()
    }

    /// By side of the part: how far each point near it lies off, in mm, and which way that is in the scan.
    fn by_side(&self, measured: &[Measured], motion: &Pose) -> BTreeMap<u32, (Vec<f64>, Vec3)> {
        let reach = REACH * self.prepared.diagonal;
        let mut all: BTreeMap<u32, (Vec<f64>, Vec3)> = BTreeMap::new();
        for m in measured.iter().filter(|m| m.distance_mm.abs() < reach) {
            let normal = motion.rotation * self.task.model.triangles()[m.face].normal;
            let side = all.entry(self.prepared.sides[m.face]);
            side.or_insert((Vec::new(), normal)).0.push(m.distance_mm);
        }
        all
    }
}
