//! Whether a scan shows the part twice.
//!
//! A pose is judged by the points on it, and two parts of one kind each have their own: whichever has more of them would
//! be taken. So what the pose leaves is searched once more.

use super::account::TOO_MUCH;
use super::symmetry::ambiguous;
use super::{Judge, Worth};
use crate::ScanError;
use crate::localise::fit::Fit;
use crate::localise::search::oriented::from_seed;
use crate::localise::search::scene::Scene;
use crate::localise::verdict::rivals::{explained, is_within, off};
use crate::rigid::{Pose, Vec3};

/// What lies nearer to the part than this, over its diagonal, is not searched again.
const BESIDE: f64 = 0.02;
/// The rest is searched if it is this share of what lies nearer, in places that have a surface about them.
const LEFT: f64 = 0.25;
/// Both have about the noise of the scan.
const NOISIER: f64 = 2.0;
/// The share of what lies on the other one that must be its own: not a table's, nor another part's.
const OWN: f64 = 0.5;
/// The same of three faces that meet in a corner: half of them may be a chuck's.
const OWN_OF_A_CORNER: f64 = 0.75;
/// A scan shows a body if it has this part of the points on it that the scan with most of them has.
const SHOWS: usize = 4;
/// Two bodies have no more of their surface than this within each other.
const WITHIN: f64 = 0.03;

