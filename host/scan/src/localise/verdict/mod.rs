//! What the best fit is worth: whether it fits at all, whether another pose, a mirror image or another scale fits as well.

mod account;
pub(super) mod again;
mod alone;
mod aside;
pub(super) mod each;
pub(super) mod flat;
pub(super) mod rivals;
mod shrunk;
mod slide;
pub(super) mod symmetry;
mod twin;

use std::collections::HashSet;

use super::{LocaliseTask, Located, degenerate, not_near};
use crate::ScanError;
use crate::localise::fit::{self, Approach, Fit};
use crate::localise::search::field::HeightField;
use crate::localise::search::oriented::from_seed;
use crate::localise::search::pairs::{IN_A_SCAN, Prepared};
use crate::localise::search::scene::{self, Scene, cell_mm, coverage};
use crate::localise::uncertainty::{on_faces, white};
use crate::localise::verdict::flat::{only_normal, sliding};
use crate::localise::verdict::rivals::rims::{Rim, passed, rims};
use crate::localise::verdict::rivals::{
    Standing, advantage, clear_advantage, explained, is_clearly_off, is_within, off, on, sort,
};
use crate::localise::verdict::symmetry::SymmetryAxis;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::measure_within;
use crate::surface::CompositeSurface;

/// A pose that stands.
#[derive(Clone)]
pub(super) struct Decided {
    pub fit: Fit,
    pub symmetries: Vec<SymmetryAxis>,
    /// All that was found beside it, and itself.
    pub all: Vec<Pose>,
    /// As [`Scene::cell_mm`] of the scan.
    pub cell_mm: f64,
    /// The refusal of a part that lies as well on the other side of a wall.
    pub beside: Option<ScanError>,
    /// The refusal of a part that lies as well on a face that stands off, where that is not by its size.
    pub aside: Option<ScanError>,
    /// Ways that the part may be off by, as a face that stands off by little says, in the scan, in mm.
    pub doubts: Vec<Vec3>,
}

impl Decided {
    /// Why what the end came to is no answer: the part lies as well beside it. Nothing of a face that stands off where the
    /// verdict is NG without that, as by the size.
    pub fn refusal(&self, located: &Located) -> Option<ScanError> {
        let aside = self.aside.as_ref().filter(|_| located.reasons.is_empty());
        self.beside.as_ref().or(aside).cloned()
    }
}

#[cfg(test)]
impl Decided {
    /// A pose that nothing was searched beside.
    pub fn alone(fit: Fit) -> Self {
        Self {
            fit,
            symmetries: Vec::new(),
            all: Vec::new(),
            cell_mm: 0.0,
            beside: None,
            aside: None,
            doubts: Vec::new(),
        }
    }
}

/// Poses that the search proposes, and those of them that are settled with few points, and refined.
const REFINED: usize = 36;
const APPROACHED: usize = 20;
const KEPT: usize = 6;
/// Points that a pose is approached with, first tried with, and refined with before it is compared.
const APPROACHING: usize = 400;
const TRIED: usize = 900;
const COMPARED: usize = 2500;
/// Points that judge poses which were approached.
const JUDGING: usize = 2000;
/// Proposals that have come as near to each other as this, over the diagonal, are one.
const SAME: f64 = 0.005;
/// How far from the part points are tried, over its diagonal; and how rough the field is there.
const AROUND: f64 = 0.15;
const ROUGH: f64 = 0.02;
/// How far facets lie from the round that they stand for, over the diagonal: nothing finer tells two poses apart unless
/// the fit itself is coarser.
const FACETS: f64 = 2e-4;
/// The share of the part's surface that a scan must show.
const SHOWN: f64 = 0.08;
/// The share of the scan's points that must lie on the part.
pub(super) const SHARE: f64 = 0.03;
/// A size that is known worse than this says nothing of a unit.
const SIZED: f64 = 0.02;
/// A scan that lies on the part to this share is of the part, in whichever of its poses.
const MOSTLY: f64 = 0.3;
/// A mirror image fits better by this share of the points that lie on it; or by fewer that are clearly off the part, but
/// never by less than so many ([`clear_advantage`]).
const UNLIKE: f64 = 0.01;
const FEW_UNLIKE: usize = 24;
/// Units that a file can be in by mistake: how many mm, name.
pub(super) const UNITS: [(f64, &str); 5] = [
    (25.4, "inches"),
    (1000.0, "metres"),
    (10.0, "centimetres"),
    (1.0 / 25.4, "mm that were taken for inches"),
    (0.001, "micrometres"),
];

