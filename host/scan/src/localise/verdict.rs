//! What the best fit is worth: whether it fits at all, whether another pose, a mirror image or another scale fits as well.

use nalgebra::{Matrix3, Vector6};

use super::fit::{self, Fit};
use super::oriented::from_seed;
use super::pairs::{Prepared, Proposal};
use super::rivals::{advantage, explained};
use super::scene::{Scene, coverage};
use super::symmetry::{self, SymmetryAxis};
use super::uncertainty::{Groups, certainty};
use super::{LocaliseTask, degenerate};
use crate::ScanError;
use crate::rigid::{Pose, Vec3, rotation};
use crate::solve::{eigen, measure};
use crate::surface::CompositeSurface;

/// A pose that stands.
pub(super) struct Decided {
    pub fit: Fit,
    pub symmetries: Vec<SymmetryAxis>,
}

/// Points that a pose is refined with before it is compared.
const COMPARED: usize = 6000;
/// Points that a pose is first tried with.
const TRIED: usize = 900;
/// Poses that are refined.
const REFINED: usize = 36;
/// The share of the part's surface that a scan must show.
const SHOWN: f64 = 0.08;
/// The share of the scan's points that must lie on the part.
const SHARE: f64 = 0.03;
/// Units that a file can be in by mistake: how many mm, name.
pub(super) const UNITS: [(f64, &str); 5] = [
    (25.4, "inches"),
    (1000.0, "metres"),
    (10.0, "centimetres"),
    (1.0 / 25.4, "mm that were taken for inches"),
    (0.001, "micrometres"),
];

struct Judge<'a> {
    task: &'a LocaliseTask<'a>,
    surface: &'a CompositeSurface,
    prepared: Prepared,
}

/// How a fit is worth it.
enum Worth {
    Good,
    /// The share of the surface that is shown.
    Little(f64),
    Bad,
}

pub(super) fn decide(
    task: &LocaliseTask<'_>,
    surface: &CompositeSurface,
) -> Result<Decided, ScanError> {
    let judge = Judge {
        task,
        surface,
        prepared: Prepared::new(task.model, task.threads),
    };
    let scene = Scene::new(task.model, &from_seed(task.points, task.seed), task.threads);
    let fits = judge.fits(&scene);
    let worth = fits
        .first()
        .map_or(Worth::Bad, |best| judge.worth(&scene, best));
    if !matches!(worth, Worth::Good) {
        judge.other_scale()?;
        judge.mirrored(&scene, fits.first())?;
    }
    let Some(best) = fits.first() else {
        return Err(no_fit());
    };
    match worth {
        Worth::Bad => return Err(no_fit()),
        Worth::Little(shown) => {
            return Err(ScanError::refused(
                "too_little_overlap",
                format_args!(
                    "the scan shows {:.1} % of the part's surface at best: too little to tell where it is; scan more of it",
                    shown * 100.0
                ),
            )
            .with("overlap", shown));
        }
        Worth::Good => {}
    }
    judge.mirrored(&scene, Some(best))?;
    judge.only_one(&scene, &fits)
}

/// The refusal of a scan in another unit.
pub(super) fn wrong_scale(factor: f64, unit: &str) -> ScanError {
    ScanError::refused(
        "wrong_scale",
        format_args!(
            "the scan fits {factor:.6} times as large: it looks like {unit}; say --unit, or export it in mm"
        ),
    )
    .with("factor", factor)
    .with("unit", unit)
}

fn no_fit() -> ScanError {
    ScanError::refused(
        "no_fit",
        "the part is not in this scan, or not as the model has it: no pose explains the points to within their noise",
    )
}

