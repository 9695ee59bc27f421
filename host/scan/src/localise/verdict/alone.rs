//! Whether a fit is the only one that explains the scan.

use std::cmp::Ordering;

use crate::ScanError;
use crate::localise::degenerate;
use crate::localise::fit::{self, Fit};
use crate::localise::search::pairs::{IN_ITSELF, Proposal};
use crate::localise::search::rough::Points;
use crate::localise::search::scene::Scene;
use crate::localise::uncertainty::{on_faces, white};
use crate::localise::verdict::flat::{only_normal, sliding};
use crate::localise::verdict::rivals::{advantage, compare, explained, off, on, own_share};
use crate::localise::verdict::symmetry::{self, SymmetryAxis};
use crate::localise::verdict::{Decided, Explained, Judge, count, no_fit};
use crate::rigid::{Pose, Vec3, rotation};
use crate::solve::measure_within;

/// What else explains a scan.
enum Rivals {
    None,
    /// One beside it as well, on the other side of a thin wall: with the refusal.
    Beside(ScanError),
    /// These as well, by these axes of the part.
    Equal(Vec<SymmetryAxis>, Vec<Pose>),
    Better(Fit),
}

/// From how far a pose is refined that is held against the best one.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// From what is known to be about right: what the search found.
    Wide,
    /// From what is right to a few times the noise, if at all: beside the best one.
    Close,
    /// A turn of the part on itself may be either.
    Both,
}

/// How often a better pose takes the place of the best one at most.
const BETTER: usize = 6;