pub(super) struct Judge<'a> {
    pub task: &'a LocaliseTask<'a>,
    pub surface: &'a CompositeSurface,
    pub prepared: Prepared,
    /// Where sides of a closed part end.
    rims: Vec<Rim>,
}

/// Which of some points a fit explains, and the noise by which it does.
struct Explained {
    points: Vec<bool>,
    sigma_mm: f64,
}

/// How a fit is worth it.
enum Worth {
    Good,
    /// The share of the surface that is shown.
    Little(f64),
    Bad,
}

/// The pose that the search finds, or the one that a start led to (`begun`), if it stands.
pub(super) fn decide(
    task: &LocaliseTask<'_>,
    surface: &CompositeSurface,
    begun: Option<Fit>,
) -> Result<Decided, ScanError> {
    let judge = Judge::new(task, surface);
    let scene = Scene::new(task.model, &from_seed(task.points, task.seed), task.threads);
    let fits = judge.fits(&scene, None);
    if let Some(begun) = begun {
        return judge.begun(&scene, begun, fits);
    }
    let best = fits
        .first()
        .map(|fit| judge.explained(&scene, &scene.fine, fit));
    judge.found(&scene, fits).map_err(|error| {
        let known = best.map_or(0, |best| count(&best.points));
        let known = match error.code {
            "no_fit" | "too_little_overlap" => known,
            // The mirror image explains nearly all that is of it.
            "mirrored" => known.max(scene.fine.len() * 3 / 4),
            _ => return error,
        };
        judge.other_size(known).err().unwrap_or(error)
    })
}

/// The refusal of a scan in another unit.
pub(super) fn wrong_scale(factor: f64, unit: &'static str) -> ScanError {
    ScanError::refused(
        "wrong_scale",
        format_args!(
            "the scan fits if it is made {} times as large: its numbers look like {unit}; {}",
            // 1/25.4 has no end.
            (factor * 1e5).round() / 1e5,
            match unit {
                "inches" => "say --unit inch, or export it in mm",
                "metres" => "say --unit m, or export it in mm",
                "mm that were taken for inches" => "leave --unit out",
                _ => "export it in mm",
            }
        ),
    )
    .with("factor", factor)
    .with("unit", unit)
}

/// The refusal of a scan that shows this share of the part's surface.
fn too_little(shown: f64) -> ScanError {
    ScanError::refused(
        "too_little_overlap",
        format_args!(
            "the scan shows {:.1} % of the part's surface at best: too little to tell where it is; scan more of it",
            shown * 100.0
        ),
    )
    .with("overlap", shown)
}

pub(super) fn no_fit() -> ScanError {
    ScanError::refused(
        "no_fit",
        "the part is not in this scan, or not as the model has it: no pose explains the points to within their noise",
    )
}

/// Of fewer points a search may miss the part.
const FEW: usize = 1000;

/// The refusal of so few points, which need not say that another part was scanned.
fn no_fit_of(few: usize) -> ScanError {
    ScanError::refused(
        "no_fit",
        format_args!(
            "no pose of the part was found by which it explains the {few} points. A search needs more of them: scan the \
             part with {FEW} points or more, or say by --start where it is about. If it is not found then, the part is \
             not in this scan, or not as the model has it"
        ),
    )
}

impl<'a> Judge<'a> {
    fn new(task: &'a LocaliseTask<'a>, surface: &'a CompositeSurface) -> Self {
        let prepared = Prepared::new(task.model, task.threads);
        let rims = if prepared.closed {
            rims(task.model, &prepared.sides, cell_mm(task.model))
        } else {
            Vec::new()
        };
        Self {
            task,
            surface,
            prepared,
            rims,
        }
    }