impl Judge<'_> {
    /// The best distinct fits of the part in a scene, best first.
    fn fits(&self, scene: &Scene) -> Vec<Fit> {
        let proposals = self
            .prepared
            .search(&scene.places, REFINED, self.task.threads);
        let thinned: Vec<Vec3> = scene.places.iter().map(|o| o.at).collect();
        let reach = self.prepared.diagonal * 0.05;
        let one = crate::parallel::Threads::new(1);
        let floor = self.floor(scene);
        let rough = self.task.threads.each(proposals.len(), |i| {
            let few = self.around(&thinned, &proposals[i].motion);
            fit::settle(
                self.surface,
                &few,
                &proposals[i].motion,
                reach,
                floor,
                3,
                one,
            )
        });
        let mut rough: Vec<Fit> = rough.into_iter().flatten().collect();
        // One measure for all: what lies within a few times the least noise that any of them has.
        let sigma = self.common(&rough, scene);
        for fit in &mut rough {
            fit.inliers = count(&explained(
                self.surface,
                &thinned,
                &fit.motion,
                sigma,
                self.task.threads,
            ));
        }
        super::rivals::sort(&mut rough);
        let mut fits: Vec<Fit> = Vec::new();
        for fit in rough {
            if fits.len() >= 6 {
                break;
            }
            if self.is_new(&fits, &fit.motion)
                && let Some(fine) = self.refine(scene, &fit.motion)
                && self.is_new(&fits, &fine.motion)
            {
                fits.push(fine);
            }
        }
        let sigma = self.common(&fits, scene);
        for fit in &mut fits {
            fit.inliers = count(&explained(
                self.surface,
                &scene.fine,
                &fit.motion,
                sigma,
                self.task.threads,
            ));
        }
        super::rivals::sort(&mut fits);
        fits
    }

    /// Points about where `motion` puts the part, few enough to try many poses.
    fn around(&self, points: &[Vec3], motion: &Pose) -> Vec<Vec3> {
        let limit = 0.15 * self.prepared.diagonal;
        let near: Vec<Vec3> = points
            .iter()
            .filter(|q| {
                let distance = self.prepared.field.at(&motion.undo(q));
                distance.is_some_and(|(d, _)| d.abs() < limit)
            })
            .copied()
            .collect();
        super::pairs::spread(near.len(), TRIED)
            .into_iter()
            .map(|i| near[i])
            .collect()
    }

    fn floor(&self, scene: &Scene) -> f64 {
        (scene.noise_mm * 0.3).max(self.prepared.diagonal * 1e-7)
    }

    /// The noise by which fits are compared.
    fn common(&self, fits: &[Fit], scene: &Scene) -> f64 {
        fits.iter()
            .map(|fit| fit.sigma_mm)
            .fold(f64::INFINITY, f64::min)
            .clamp(
                scene.noise_mm,
                scene.noise_mm * 2.0 + self.prepared.diagonal * 2e-3,
            )
    }

    fn is_new(&self, fits: &[Fit], motion: &Pose) -> bool {
        fits.iter().all(|fit| {
            fit.motion.apart_mm(motion, &self.prepared.corners) > 0.02 * self.prepared.diagonal
        })
    }

    fn refine(&self, scene: &Scene, motion: &Pose) -> Option<Fit> {
        // Enough to tell poses apart; what is printed uses all points.
        let few: Vec<Vec3> = super::pairs::spread(scene.fine.len(), COMPARED)
            .into_iter()
            .map(|i| scene.fine[i])
            .collect();
        let reach = self.prepared.diagonal * 0.01 + 4.0 * scene.noise_mm;
        fit::settle(
            self.surface,
            &few,
            motion,
            reach,
            self.floor(scene),
            8,
            self.task.threads,
        )
    }

    fn worth(&self, scene: &Scene, fit: &Fit) -> Worth {
        let measured = measure(
            self.surface,
            &scene.fine,
            &fit.motion,
            &[],
            self.task.threads,
        );
        let within = |low: f64, high: f64| {
            measured
                .iter()
                .filter(|m| (low..high).contains(&(m.distance_mm.abs() / fit.sigma_mm)))
                .count() as f64
        };
        let on = within(0.0, fit::INLIER);
        // A wrong pose has as many points a little off the surface as on it.
        let beside = within(fit::INLIER, 3.0 * fit::INLIER);
        let inside = measured
            .iter()
            .filter(|m| m.distance_mm < -3.0 * fit::INLIER * fit.sigma_mm)
            .count() as f64;
        let noisy = fit.sigma_mm > 3.0 * scene.noise_mm + self.prepared.diagonal / 400.0
            || fit.sigma_mm > self.prepared.diagonal / 60.0;
        if noisy
            || on < 20.0
            || on < 1.5 * beside
            || inside > 0.25 * on
            || on < SHARE * scene.fine.len() as f64
        {
            return Worth::Bad;
        }
        let shown: Vec<Vec3> = measured
            .iter()
            .zip(&scene.fine)
            .filter(|(m, _)| m.distance_mm.abs() < fit::INLIER * fit.sigma_mm)
            .map(|(_, q)| fit.motion.undo(q))
            .collect();
        let shown = coverage(self.task.model, &shown);
        if shown < SHOWN {
            Worth::Little(shown)
        } else {
            Worth::Good
        }
    }

    /// Refuses if the scan fits in another unit.
    fn other_scale(&self) -> Result<(), ScanError> {
        let (low, high) = crate::surface::bounds(self.task.points.iter());
        let size = (high - low).norm();
        for (factor, name) in UNITS {
            let ratio = size * factor / self.prepared.diagonal;
            if !(0.3..30.0).contains(&ratio) {
                continue;
            }
            let points: Vec<Vec3> = self
                .task
                .points
                .iter()
                .map(|p| (p - low) * factor)
                .collect();
            let scene = Scene::new(self.task.model, &points, self.task.threads);
            let fits = self.fits(&scene);
            if fits
                .first()
                .is_some_and(|fit| matches!(self.worth(&scene, fit), Worth::Good))
            {
                return Err(wrong_scale(factor, name));
            }
        }
        Ok(())
    }

    /// Refuses if the mirror image fits better.
    fn mirrored(&self, scene: &Scene, best: Option<&Fit>) -> Result<(), ScanError> {
        let seen = best.map(|fit| {
            let sigma = fit.sigma_mm.max(scene.noise_mm);
            explained(
                self.surface,
                &scene.fine,
                &fit.motion,
                sigma,
                self.task.threads,
            )
        });
        if seen
            .as_ref()
            .is_some_and(|seen| count(seen) as f64 > 0.985 * seen.len() as f64)
        {
            return Ok(());
        }
        let mirrored = scene.mirrored();
        let fits = self.fits(&mirrored);
        let Some(other) = fits
            .first()
            .filter(|fit| matches!(self.worth(&mirrored, fit), Worth::Good))
        else {
            return Ok(());
        };
        let sigma = best
            .map_or(f64::INFINITY, |fit| fit.sigma_mm)
            .min(other.sigma_mm)
            .max(scene.noise_mm);
        let there = explained(
            self.surface,
            &mirrored.fine,
            &other.motion,
            sigma,
            self.task.threads,
        );
        let here = best.map(|fit| {
            explained(
                self.surface,
                &scene.fine,
                &fit.motion,
                sigma,
                self.task.threads,
            )
        });
        let better = here.is_none_or(|here| {
            let (more, chance) = advantage(&there, &here);
            more > chance + 0.01 * count(&there) as f64
        });
        if better {
            return Err(ScanError::refused(
                "mirrored",
                "the mirror image of the part fits the scan, the part does not: a left hand for a right one, or an axis of the scanner with its sign lost",
            ));
        }
        Ok(())
    }

    /// The best fit if no other explains the scan as well.
    fn only_one(&self, scene: &Scene, fits: &[Fit]) -> Result<Decided, ScanError> {
        let threads = self.task.threads;
        let best = &fits[0];
        let sigma = best.sigma_mm.max(scene.noise_mm);
        let own = explained(self.surface, &scene.fine, &best.motion, sigma, threads);
        let measured = measure(self.surface, &scene.fine, &best.motion, &[], threads);
        let on: Vec<usize> = (0..own.len()).filter(|&i| own[i]).collect();
        let mut sure = certainty(
            &scene.fine,
            &measured,
            &on,
            &best.motion,
            sigma,
            Groups::default(),
        );
        if let Some(axis) = self.only_side(scene, &best.motion, sigma) {
            sure.free = sliding(&axis);
            return Err(degenerate(&sure, "part"));
        }
        if !sure.free.is_empty() {
            return self.free(scene, best, &own, sigma, &sure);
        }
        let thinned: Vec<Vec3> = scene.places.iter().map(|o| o.at).collect();
        let reach = 0.03 * self.prepared.diagonal;
        let mut tried = vec![best.motion];
        let mut equal: Vec<Pose> = Vec::new();
        let mut try_one = |motion: &Pose, equal: &mut Vec<Pose>| {
            // Most turns of a part are far from fitting: seen without refining all points.
            let rough = fit::settle(
                self.surface,
                &self.around(&thinned, motion),
                motion,
                reach,
                self.floor(scene),
                3,
                threads,
            );
            let Some(rough) = rough else {
                return;
            };
            let other = explained(
                self.surface,
                &scene.fine,
                &rough.motion,
                2.0 * sigma,
                threads,
            );
            let (more, chance) = advantage(&own, &other);
            if more > 2.0 * chance + 0.15 * on.len() as f64 {
                return;
            }
            let Some(fit) = self.refine(scene, &rough.motion) else {
                return;
            };
            if tried.iter().any(|t| {
                t.apart_mm(&fit.motion, &self.prepared.corners) < 0.02 * self.prepared.diagonal
            }) {
                return;
            }
            tried.push(fit.motion);
            let other = explained(self.surface, &scene.fine, &fit.motion, sigma, threads);
            let (more, chance) = advantage(&own, &other);
            if more < chance {
                equal.push(fit.motion);
            }
        };
        for fit in &fits[1..] {
            try_one(&fit.motion, &mut equal);
        }
        for own_turn in self.turns() {
            try_one(&best.motion.after(&own_turn), &mut equal);
        }
        // What two of them make together is one more.
        for _ in 0..2 {
            let known = equal.clone();
            for a in &known {
                for b in &known {
                    if equal.len() < 24 {
                        let turn = best.motion.inverse().after(a);
                        try_one(&b.after(&turn), &mut equal);
                    }
                }
            }
        }
        if equal.is_empty() {
            return Ok(Decided {
                fit: best.clone(),
                symmetries: Vec::new(),
            });
        }
        let motions: Vec<Pose> = equal
            .iter()
            .map(|m| best.motion.inverse().after(m))
            .collect();
        let axes = symmetry::axes(&motions);
        self.alike(best, axes, &equal)
    }

    /// The normal of the only side that the scan shows of the part, if it shows but one. Along such a side only the
    /// outline holds the part, and an outline is far worse than the noise of the points claims.
    fn only_side(&self, scene: &Scene, motion: &Pose, sigma: f64) -> Option<Vec3> {
        let at: Vec<Vec3> = scene.places.iter().map(|o| o.at).collect();
        let own = explained(self.surface, &at, motion, sigma, self.task.threads);
        let spread: Matrix3<f64> = scene
            .places
            .iter()
            .zip(own)
            .filter(|(_, own)| *own)
            .map(|(o, _)| o.normal * o.normal.transpose())
            .sum();
        let (values, vectors) = eigen(&spread);
        (values[1] < ONE_SIDE * values[2]).then(|| vectors.column(2).into_owned())
    }

    /// Turns of the part that leave half of it about where it was.
    fn turns(&self) -> Vec<Pose> {
        let prepared = &self.prepared;
        let mut all: Vec<Proposal> = symmetry::candidates(prepared)
            .into_iter()
            .map(|motion| Proposal { motion, score: 0.0 })
            .chain(prepared.search(&prepared.samples, 60, self.task.threads))
            .collect();
        for proposal in &mut all {
            proposal.score = prepared.score(&prepared.samples, &proposal.motion);
        }
        let whole = prepared.score(&prepared.samples, &Pose::identity());
        super::pairs::sort(&mut all);
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
        sure: &super::Certainty,
    ) -> Result<Decided, ScanError> {
        let [v] = sure.free.as_slice() else {
            return Err(degenerate(sure, "part"));
        };
        let w = Vec3::new(v[0], v[1], v[2]);
        let d = Vec3::new(v[3], v[4], v[5]);
        if w.norm() * self.prepared.diagonal < 0.05 * d.norm() {
            return Err(degenerate(sure, "part"));
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
                    self.surface,
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
            return Err(degenerate(sure, "part"));
        }
        let axis = SymmetryAxis {
            axis: best.motion.rotation.tr_mul(&direction),
            point_mm: best.motion.undo(&point),
            order: 0,
        };
        self.alike(best, vec![axis], &alike)
    }

    fn alike(
        &self,
        best: &Fit,
        axes: Vec<SymmetryAxis>,
        equal: &[Pose],
    ) -> Result<Decided, ScanError> {
        if self.task.accept_symmetry {
            return Ok(Decided {
                fit: best.clone(),
                symmetries: axes,
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
            "scan what tells them apart, or say --accept-symmetry if any of them will do",
        ))
    }
}

/// How many.
fn count(seen: &[bool]) -> usize {
    seen.iter().filter(|s| **s).count()
}

/// A scan shows one side if its normals spread less than this to all others, in squares.
const ONE_SIDE: f64 = 0.01;

/// What a flat side leaves free: both shifts along it, and the turn about its normal.
fn sliding(normal: &Vec3) -> Vec<Vector6<f64>> {
    let along = normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize();
    let across = normal.cross(&along);
    let shift = |v: &Vec3| Vector6::new(0.0, 0.0, 0.0, v.x, v.y, v.z);
    let turn = Vector6::new(normal.x, normal.y, normal.z, 0.0, 0.0, 0.0);
    vec![shift(&along), shift(&across), turn]
}
