//! What a fit leaves unexplained.
//!
//! A foreign part that has a corner in common with what was scanned can lie well on a sixth of a scan. But then the scanned
//! surface goes on within its material, or beyond its edges, or the scan shows nothing where it must have seen the part.

use std::collections::HashMap;

use crate::ScanError;
use crate::cloud::tree::PointTree;
use crate::localise::fit::Fit;
use crate::localise::search::oriented::{Oriented, sample};
use crate::localise::search::pairs::{frame, spread};
use crate::localise::search::scene::{Scene, cell_mm};
use crate::localise::verdict::rivals::{is_within, off, on};
use crate::localise::verdict::{Judge, count};
use crate::rigid::Vec3;
use crate::solve::median;

/// What a fit accounts for, in shares.
#[derive(Clone, Copy, Debug)]
pub(super) struct Account {
    /// Of the surface that was seen from where the scanner can have stood: what has points.
    seen: f64,
    /// Of the scanned surface on the part or in its box: what is on the part.
    near: f64,
    /// The scanned surface deep within the part's material, over that on the part.
    within: f64,
    /// Of the points on the part: those on sides beyond whose edges the scan does not go on.
    pub own: f64,
}

/// How much of what is unexplained is too much: a part among clutter and stray points leaves half of that, a foreign part
/// that has a corner of the scanned one leaves more (`tests/bench/LOCALISE.md`).
pub(super) const TOO_MUCH: f64 = 0.2;
/// Other things may stand where the part is, clamps above all, so they weigh little; a surface within the material cannot.
const NEAR: f64 = 0.25;
const WITHIN: f64 = 3.0;
/// A fit of which a smaller share is its own lies on other things alone.
const OWN: f64 = 0.1;

impl Account {
    /// That of several scans, each weighed by its points on the part.
    pub fn of_all(all: &[(Self, usize)]) -> Self {
        let weight: usize = all.iter().map(|(_, on)| on).sum();
        let mean = |of: fn(&Self) -> f64| {
            let sum: f64 = all.iter().map(|(one, on)| of(one) * *on as f64).sum();
            sum / f64::max(weight as f64, 1.0)
        };
        Self {
            seen: mean(|one| one.seen),
            near: mean(|one| one.near),
            within: mean(|one| one.within),
            own: mean(|one| one.own),
        }
    }

    /// What weighs against the fit: what should have been seen, what is foreign about it, and what is within it.
    fn against(&self) -> [f64; 3] {
        [
            1.0 - self.seen,
            NEAR * (1.0 - self.near),
            WITHIN * self.within,
        ]
    }

    /// All of it together.
    pub fn unexplained(&self) -> f64 {
        self.against().iter().sum()
    }

    /// Refuses if too `much` is unexplained, by what weighs most.
    pub fn judged(&self, much: f64) -> Result<(), ScanError> {
        let [unseen, foreign, within] = self.against();
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let why = if self.own < OWN {
            format!(
                "{} of what lies on it lies on faces that go on beyond its edges, as a table's or another part's",
                percent(1.0 - self.own)
            )
        } else if self.unexplained() <= much {
            return Ok(());
        } else if within >= unseen.max(foreign) {
            format!(
                "scanned surface lies deep within its material, {} as much as lies on it",
                percent(self.within)
            )
        } else if unseen >= foreign {
            format!(
                "only {} of what the scanner must have seen of it has points; if the scanner's field ended there, crop the \
                 scan to the part",
                percent(self.seen)
            )
        } else {
            format!(
                "only {} of the scanned surface about it is its own",
                percent(self.near)
            )
        };
        Err(ScanError::refused(
            "no_fit",
            format_args!(
                "the part is not in this scan, or not as the model has it: where it lies best, {why}"
            ),
        ))
    }
}

/// A scan of which this share lies on the part is of the part.
const SURELY_THIS: f64 = 0.9;
/// Places of the part's surface, and directions that the scanner may have looked from.
const SAMPLES: usize = 600;
const EYES: usize = 96;
/// A surface is surely seen where its normal and the way to the scanner have this cosine at least, and may be seen where
/// they have the other.
const SURELY: f64 = 0.4;
const PERHAPS: f64 = 0.15;
/// A place is scanned if a point is as near as this: cells of the search, and spacings of the points on the part.
const CELLS: f64 = 1.2;
const SPACINGS: f64 = 3.0;
/// What stands before a place by as many cells hides it.
const BEFORE: f64 = 1.5;