    /// The best of the fits, if it is one and the only one.
    fn found(&self, scene: &Scene, mut fits: Vec<Fit>) -> Result<Decided, ScanError> {
        let first = |fits: &[Fit]| {
            fits.first()
                .map_or(Worth::Bad, |best| self.worth(scene, best))
        };
        let mut worth = first(&fits);
        if !matches!(worth, Worth::Good) {
            self.other_scale()?;
            self.flat(scene)?;
        }
        if let Some(missed) = self.mirrored(scene, &fits)? {
            fits.insert(0, missed);
            worth = first(&fits);
        }
        let no_fit = || match self.task.points.len() {
            few @ 0..FEW => no_fit_of(few),
            _ => no_fit(),
        };
        let Some(best) = fits.first() else {
            return Err(no_fit());
        };
        match worth {
            Worth::Bad => return Err(no_fit()),
            Worth::Little(shown) => return Err(too_little(shown)),
            Worth::Good => {}
        }
        let decided = self.only_one(scene, &fits);
        // Poses of a foreign part that are as good as each other are no answer either.
        match &decided {
            Ok(found) => self.stands(scene, &found.fit)?,
            Err(error) if error.code == "ambiguous" => self.stands(scene, best)?,
            Err(_) => {}
        }
        let decided = decided?;
        let decided = self.with_aside(scene, decided)?;
        self.only_body(scene, &decided.fit)?;
        Ok(decided)
    }

    /// The fit that a start led to, if it stands as what the search finds must: the start may be right to within a few
    /// millimetres and still lead to the wrong faces. How much the scan shows of the part is not asked.
    fn begun(&self, scene: &Scene, begun: Fit, found: Vec<Fit>) -> Result<Decided, ScanError> {
        let begun = self.refine(scene, &begun.motion).unwrap_or(begun);
        // Of what is the same pose, and only that, the better one.
        let (mut here, others): (Vec<Fit>, Vec<Fit>) = found
            .into_iter()
            .partition(|fit| !self.is_new(std::slice::from_ref(&begun), &fit.motion));
        here.push(begun);
        let sigma = self.common(&here, scene);
        for fit in &mut here {
            self.weigh(scene, fit, &scene.fine, sigma);
        }
        sort(&mut here);
        here.truncate(1);
        let fits = [here, others].concat();
        let here = &fits[0];
        let seen = |fit: &Fit, other: &Fit| {
            let sigma = fit.sigma_mm.min(other.sigma_mm).max(scene.noise_mm);
            let (points, threads) = (&scene.fine, self.task.threads);
            explained(self.part(), points, &fit.motion, sigma, threads)
        };
        let elsewhere = |there: &Fit| {
            ScanError::refused(
                "no_fit",
                format_args!(
                    "the start leads to a wrong place: of {} points {} lie on the part there, and {} by a pose elsewhere; \
                     begin nearer, or leave --start out",
                    scene.fine.len(),
                    count(&seen(here, there)),
                    count(&seen(there, here))
                ),
            )
        };
        if matches!(self.worth(scene, here), Worth::Bad) {
            let good = |fit: &&Fit| matches!(self.worth(scene, fit), Worth::Good);
            return Err(fits[1..].iter().find(good).map_or_else(not_near, elsewhere));
        }
        let decided = self.only_one(scene, &fits);
        match &decided {
            Ok(one) if self.is_new(std::slice::from_ref(here), &one.fit.motion) => {
                return Err(elsewhere(&one.fit));
            }
            // What a wrong place leaves free or alike says nothing of the part.
            Err(_)
                if let Some(there) = fits[1..].iter().find(|there| {
                    let (here, there) = (seen(here, here), seen(there, here));
                    let (more, chance) = advantage(&there, &here);
                    more > chance + 0.1 * count(&there) as f64
                }) =>
            {
                return Err(elsewhere(there));
            }
            Err(error) if error.code != "ambiguous" => return decided,
            _ => {}
        }
        if let Some(missed) = self.mirrored(scene, &fits)? {
            return Err(elsewhere(&missed));
        }
        self.stands(scene, here)?;
        self.with_aside(scene, decided?)
    }