impl Judge<'_> {
    /// The best fit if no other explains the scan as well.
    pub(in crate::localise) fn only_one(
        &self,
        scene: &Scene,
        fits: &[Fit],
    ) -> Result<Decided, ScanError> {
        let mut best = fits[0].clone();
        // A rival may turn out to be better than what stood first by the mere number of points.
        for _ in 0..BETTER {
            match self.rivals(scene, fits, &best)? {
                rivals @ (Rivals::None | Rivals::Beside(_)) => {
                    let beside = match rivals {
                        Rivals::Beside(refusal) => Some(refusal),
                        _ => None,
                    };
                    return Ok(Decided {
                        fit: best,
                        symmetries: Vec::new(),
                        all: fits.iter().map(|fit| fit.motion).collect(),
                        cell_mm: scene.cell_mm,
                        beside,
                        aside: None,
                        doubts: Vec::new(),
                    });
                }
                Rivals::Equal(axes, equal) => {
                    let mut decided = self.alike(scene, &best, axes, &equal)?;
                    decided.all.extend(fits.iter().map(|fit| fit.motion));
                    return Ok(decided);
                }
                Rivals::Better(better) => best = better,
            }
        }
        Err(no_fit())
    }

    /// The poses that explain the scan as well as `best`.
    fn rivals(&self, scene: &Scene, fits: &[Fit], best: &Fit) -> Result<Rivals, ScanError> {
        let threads = self.task.threads;
        let sigma = self.noise(scene, best);
        let own = off(self.part(), &scene.fine, &best.motion, sigma, threads);
        let explained_own: Vec<bool> = own.off.iter().map(|o| on(*o)).collect();
        let reach = fit::INLIER * sigma;
        let measured = measure_within(self.surface, &scene.fine, &best.motion, &[], reach, threads);
        let held: Vec<usize> = (0..own.off.len()).filter(|&i| explained_own[i]).collect();
        let held = on_faces(
            self.surface,
            &scene.fine,
            &measured,
            &held,
            &best.motion,
            sigma,
            threads,
        );
        let sure = white(&scene.fine, &measured, &held, &best.motion, sigma);
        let thinned = scene.at();
        let here = self.explained(scene, &thinned, best);
        let held_fine = Explained {
            points: explained_own,
            sigma_mm: sigma,
        };
        let own_passed = self.passed(scene, &best.motion);
        let mut tried = vec![best.motion];
        let mut equal: Vec<Pose> = Vec::new();
        // Poses that are nearer to each other are one.
        let (same, beside) = (0.02 * self.prepared.diagonal, fit::CLOSE * sigma);
        // Some if it is better.
        let mut try_one = |motion: &Pose, way: Way, equal: &mut Vec<Pose>| -> Option<Fit> {
            let same = if way == Way::Close { beside } else { same };
            let is_known = |tried: &[Pose], equal: &[Pose], motion: &Pose| {
                let apart = |t: &Pose| t.apart_mm(motion, &self.prepared.corners);
                tried.iter().chain(equal).any(|t| apart(t) < same)
            };
            if is_known(&tried, equal, motion) {
                return None;
            }
            // Most turns of a part are far from fitting: seen without refining all points.
            let wide = (way != Way::Close)
                .then(|| self.tried(scene, &thinned, motion, 0.03, &here))
                .flatten();
            let wide = wide.filter(|rough| {
                !is_known(&tried, equal, rough)
                    && !self.is_clearly_less(&scene.fine, rough, &held_fine)
            });
            let wide = wide.and_then(|rough| self.refine(scene, &rough));
            // Where a face of what was scanned stands off, so wide a reach ends between that face and the others.
            let close = (way != Way::Wide && !self.is_clearly_less(&thinned, motion, &here))
                .then(|| self.refine_within(scene, motion, beside));
            let fit = [wide, close.flatten()]
                .into_iter()
                .flatten()
                .filter(|fit| !is_known(&tried, equal, &fit.motion))
                .max_by_key(|fit| fit.inliers)?;
            // What is beside the best one says nothing of what is farther.
            if way != Way::Close {
                tried.push(fit.motion);
            }
            let other = off(self.part(), &scene.fine, &fit.motion, sigma, threads);
            let turn = best.motion.inverse().after(&fit.motion);
            let samples = &self.prepared.samples;
            let share = own_share(self.part(), samples, &turn, sigma, threads);
            let passed = [&own_passed, &self.passed(scene, &fit.motion)];
            match compare(&own, &other, share, &self.prepared.sides, passed) {
                Ordering::Greater => None,
                Ordering::Equal => {
                    equal.push(fit.motion);
                    None
                }
                Ordering::Less => Some(fit),
            }
        };
        // On the other side of a thin wall: first, as a fit there may seem to be free.
        let mut across: Vec<Pose> = Vec::new();
        for shift in &self.prepared.shifts {
            let motion = best.motion.after(&Pose::shift_mm(*shift));
            if let Some(better) = try_one(&motion, Way::Close, &mut across) {
                return Ok(Rivals::Better(better));
            }
        }
        if let Some(axis) = self.only_side(scene, &best.motion, sigma) {
            return Err(degenerate(&sliding(&axis), &sure.about_mm, "part"));
        }
        if !sure.free.is_empty() {
            let (axis, alike) = self.free(scene, best, &held_fine.points, sigma, &sure)?;
            return Ok(Rivals::Equal(vec![axis], alike));
        }
        let others = fits.iter().map(|fit| fit.motion);
        let turned = self.turns().into_iter().map(|own| best.motion.after(&own));
        let others = others.map(|motion| (motion, Way::Wide));
        let turned = turned.map(|motion| (motion, Way::Both));
        for (motion, way) in others.chain(turned) {
            if let Some(better) = try_one(&motion, way, &mut equal) {
                return Ok(Rivals::Better(better));
            }
        }
        // What two of them make together is one more.
        for _ in 0..2 {
            let known = equal.clone();
            for (a, b) in known.iter().flat_map(|a| known.iter().map(move |b| (a, b))) {
                if equal.len() < 24 {
                    let turn = best.motion.inverse().after(a);
                    if let Some(better) = try_one(&b.after(&turn), Way::Wide, &mut equal) {
                        return Ok(Rivals::Better(better));
                    }
                }
            }
        }
        if equal.is_empty() {
            let poses: Vec<Pose> = std::iter::once(best.motion).chain(across).collect();
            return Ok(match poses.len() {
                1 => Rivals::None,
                _ => Rivals::Beside(symmetry::ambiguous(
                    &[],
                    &poses,
                    "the scan looks the same from the other side of a thin wall or step of the part",
                    "scan what tells the two apart: edges, and both sides of the wall",
                )),
            });
        }
        let motions: Vec<Pose> = equal
            .iter()
            .map(|m| best.motion.inverse().after(m))
            .collect();
        Ok(Rivals::Equal(
            symmetry::axes(&motions, &self.prepared.corners),
            equal,
        ))
    }

    /// The normal of the only side that the scan shows of the part, if it shows but one. Along such a side only the
    /// outline holds the part, and an outline is far worse than the noise of the points claims.
    pub(in crate::localise) fn only_side(
        &self,
        scene: &Scene,
        motion: &Pose,
        sigma: f64,
    ) -> Option<Vec3> {
        let own = explained(self.part(), &scene.at(), motion, sigma, self.task.threads);
        let shown = scene.places.iter().zip(own).filter(|(_, own)| *own);
        only_normal(shown.map(|(o, _)| o.normal))
    }

    /// Turns of the part that leave half of it about where it was.
    fn turns(&self) -> Vec<Pose> {
        let prepared = &self.prepared;
        let mut all: Vec<Proposal> = symmetry::candidates(prepared)
            .into_iter()
            .map(|motion| Proposal { motion, score: 0.0 })
            .chain(prepared.search(&prepared.samples, 60, &IN_ITSELF, self.task.threads))
            .collect();
        let samples = Points::new(prepared.samples.iter());
        for proposal in &mut all {
            proposal.score = prepared.rough.score(&samples, &proposal.motion);
        }
        let whole = prepared.rough.score(&samples, &Pose::identity());
        crate::localise::search::pairs::sort(&mut all);
        prepared
            .distinct(&all, 40, 0.05)
            .into_iter()
            .filter(|p| p.score > 0.45 * whole)
            .map(|p| p.motion)
            .collect()
    }

    /// A motion is free: an axis of the part, or a scan that shows too little.
    fn free(
        &self,
        scene: &Scene,
        best: &Fit,
        own: &[bool],
        sigma: f64,
        sure: &crate::localise::Certainty,
    ) -> Result<(SymmetryAxis, Vec<Pose>), ScanError> {
        let [v] = sure.free.as_slice() else {
            return Err(degenerate(&sure.free, &sure.about_mm, "part"));
        };
        let w = Vec3::new(v[0], v[1], v[2]);
        let d = Vec3::new(v[3], v[4], v[5]);
        if w.norm() * self.prepared.diagonal < 0.05 * d.norm() {
            return Err(degenerate(&sure.free, &sure.about_mm, "part"));
        }
        let direction = w.normalize();
        // q moves by w × (q − about) + d: none of it on the axis.
        let point = sure.about_mm + w.cross(&d) / w.norm_squared();
        let turned = |angle: f64| {
            let r = rotation(&(direction * angle));
            Pose {
                rotation: r * best.motion.rotation,
                translation_mm: r * (best.motion.translation_mm - point) + point,
            }
        };
        let alike: Vec<Pose> = [1.0, 2.1, 3.2, 4.3, 5.4]
            .iter()
            .map(|angle| turned(*angle))
            .filter_map(|motion| self.refine(scene, &motion))
            .filter(|fit| {
                let other = explained(
                    self.part(),
                    &scene.fine,
                    &fit.motion,
                    sigma,
                    self.task.threads,
                );
                let (more, chance) = advantage(own, &other);
                more < chance + 0.01 * count(own) as f64
            })
            .map(|fit| fit.motion)
            .collect();
        if alike.len() < 5 {
            return Err(degenerate(&sure.free, &sure.about_mm, "part"));
        }
        let axis = SymmetryAxis {
            axis: best.motion.rotation.tr_mul(&direction),
            point_mm: best.motion.undo(&point),
            order: 0,
        };
        Ok((axis, alike))
    }

    fn alike(
        &self,
        scene: &Scene,
        best: &Fit,
        axes: Vec<SymmetryAxis>,
        equal: &[Pose],
    ) -> Result<Decided, ScanError> {
        if self.task.accept_symmetry {
            return Ok(Decided {
                fit: best.clone(),
                symmetries: axes,
                all: Vec::new(),
                cell_mm: scene.cell_mm,
                beside: None,
                aside: None,
                doubts: Vec::new(),
            });
        }
        let poses: Vec<Pose> = std::iter::once(&best.motion)
            .chain(equal)
            .copied()
            .collect();
        Err(symmetry::ambiguous(
            &axes,
            &poses,
            "the scan looks the same in other poses of the part",
            if self.task.start.is_some() {
                "scan what tells them apart, or say --accept-symmetry: the one that the start leads to is taken then"
            } else {
                "scan what tells them apart, or say --accept-symmetry if any of them will do"
            },
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::tests::{Random, prism, scan, task};
    use crate::surface::CompositeSurface;

    /// A bent sheet, seen from outside: on the inner sides of its legs lie nearly as many points.
    #[test]
    fn a_fit_one_thickness_beside_its_place_finds_it() {
        let outline = [
            [0.0, 0.0],
            [60.0, 0.0],
            [60.0, 1.0],
            [1.0, 1.0],
            [1.0, 40.0],
            [0.0, 40.0],
        ];
        let sheet = prism(&outline, &[[0, 1, 2, 3], [0, 3, 4, 5]], 30.0, [0.0, 0.0]);
        let mut random = Random(32);
        for by in [[-1.0, 0.0], [0.0, -1.0], [-1.0, -1.0]] {
            let truth = random.pose();
            let eye = Vec3::new(-0.6, -0.5, 0.6);
            let points = scan(&sheet, 4000, 0.01, &truth, &mut random, |n| {
                n.dot(&eye) > 0.1
            });
            let task = task(&sheet, &points);
            let surface = CompositeSurface::from(sheet.clone());
            let judge = Judge::new(&task, &surface);
            let scene = Scene::new(&sheet, &points, task.threads);
            let shift = Pose::shift_mm(Vec3::new(by[0], by[1], 0.0));
            let mut beside = judge.refine(&scene, &truth).unwrap();
            beside.motion = truth.after(&shift);
            let found = judge.only_one(&scene, &[beside]).unwrap();
            let off = found.fit.motion.apart_mm(&truth, &sheet.corners());
            assert!(off < 0.02, "{by:?}: {off} mm off");
        }
    }
}