impl Judge<'_> {
    /// Refuses a fit that leaves too much unexplained. Where there are fiducials it is asked of each scan at the end:
    /// their points, and what hid the part in each of several scans, are not in the scene.
    ///
    /// Three faces that meet in one corner fit any other three as well: of such a pose only where they end speaks for this
    /// part, so it must account for more.
    pub(super) fn stands(&self, scene: &Scene, fit: &Fit) -> Result<(), ScanError> {
        if !self.task.groups.all.is_empty() {
            return Ok(());
        }
        let much = match (self.holds_size(scene, fit), self.is_surely(scene, fit)) {
            (true, true) => return Ok(()),
            (true, false) => TOO_MUCH,
            (false, _) => TOO_MUCH / 2.0,
        };
        self.account(scene, fit, &[]).0.judged(much)
    }

    /// Whether nearly all of the scan lies on the part.
    pub(super) fn is_surely(&self, scene: &Scene, fit: &Fit) -> bool {
        let explained = self.explained(scene, &scene.at(), fit).points;
        count(&explained) as f64 > SURELY_THIS * explained.len() as f64
    }

    /// The account of a fit, and the points on the part. `before`: what else stands in the scanner's way.
    pub(super) fn account(&self, scene: &Scene, fit: &Fit, before: &[Vec3]) -> (Account, usize) {
        let sigma = self.noise(scene, fit);
        let threads = self.task.threads;
        let standing = off(self.part(), &scene.fine, &fit.motion, sigma, threads);
        let passed = self.passed(scene, &fit.motion);
        let (mut shown, mut not_passed) = (Vec::new(), 0);
        for (i, q) in scene.fine.iter().enumerate() {
            if on(standing.off[i]) {
                shown.push(fit.motion.undo(q));
                let side = self.prepared.sides[standing.face[i] as usize];
                not_passed += usize::from(!passed.contains(&side));
            }
        }
        // Stray points have no surface about them: they say nothing.
        let surface: Vec<Vec3> = (scene.places.iter().filter(|o| o.is_oriented()))
            .map(|o| o.at)
            .collect();
        let standing = off(self.part(), &surface, &fit.motion, sigma, threads);
        let (low, high) = self.task.model.bounds();
        let (mut on_part, mut beside, mut within) = (0, 0, 0);
        let mut foreign: Vec<Vec3> = before.iter().map(|q| fit.motion.undo(q)).collect();
        for (q, off) in surface.iter().zip(&standing.off) {
            let p = fit.motion.undo(q);
            if on(*off) {
                on_part += 1;
                continue;
            }
            foreign.push(p);
            beside += usize::from((0..3).all(|i| p[i] >= low[i] && p[i] <= high[i]));
            within += usize::from(self.prepared.closed && is_within(*off));
        }
        let account = Account {
            seen: self.seen(&shown, &foreign),
            near: share(on_part, on_part + beside),
            within: within as f64 / f64::max(on_part as f64, 1.0),
            own: share(not_passed, shown.len()),
        };
        (account, shown.len())
    }

    /// Of the surface that was seen from where the scanner can have stood, the share that has points: for each place that
    /// has, from the direction which explains it best.
    fn seen(&self, shown: &[Vec3], foreign: &[Vec3]) -> f64 {
        let model = self.task.model;
        let cell = cell_mm(model);
        let samples = sample(model, SAMPLES);
        let tree = PointTree::new(shown);
        let mut found = Vec::new();
        let mut spacings: Vec<f64> = spread(shown.len(), 300)
            .into_iter()
            .map(|i| {
                tree.nearest(&shown[i], 2, &mut found);
                found.last().map_or(0.0, |(squared, _)| squared.sqrt())
            })
            .collect();
        let radius = (CELLS * cell).max(SPACINGS * median(&mut spacings));
        let scanned: Vec<bool> = samples
            .iter()
            .map(|s| {
                tree.within(&s.at, radius, 1, &mut found);
                !found.is_empty()
            })
            .collect();
        let eyes = self.task.threads.each(EYES, |k| {
            // A spiral from pole to pole, by the golden angle.
            let z = 1.0 - (2.0 * k as f64 + 1.0) / EYES as f64;
            let (s, c) = (k as f64 * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let view = View::new(&Vec3::new(r * c, r * s, z), cell, foreign);
            self.viewed(&view, &samples, &scanned)
        });
        let mut best = vec![0.0_f64; samples.len()];
        for (seen, of) in eyes {
            for i in of {
                best[i] = best[i].max(seen);
            }
        }
        let of_scanned = best.iter().zip(&scanned).filter(|(_, scanned)| **scanned);
        let count = of_scanned.clone().count();
        of_scanned.map(|(best, _)| best).sum::<f64>() / f64::max(count as f64, 1.0)
    }

    /// Of what is surely seen in a view, the share that has points; and the places with points that it shows.
    fn viewed(&self, view: &View, samples: &[Oriented], scanned: &[bool]) -> (f64, Vec<usize>) {
        let far = 2.0 * self.prepared.diagonal;
        let (mut surely, mut has) = (0, 0);
        let mut shows = Vec::new();
        for (i, s) in samples.iter().enumerate() {
            let along = s.normal.dot(&view.eye);
            let facing = if self.prepared.closed {
                along
            } else {
                along.abs()
            };
            if facing < PERHAPS || view.is_hidden(&s.at) {
                continue;
            }
            let skin = s.normal * (1e-4 * self.prepared.diagonal * along.signum());
            let before = self.task.model.first_hit(&(s.at + skin), &view.eye, far);
            if before.is_some() {
                continue;
            }
            if scanned[i] {
                shows.push(i);
            }
            if facing >= SURELY {
                surely += 1;
                has += usize::from(scanned[i]);
            }
        }
        (share(has, surely), shows)
    }
}