    /// The best distinct fits of the part in a scene, best first; those that explain clearly less than the best, or than
    /// what is to be beaten, are left out.
    fn fits(&self, scene: &Scene, beaten: Option<&Explained>) -> Vec<Fit> {
        let threads = self.task.threads;
        let thinned = scene.at();
        let floor = self.floor(scene);
        let one = Threads::new(1);
        let approached = self.approached(scene, &thinned, floor);
        let rough = threads.each(approached.len(), |i| {
            let few = self.around(&thinned, &approached[i].motion, TRIED, AROUND);
            approached[i].settle(self.surface, &few, floor, 3, one)
        });
        let mut rough: Vec<Fit> = rough.into_iter().flatten().collect();
        // One measure for all: what lies within a few times the least noise that any of them has.
        let sigma = self.common(&rough, scene);
        for fit in &mut rough {
            self.weigh(scene, fit, &thinned, sigma);
        }
        sort(&mut rough);
        let mut fits: Vec<Fit> = Vec::new();
        // Those that are left out, too: a part can lie beside its place along itself.
        let mut all: Vec<Fit> = Vec::new();
        let mut best = None;
        for fit in rough {
            if all.len() >= KEPT {
                break;
            }
            if !self.is_new(&all, &fit.motion) {
                continue;
            }
            let than = beaten.or(best.as_ref());
            if than.is_some_and(|than| self.is_clearly_less(&thinned, &fit.motion, than)) {
                all.push(fit);
            } else if let Some(fine) = self.refine(scene, &fit.motion)
                && self.is_new(&all, &fine.motion)
            {
                best = best.or_else(|| Some(self.explained(scene, &thinned, &fine)));
                all.push(fine.clone());
                fits.push(fine);
            }
        }
        let than = beaten.or(best.as_ref());
        for slid in self.slid(scene, &all, than) {
            if self.is_new(&fits, &slid.motion) {
                fits.push(slid);
            }
        }
        let sigma = self.common(&fits, scene);
        for fit in &mut fits {
            self.weigh(scene, fit, &scene.fine, sigma);
        }
        sort(&mut fits);
        fits
    }

    /// Where the search's proposals lead in a few rounds, the best first.
    fn approached(&self, scene: &Scene, thinned: &[Vec3], floor: f64) -> Vec<Approach> {
        let threads = self.task.threads;
        let proposals = self
            .prepared
            .search(&scene.places, REFINED, &IN_A_SCAN, threads);
        let judging = scene.some(JUDGING);
        let reach = self.prepared.diagonal * 0.05;
        let one = Threads::new(1);
        let all = threads.each(proposals.len(), |i| {
            let motion = &proposals[i].motion;
            let few = self.around(thinned, motion, APPROACHING, AROUND);
            let there = fit::approach(self.surface, &few, motion, reach, floor, one)?;
            Some((self.prepared.rough.score(&judging, &there.motion), there))
        });
        let mut all: Vec<(f64, Approach)> = all.into_iter().flatten().collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut kept: Vec<Approach> = Vec::new();
        for (_, there) in all {
            let apart = |k: &Approach| k.motion.apart_mm(&there.motion, &self.prepared.corners);
            if kept
                .iter()
                .all(|k| apart(k) > SAME * self.prepared.diagonal)
            {
                kept.push(there);
            }
        }
        kept.truncate(APPROACHED);
        kept
    }

    /// What of these points a fit explains.
    fn explained(&self, scene: &Scene, points: &[Vec3], fit: &Fit) -> Explained {
        let sigma_mm = self.noise(scene, fit);
        Explained {
            points: explained(
                self.part(),
                points,
                &fit.motion,
                sigma_mm,
                self.task.threads,
            ),
            sigma_mm,
        }
    }