impl Judge<'_> {
    /// Refuses where another body of the scan is the part as well: nothing says which of them is meant.
    ///
    /// Of several scans the one that shows most of the part is asked. What the machine did not move with the part stands
    /// elsewhere in each of them, and two tables that cross look like a corner.
    pub(super) fn only_body(&self, scene: &Scene, fit: &Fit) -> Result<(), ScanError> {
        match self.task.groups.all.len() {
            0 | 1 => self.only_body_of(scene, fit),
            count => self.only_body_of(&self.fullest(fit, count), fit),
        }
    }

    /// The scan, of so many, of which most points lie beside the part.
    fn fullest(&self, fit: &Fit, count: usize) -> Scene {
        let points = self.task.points;
        let of = |i: usize| self.task.groups.of(i);
        let mut beside = vec![0; count];
        for i in (0..points.len()).filter(|i| !self.is_left(fit, &points[*i])) {
            beside[of(i)] += 1;
        }
        let fullest = (0..count).max_by_key(|k| beside[*k]).unwrap_or(0);
        let own = (0..points.len()).filter(|i| of(*i) == fullest);
        let own: Vec<Vec3> = own.map(|i| points[i]).collect();
        let (model, threads) = (self.task.model, self.task.threads);
        Scene::new(model, &from_seed(&own, self.task.seed), threads)
    }

    /// Whether a point of the scan lies not near to the part.
    fn is_left(&self, fit: &Fit, q: &Vec3) -> bool {
        let distance = self.prepared.rough.field.at(&fit.motion.undo(q));
        distance.is_none_or(|(d, _)| d.abs() > BESIDE * self.prepared.diagonal)
    }

    fn only_body_of(&self, scene: &Scene, fit: &Fit) -> Result<(), ScanError> {
        let is_left = |q: &Vec3| self.is_left(fit, q);
        let surface = scene.places.iter().filter(|o| o.is_oriented());
        let (all, left) = surface.fold((0, 0), |(all, left), o| {
            (all + 1, left + u32::from(is_left(&o.at)))
        });
        if self.task.accept_symmetry || f64::from(left) < LEFT * f64::from(all - left) {
            return Ok(());
        }
        let rest: Vec<Vec3> = scene.fine.iter().filter(|q| is_left(q)).copied().collect();
        let rest = Scene::new(self.task.model, &rest, self.task.threads);
        let sigma = self.noise(scene, fit);
        let twin = self.fits(&rest, None).into_iter().find(|other| {
            other.sigma_mm < NOISIER * sigma
                && matches!(self.worth(&rest, other), Worth::Good)
                && self.are_apart(&fit.motion, &other.motion, sigma)
                && self.could_be(scene, other)
                && self.moves_along(&fit.motion, &other.motion, sigma)
        });
        let Some(twin) = twin else {
            return Ok(());
        };
        Err(ambiguous(
            &[],
            &[fit.motion, twin.motion],
            "the scan shows the part twice",
            "crop the scan to the one that is meant, or say --accept-symmetry if either will do",
        ))
    }

    /// Whether a place of the part that is not to be taken for it could be one: other things may hide it there. Three faces
    /// of any box that meet in a corner are like the part's.
    fn could_be(&self, scene: &Scene, fit: &Fit) -> bool {
        let [own, much] = match self.holds_size(scene, fit) {
            true => [OWN, 2.0 * TOO_MUCH],
            false => [OWN_OF_A_CORNER, TOO_MUCH / 2.0],
        };
        let account = self.account(scene, fit, &[]).0;
        account.own > own && account.unexplained() <= much
    }

    /// Whether most of the scans that show the part show the second one there, too: what stands still while the machine moves
    /// the part is not the part.
    fn moves_along(&self, part: &Pose, second: &Pose, sigma: f64) -> bool {
        let groups = self.task.groups;
        let shows = |motion: &Pose| {
            let (points, threads) = (self.task.points, self.task.threads);
            let on = explained(self.part(), points, motion, sigma, threads);
            let mut counts = vec![0_usize; groups.all.len().max(1)];
            for i in (0..points.len()).filter(|i| on[*i]) {
                counts[groups.of(i)] += 1;
            }
            let most = counts.iter().copied().max().unwrap_or(0);
            let shows = counts.iter().filter(|count| SHOWS * **count > most);
            shows.count()
        };
        2 * shows(second) > shows(part)
    }

    /// Whether the part can be at both places at once.
    fn are_apart(&self, first: &Pose, second: &Pose, sigma: f64) -> bool {
        let samples: Vec<Vec3> = self.prepared.samples.iter().map(|o| o.at).collect();
        let by = first.inverse().after(second);
        let off = off(self.part(), &samples, &by, sigma, self.task.threads).off;
        let within = off.iter().filter(|off| is_within(**off)).count();
        within as f64 <= WITHIN * samples.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use crate::localise::tests::{Random, bracket, scan, task};
    use crate::rigid::{Pose, Vec3, rotation};

    #[test]
    fn of_two_parts_of_one_kind_none_is_taken_unless_either_will_do() {
        let model = bracket();
        let mut random = Random(5);
        // The second one is seen as well, and a third as well.
        for share in [1.0, 0.3] {
            let first = random.pose();
            let turn = Pose {
                rotation: rotation(&Vec3::new(0.2, -0.4, 2.0)),
                translation_mm: Vec3::new(90.0, -30.0, 20.0),
            };
            let second = first.after(&turn);
            let mut points = scan(&model, 4000, 0.02, &first, &mut random, |n| n.y < 0.5);
            let more = (4000.0 * share) as usize;
            points.extend(scan(&model, more, 0.02, &second, &mut random, |n| {
                n.x < 0.5
            }));
            let mut task = task(&model, &points);
            let error = task.find().unwrap_err();
            assert_eq!(error.code, "ambiguous");
            // Where both are seen as well, as poses that the scan does not tell apart.
            let says = |words: &str| error.message.contains(words);
            assert!(says("twice") || says("two of it"), "{}", error.message);
            assert_eq!(error.details["poses"].as_array().unwrap().len(), 2);
            task.accept_symmetry = true;
            let found = task.find().unwrap();
            assert!(found.reasons.is_empty(), "{:?}", found.reasons);
            let off = |place: Pose| found.motion.apart_mm(&place, &model.corners());
            assert!(off(first).min(off(second)) < 0.1);
        }
    }
}