/// What is seen from one direction, from far away.
struct View {
    /// From the part to the scanner.
    eye: Vec3,
    cell: f64,
    across: nalgebra::Matrix3<f64>,
    /// How far towards the scanner what is none of the part's stands, by cell.
    before: HashMap<[i64; 2], f64>,
}

impl View {
    fn new(eye: &Vec3, cell: f64, foreign: &[Vec3]) -> Self {
        let mut view = Self {
            eye: *eye,
            cell,
            across: frame(eye),
            before: HashMap::new(),
        };
        for p in foreign {
            let (at, height) = view.place(p);
            let top = view.before.entry(view.key(at)).or_insert(f64::NEG_INFINITY);
            *top = top.max(height);
        }
        view
    }

    /// Across the view, and towards the scanner.
    fn place(&self, p: &Vec3) -> ([f64; 2], f64) {
        let p = self.across.tr_mul(p);
        ([p.x, p.y], p.z)
    }

    fn key(&self, at: [f64; 2]) -> [i64; 2] {
        at.map(|x| (x / self.cell).floor() as i64)
    }

    /// Whether something else stands between a place and the scanner.
    fn is_hidden(&self, p: &Vec3) -> bool {
        let (at, height) = self.place(p);
        let top = self.before.get(&self.key(at));
        top.is_some_and(|top| *top > height + BEFORE * self.cell)
    }
}

fn share(of: usize, all: usize) -> f64 {
    if all == 0 {
        0.0
    } else {
        of as f64 / all as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn says(seen: f64, near: f64, within: f64, own: f64) -> Option<String> {
        let account = Account {
            seen,
            near,
            within,
            own,
        };
        account.judged(TOO_MUCH).err().map(|error| {
            assert_eq!(error.code, "no_fit");
            error.message
        })
    }

    #[test]
    fn what_is_too_much_is_told_by_what_weighs_most() {
        // As measured: among stray points, a part on a table, clamps on it.
        assert_eq!(says(0.98, 0.984, 0.011, 1.0), None);
        assert_eq!(says(1.0, 0.969, 0.0, 0.65), None);
        assert_eq!(says(0.97, 0.75, 0.0, 1.0), None);
        // A blade in a scan of a bracket.
        let said = says(0.905, 0.575, 0.141, 0.415).unwrap();
        assert!(
            said.contains("deep within its material, 14 % as much"),
            "{said}"
        );
        let said = says(0.7, 0.9, 0.0, 1.0).unwrap();
        assert!(said.contains("only 70 % of what the scanner"), "{said}");
        let said = says(1.0, 0.1, 0.0, 1.0).unwrap();
        assert!(said.contains("only 10 % of the scanned surface"), "{said}");
        let said = says(1.0, 1.0, 0.0, 0.01).unwrap();
        assert!(said.contains("99 % of what lies on it"), "{said}");
    }
}