    /// Whether a pose that is about right explains less of these points than another one does, beyond what a finer pose
    /// would change.
    fn is_clearly_less(&self, points: &[Vec3], motion: &Pose, than: &Explained) -> bool {
        let sigma = 2.0 * than.sigma_mm;
        let there = explained(self.part(), points, motion, sigma, self.task.threads);
        let (more, chance) = advantage(&than.points, &there);
        more > 2.0 * chance + 0.15 * count(&than.points) as f64
    }

    /// A pose that is right to about this share of the diagonal, tried with few points; none if it explains clearly less.
    fn tried(
        &self,
        scene: &Scene,
        thinned: &[Vec3],
        motion: &Pose,
        share: f64,
        than: &Explained,
    ) -> Option<Pose> {
        let rough = fit::settle(
            self.surface,
            &self.around(thinned, motion, TRIED, AROUND),
            motion,
            share * self.prepared.diagonal,
            self.floor(scene),
            3,
            self.task.threads,
        )?;
        (!self.is_clearly_less(thinned, &rough.motion, than)).then_some(rough.motion)
    }

    /// The noise by which rivals of a fit are judged. Neighbourhoods with stray points, edges and curves look noisier than
    /// the surface is; but what sets facets apart from the round that they stand for is no noise.
    fn noise(&self, scene: &Scene, fit: &Fit) -> f64 {
        let facets = FACETS * self.prepared.diagonal;
        fit.sigma_mm.max(scene.noise_mm.min(facets))
    }

    /// Counts the points that lie on the part by this fit, and weighs them: those on a side that the scan goes beyond say
    /// nothing, and those deep within a closed body speak against it.
    fn weigh(&self, scene: &Scene, fit: &mut Fit, points: &[Vec3], sigma: f64) {
        let standing = off(self.part(), points, &fit.motion, sigma, self.task.threads);
        let passed = self.passed(scene, &fit.motion);
        fit.inliers = 0;
        fit.worth = 0;
        for (off, face) in standing.off.iter().zip(&standing.face) {
            if on(*off) {
                fit.inliers += 1;
                fit.worth += i64::from(!passed.contains(&self.prepared.sides[*face as usize]));
            } else if self.prepared.closed && is_within(*off) {
                fit.worth -= 1;
            }
        }
    }

    /// The sides of the part that lie flush in what is not the part, if `motion` puts it.
    pub(super) fn passed(&self, scene: &Scene, motion: &Pose) -> HashSet<u32> {
        let places = (&scene.tree, &scene.places[..]);
        passed(&self.rims, places, motion, cell_mm(self.task.model))
    }

    /// What poses are compared with.
    pub(super) fn part(&self) -> (&CompositeSurface, &HeightField) {
        (self.surface, &self.prepared.rough.field)
    }

