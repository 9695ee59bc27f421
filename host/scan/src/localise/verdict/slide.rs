//! Fits moved along what hardly holds them.
//!
//! A long part of one section lies nearly as well a few millimetres along itself: only its ends say where it is, and a
//! refinement that begins beside them does not see them.

use nalgebra::{Matrix6, Vector6};

use super::{Explained, JUDGING, Judge};
use crate::localise::fit::{self, Fit};
use crate::localise::search::pairs::spread;
use crate::localise::search::scene::Scene;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::{eigen, measure_within};

/// Fits that are tried, and of each so many of the motions that are held least.
const FITS: usize = 3;
const MOTIONS: usize = 2;
/// How far, over the part's diagonal.
const FAR: f64 = 0.2;
/// How far from their place moved fits are, over the diagonal.
const NEAR: f64 = 0.02;
/// Points that say how well a pose is held.
const HOLDING: usize = 3000;
/// A moved pose is refined if this share of what speaks for the fit speaks for it.
const AS_GOOD: f64 = 0.97;

impl Judge<'_> {
    /// Refined fits beside the best of these, where the part can slide or turn along itself.
    /// Those that explain clearly less than what is known are left out.
    pub(super) fn slid(&self, scene: &Scene, fits: &[Fit], than: Option<&Explained>) -> Vec<Fit> {
        let judging = scene.some(JUDGING);
        let step = self.prepared.rough.coarse_mm() / 2.0;
        let far = (FAR * self.prepared.diagonal / step) as i32;
        let beside = fits.iter().take(FITS).flat_map(|fit| {
            let least = AS_GOOD * self.prepared.rough.score(&judging, &fit.motion);
            let ways = self.held_least(scene, fit);
            let judging = &judging;
            ways.into_iter().filter_map(move |way| {
                let moved = (-far..=far).filter(|k| k.abs() > 2).map(|k| {
                    let motion = way.at(&fit.motion, f64::from(k) * step);
                    (self.prepared.rough.score(judging, &motion), motion)
                });
                moved
                    .max_by(|a, b| a.0.total_cmp(&b.0))
                    .filter(|(score, _)| *score > least)
            })
        });
        let thinned = scene.at();
        let tried = beside.filter_map(|(_, motion)| match than {
            Some(than) => self.tried(scene, &thinned, &motion, NEAR, than),
            None => Some(motion),
        });
        tried
            .filter_map(|motion| self.refine(scene, &motion))
            .collect()
    }

    /// The motions that the points on the part hold least; those on a side that the scan goes beyond are of another body,
    /// and hold nothing.
    fn held_least(&self, scene: &Scene, fit: &Fit) -> Vec<Way> {
        let points: Vec<Vec3> = spread(scene.fine.len(), HOLDING)
            .into_iter()
            .map(|i| scene.fine[i])
            .collect();
        let reach = fit::INLIER * fit.sigma_mm;
        let threads = self.task.threads;
        let measured = measure_within(self.surface, &points, &fit.motion, &[], reach, threads);
        let about = fit
            .motion
            .point(&(self.prepared.corners.iter().sum::<Vec3>() / 8.0));
        let arm = self.prepared.diagonal / 2.0;
        let passed = self.passed(scene, &fit.motion);
        let mut h = Matrix6::zeros();
        for (q, m) in points.iter().zip(&measured) {
            if m.distance_mm.abs() < reach && !passed.contains(&self.prepared.sides[m.face]) {
                let row = fit::row(q, m, &about, arm);
                h += row * row.transpose();
            }
        }
        let (_, ways) = eigen(&h);
        let way = |k| Way {
            about,
            step: Vector6::from_fn(|i, _| ways[(i, k)] / if i < 3 { arm } else { 1.0 }),
        };
        (0..MOTIONS).map(way).collect()
    }
}

/// A motion by 1 mm, at the part's ends if it turns.
struct Way {
    about: Vec3,
    step: Vector6<f64>,
}

impl Way {
    fn at(&self, motion: &Pose, mm: f64) -> Pose {
        stepped(motion, &(self.step * mm), &self.about)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::tests::{Random, prism, scan, task};
    use crate::surface::CompositeSurface;

    /// A stepped bar a few millimetres beside its place, along itself: the refinement stays there, the slide comes back.
    #[test]
    fn a_bar_slides_back_to_its_ends() {
        slides_back(false);
    }

    /// The same where the end that is wrong lies flush in the face of another body: that face holds the bar there.
    #[test]
    fn a_bar_slides_back_from_the_face_of_another_body() {
        slides_back(true);
    }

    fn slides_back(flush: bool) {
        let outline = [
            [0.0, 0.0],
            [25.0, 0.0],
            [25.0, 25.0],
            [15.0, 25.0],
            [15.0, 40.0],
            [0.0, 40.0],
        ];
        let bar = prism(&outline, &[[0, 1, 2, 3], [0, 3, 4, 5]], 76.0, [0.0, 0.0]);
        let mut random = Random(3);
        for mm in [-12.0, -7.0, 7.0, 12.0] {
            let truth = random.pose();
            let mut points = scan(&bar, 9000, 0.1, &truth, &mut random, |_| true);
            if flush {
                let end = if mm < 0.0 { mm } else { 76.0 + mm };
                let face = (0..6400).map(|i| {
                    let at = |k: i32| f64::from(k) - 40.0;
                    truth.point(&Vec3::new(at(i % 80) + 12.5, at(i / 80) + 20.0, end))
                });
                points.extend(face);
            }
            let task = task(&bar, &points);
            let surface = CompositeSurface::from(bar.clone());
            let judge = Judge::new(&task, &surface);
            let scene = Scene::new(&bar, &points, task.threads);
            let beside = truth.after(&Pose::shift_mm(Vec3::new(0.0, 0.0, mm)));
            let fit = judge.refine(&scene, &beside).unwrap();
            let off = |fit: &Fit| fit.motion.apart_mm(&truth, &judge.prepared.corners);
            assert!(off(&fit) > 2.0, "{mm}: {}", off(&fit));
            let slid = judge.slid(&scene, &[fit], None);
            assert!(slid.iter().any(|fit| off(fit) < 0.1), "{mm}");
        }
    }
}