    /// At most `most` points about where `motion` puts the part, within so much of its diagonal.
    fn around(&self, points: &[Vec3], motion: &Pose, most: usize, share: f64) -> Vec<Vec3> {
        let limit = share * self.prepared.diagonal;
        let near: Vec<Vec3> = points
            .iter()
            .filter(|q| {
                let distance = self.prepared.rough.field.at(&motion.undo(q));
                distance.is_some_and(|(d, _)| d.abs() < limit)
            })
            .copied()
            .collect();
        scene::some(&near, most)
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

    pub(super) fn refine(&self, scene: &Scene, motion: &Pose) -> Option<Fit> {
        let reach = self.prepared.diagonal * 0.01 + 4.0 * scene.noise_mm;
        self.refine_within(scene, motion, reach)
    }

    /// From a pose that is right to about `reach` mm.
    fn refine_within(&self, scene: &Scene, motion: &Pose, reach: f64) -> Option<Fit> {
        self.refine_to(scene, motion, reach, self.floor(scene))
    }

    /// The same; no noise is taken for less than `floor`, in mm.
    fn refine_to(&self, scene: &Scene, motion: &Pose, reach: f64, floor: f64) -> Option<Fit> {
        let diagonal = self.prepared.diagonal;
        // Enough to tell poses apart; what is printed uses all points. A cell of the field is as rough as that.
        let share = 3.0 * reach / diagonal + ROUGH;
        let few = self.around(&scene.fine, motion, COMPARED, share);
        let threads = self.task.threads;
        fit::settle(self.surface, &few, motion, reach, floor, 8, threads)
    }

    fn worth(&self, scene: &Scene, fit: &Fit) -> Worth {
        let points = &scene.fine;
        let standing = off(
            self.part(),
            points,
            &fit.motion,
            fit.sigma_mm,
            self.task.threads,
        );
        let count = |is: &dyn Fn(f64) -> bool| {
            let off = standing.off.iter().filter(|off| is(**off));
            off.count() as f64
        };
        let there = count(&on);
        // A wrong pose has as many points a little off the surface as on it.
        let beside = count(&|off| !on(off) && !is_clearly_off(off));
        // A surface that is not closed has no inside.
        let inside = count(&|off| self.prepared.closed && is_within(off));
        let noisy = fit.sigma_mm > 3.0 * scene.noise_mm + self.prepared.diagonal / 400.0
            || fit.sigma_mm > self.prepared.diagonal / 60.0;
        if noisy
            || there < 20.0
            || there < 1.5 * beside
            || inside > 0.25 * there
            || there < SHARE * points.len() as f64
        {
            return Worth::Bad;
        }
        let shown: Vec<Vec3> = (standing.off.iter().zip(points))
            .filter(|(off, _)| on(**off))
            .map(|(_, q)| fit.motion.undo(q))
            .collect();
        let shown = coverage(self.task.model, &shown);
        if shown < SHOWN {
            Worth::Little(shown)
        } else {
            Worth::Good
        }
    }

    /// Refuses if all that was scanned is one flat side: it slides on any face.
    fn flat(&self, scene: &Scene) -> Result<(), ScanError> {
        let normals = scene.places.iter().map(|o| o.normal);
        let Some(normal) = only_normal(normals) else {
            return Ok(());
        };
        Err(degenerate(
            &sliding(&normal),
            &fit::middle(self.task.points),
            "part",
        ))
    }

    /// Whether what a fit shows of the part holds its pose and its size: a small smooth patch fits at any size.
    pub(super) fn holds_size(&self, scene: &Scene, fit: &Fit) -> bool {
        let sigma = fit.sigma_mm.max(scene.noise_mm);
        let reach = fit::INLIER * sigma;
        let threads = self.task.threads;
        let measured = measure_within(self.surface, &scene.fine, &fit.motion, &[], reach, threads);
        let held = super::near(&measured, reach);
        let held = on_faces(
            self.surface,
            &scene.fine,
            &measured,
            &held,
            &fit.motion,
            sigma,
            threads,
        );
        let sure = white(&scene.fine, &measured, &held, &fit.motion, sigma);
        sure.free.is_empty()
            && sure.u_scale < SIZED
            && self.only_side(scene, &fit.motion, sigma).is_none()
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
            let fits = self.fits(&scene, None);
            if fits.first().is_some_and(|fit| {
                matches!(self.worth(&scene, fit), Worth::Good)
                    && self.holds_size(&scene, fit)
                    // A few of the points lie well on a large part in many ways.
                    && (fit.inliers as f64 > MOSTLY * scene.fine.len() as f64
                        || self.only_one(&scene, &fits).is_ok())
            }) {
                return Err(wrong_scale(factor, name));
            }
        }
        Ok(())
    }

    /// Refuses if the mirror image fits better than all of these, and the part does not fit where that one would be its own
    /// mirror image: a plate hardly differs from its own, and the search can find the one and miss the other. Then the
    /// missed fit.
    fn mirrored(&self, scene: &Scene, fits: &[Fit]) -> Result<Option<Fit>, ScanError> {
        let standing = |scene: &Scene, fit: &Fit, sigma: f64| {
            let (points, threads) = (&scene.fine, self.task.threads);
            off(self.part(), points, &fit.motion, sigma, threads)
        };
        let is_as_seen = |fit: &Fit| {
            let here = standing(scene, fit, self.sharp_noise(scene, fit)).off;
            let off = here.iter().filter(|off| !on(**off)).count() as f64;
            let clearly = here.iter().filter(|off| is_clearly_off(**off)).count();
            clearly < FEW_UNLIKE && off < 1.5 * UNLIKE * here.len() as f64
        };
        let sharp: Vec<Fit> = fits.iter().map(|fit| self.sharp(scene, fit)).collect();
        if sharp.iter().any(is_as_seen) {
            return Ok(None);
        }
        let best = fits.first();
        let mirrored = scene.mirrored();
        let beaten = best.map(|fit| self.explained(scene, &scene.at(), fit));
        let others = self.fits(&mirrored, beaten.as_ref());
        let Some(other) = others
            .first()
            .filter(|fit| matches!(self.worth(&mirrored, fit), Worth::Good))
        else {
            return Ok(None);
        };
        let other = self.sharp(&mirrored, other);
        let noise = sharp.first().map(|fit| self.sharp_noise(scene, fit));
        let sigma = noise
            .unwrap_or(f64::INFINITY)
            .min(self.sharp_noise(&mirrored, &other));
        let there = standing(&mirrored, &other, sigma);
        let beats = |one: &Standing, other: &Standing| {
            let [one_on, other_on] = [one, other].map(Standing::on);
            let (more, chance) = advantage(&one_on, &other_on);
            let (clear, clear_chance) = clear_advantage(one, other);
            more > chance + UNLIKE * count(&one_on) as f64 || clear > clear_chance
        };
        let fits: Vec<Standing> = sharp
            .iter()
            .map(|fit| standing(scene, fit, sigma))
            .collect();
        // Which of the fits that are about as good as the first one is the part's, is not decided yet.
        let is_good = |fit: &&Standing| !beats(&fits[0], fit);
        if fits.iter().filter(is_good).any(|fit| !beats(&there, fit)) {
            return Ok(None);
        }
        match self.unmirrored(scene, &other.motion, sigma) {
            Some(missed)
                if !beats(&there, &standing(scene, &self.sharp(scene, &missed), sigma)) =>
            {
                Ok(Some(missed))
            }
            _ => Err(ScanError::refused(
                "mirrored",
                "the mirror image of the part fits the scan, the part does not: a left hand for a right one, or an axis of the scanner with its sign lost",
            )),
        }
    }

    /// The best fit where a pose of the mirror image puts the part's own mirror image in a plane of its box or of its
    /// principal axes, or in its middle.
    fn unmirrored(&self, scene: &Scene, mirror: &Pose, sigma: f64) -> Option<Fit> {
        let threads = self.task.threads;
        let thinned = scene.at();
        let turn = nalgebra::Matrix3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let tried = symmetry::reflections(&self.prepared).into_iter();
        let fits = tried.filter_map(|own| {
            let motion = Pose {
                rotation: turn * mirror.rotation * own.rotation,
                translation_mm: turn * mirror.point(&own.translation_mm),
            };
            let few = self.around(&thinned, &motion, TRIED, AROUND);
            let (reach, floor) = (0.03 * self.prepared.diagonal, self.floor(scene));
            let rough = fit::settle(self.surface, &few, &motion, reach, floor, 3, threads)?;
            let fit = self.refine(scene, &rough.motion)?;
            let seen = explained(self.part(), &scene.fine, &fit.motion, sigma, threads);
            Some((count(&seen), fit))
        });
        let best = fits.max_by_key(|(on, _)| *on);
        best.map(|(_, fit)| fit)
    }
}

/// How many.
pub(super) fn count(seen: &[bool]) -> usize {
    seen.iter().filter(|s| **s).count()
}

/// What the mirror image says where the search found nothing.
#[cfg(test)]
pub(super) fn mirrored_by_itself(
    task: &LocaliseTask<'_>,
    surface: &CompositeSurface,
) -> Result<Option<Fit>, ScanError> {
    let judge = Judge::new(task, surface);
    let scene = Scene::new(task.model, task.points, task.threads);
    judge.mirrored(&scene, &[])
}
