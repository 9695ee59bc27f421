//! The least minimum: where the squared equations bound it, from their solution; else from several
//! starts that are always the same.

mod squared;

use nalgebra::Vector3;

use super::error::PointRefusal;
use super::model::{Beam, View};
use crate::fit::solve::cloud::count;
use crate::fit::solve::least_squares::{Converged, Stopped, descend, minimise};
use crate::fit::solve::linalg::{Square, norm, perpendicular_frame};
use crate::units::Mm;
use squared::Squared;

/// Readings that the search looks at, if there are many more.
const FEW: f64 = 28.0;

/// Steps of a start before it is compared with what is known.
const COARSE_STEPS: u32 = 8;

/// Steps of a start that leads somewhere new.
const FINE_STEPS: u32 = 60;

/// Minima whose directions are nearer than this (radians), and whose feet are
/// nearer than this part of the radius, are one.
const SAME: f64 = 1e-2;

/// All beams that fit are near one minimum if they are within this angle (radians) of it, and their feet within this
/// part of the radius: the sum of squares has one minimum in a place so small.
const NARROW: f64 = 2e-2;

/// Two minima are told apart by residuals whose rms differs by this factor, if the readings are many.
const TOLD_APART: f64 = 1.5;

/// Few readings fit a wrong beam by chance: with so many degrees of freedom, from 1 on, it takes this factor. The roots
/// of F's 99.9 % points, with as many degrees of freedom over as many.
const TOLD_APART_FEW: [f64; 7] = [637.0, 31.6, 11.9, 7.31, 5.45, 4.48, 3.88];

/// A minimum with an rms of more than this part of the radius is told from any that fits better by [`TOLD_APART`],
/// however few the readings: no sensor that is worth a calibration scatters so far. Of 6000 good sets of six readings
/// 1249 are refused by it, 1766 by a hundredth; that would find one wrong beam more in 18 000 sets of any kind
/// (2026-11-29).
const TOLD_APART_MOST: f64 = 3e-3;

/// ... or by this part of the radius: the position loop alone keeps axes in a
/// plane no better than that.
const TOLD_APART_PART: f64 = 1e-4;

/// A minimum on the wrong side counts as the true one if its rms is smaller by
/// this factor, and that of the right one is no noise: beyond `NOISE_PART` of
/// the radius.
const CLEARLY_BETTER: f64 = 3.0;

/// Residuals below this part of the radius are what rounding makes.
const ROUNDING_PART: f64 = 1e-9;

/// See [`CLEARLY_BETTER`].
const NOISE_PART: f64 = 1e-3;

/// Mirror images that are looked at, one after the other, as long as each is less.
const IMAGES: u32 = 3;

/// The fan of starts about the rough direction: its angle and how many on it.
const FAN: [(f64, u32); 3] = [(0.0, 1), (0.7, 3), (1.3, 5)];

/// The least minimum.
pub(super) struct Found<const K: usize> {
    pub(super) beam: Beam<K>,
    /// rms there.
    rms: f64,
    /// Another minimum on the right side, the least of them, and its rms.
    second: Option<(Beam<K>, f64)>,
    /// The mirror image fits as well and only the rough direction excludes it.
    pub(super) mirror: bool,
}

/// How a search ends.
pub(super) enum Outcome<const K: usize> {
    /// The least minimum.
    Found(Found<K>),
    /// No minimum on the right side; where the search ended, if anywhere.
    Nowhere(Option<Beam<K>>),
    /// A minimum, but a start came lower and found none there.
    Valley(Beam<K>),
    /// One on the wrong side, or from inside the ball.
    OtherWay {
        /// Where it is.
        beam: Beam<K>,
        /// Its rms, mm.
        rms: f64,
    },
}

/// Searches for the least minimum with a on the side of `rough`.
pub(super) fn least<const K: usize>(view: &View<'_, K>, rough: &Vector3<f64>) -> Outcome<K> {
    let tally = bounded(view, rough).unwrap_or_else(|| searched(view, rough));
    outcome(&tally)
}

/// What the minima say.
pub(super) fn outcome<const K: usize>(tally: &Tally<'_, K>) -> Outcome<K> {
    let (view, [best, second]) = (tally.view, tally.right);
    let n = view.count();
    let Some((beam, sum)) = best else {
        return match tally.wrong {
            Some((beam, sum)) => Outcome::OtherWay {
                beam,
                rms: libm::sqrt(sum / n),
            },
            None => Outcome::Nowhere(tally.stopped.map(|(beam, _)| beam)),
        };
    };
    if let Some(beam) = tally.lower() {
        return Outcome::Valley(beam);
    }
    let (rms, radius) = (libm::sqrt(sum / n), view.least_radius());
    let wrong_rms = tally.wrong.map(|(beam, sum)| (beam, libm::sqrt(sum / n)));
    if let Some((beam, wrong_rms)) = wrong_rms
        && rms > CLEARLY_BETTER * wrong_rms
        && rms > NOISE_PART * radius
    {
        return Outcome::OtherWay {
            beam,
            rms: wrong_rms,
        };
    }
    Outcome::Found(Found {
        beam,
        rms,
        second: second.map(|(beam, sum)| (beam, libm::sqrt(sum / n))),
        mirror: wrong_rms
            .is_some_and(|(_, wrong)| wrong <= rms * TOLD_APART + TOLD_APART_PART * radius),
    })
}

/// The minima, where the squared equations leave room for those only that are told apart by nothing else.
pub(super) fn bounded<'a, const K: usize>(
    view: &'a View<'a, K>,
    rough: &Vector3<f64>,
) -> Option<Tally<'a, K>> {
    if view.free_gain() {
        return None;
    }
    let squared = Squared::new(view);
    let radius = view.least_radius();
    let narrow = |rms: f64| {
        let region = squared.region(reach(view, rms))?;
        let is_narrow = region.direction < NARROW && region.foot < NARROW * radius;
        is_narrow.then_some(region)
    };
    let mut tally = Tally::new(view, rough);
    let region = narrow(squared.least_rms())?;
    tally.refine(region.beam);
    if region.mirrored
        && let Some((beam, _)) = tally.right[0].or(tally.wrong)
    {
        tally.refine(squared.image(&beam)?);
    }
    let (_, sum) = tally.right[0]?;
    narrow(libm::sqrt(sum / view.count())).map(|_| tally)
}

/// The minima that starts lead to.
pub(super) fn searched<'a, const K: usize>(
    view: &'a View<'a, K>,
    rough: &Vector3<f64>,
) -> Tally<'a, K> {
    let mut tally = Tally::new(view, rough);
    // A few readings show which minima there are.
    let few = view.thinned(FEW);
    if few.count() < view.count() {
        let mut scouted = Tally::new(&few, rough);
        scouted.search();
        for (beam, _) in scouted.right.iter().chain([&scouted.wrong]).flatten() {
            tally.refine(*beam);
        }
        if let Some(beam) = scouted.lower() {
            tally.refine(beam);
        }
    }
    if tally.right[0].is_none() {
        tally.search();
    } else {
        tally.mirror();
    }
    tally
}

/// Refuses where another minimum on the right side fits about as well.
pub(super) fn single<const K: usize>(
    view: &View<'_, K>,
    found: &Found<K>,
) -> Result<(), PointRefusal> {
    let Some((other, rms)) = found.second else {
        return Ok(());
    };
    // Written so that NaN is refused too.
    if rms > reach(view, found.rms) {
        return Ok(());
    }
    let cos = other.direction.dot(&found.beam.direction);
    let sin = norm(&other.direction.cross(&found.beam.direction));
    Err(PointRefusal::Ambiguous {
        dof: view.dof(),
        best_rms: Mm(found.rms),
        other_rms: Mm(rms),
        apart_deg: libm::atan2(sin, cos).to_degrees(),
        apart: Mm(norm(&(other.foot - found.beam.foot))),
    })
}

/// The rms up to which noise or the axes' own wandering could exchange another minimum with one of this rms.
fn reach<const K: usize>(view: &View<'_, K>, rms: f64) -> f64 {
    let (dof, radius) = (view.dof(), view.least_radius());
    let few = TOLD_APART_FEW.get(dof.wrapping_sub(1)).copied();
    // Of the points beyond the table this is within 3 % up to 60.
    let factor = few.unwrap_or_else(|| 1.2 + 18.0 / count(dof));
    let chance = (rms * factor).min(TOLD_APART_MOST * radius);
    chance.max(rms * TOLD_APART) + TOLD_APART_PART * radius
}

/// Goes down to the last digit with the weights of `view` and proves the minimum.
pub(super) fn settle<const K: usize>(
    view: &View<'_, K>,
    beam: &mut Beam<K>,
) -> Result<Square<K>, PointRefusal> {
    let minimum =
        minimise(*beam, &view.sightings()).map_err(|_stopped| PointRefusal::NoConvergence)?;
    *beam = minimum.surface;
    Ok(minimum.cov_unit)
}

/// What the starts have led to.
pub(super) struct Tally<'a, const K: usize> {
    view: &'a View<'a, K>,
    rough: Vector3<f64>,
    /// The two least minima on the side of the rough direction, where the beam
    /// strikes the balls from outside.
    right: [Option<(Beam<K>, f64)>; 2],
    /// The least of all others.
    wrong: Option<(Beam<K>, f64)>,
    /// The least place on the right side where a start ended that led to no minimum.
    stopped: Option<(Beam<K>, f64)>,
}

impl<'a, const K: usize> Tally<'a, K> {
    fn new(view: &'a View<'a, K>, rough: &Vector3<f64>) -> Self {
        Self {
            view,
            rough: *rough,
            right: [None; 2],
            wrong: None,
            stopped: None,
        }
    }

    /// All starts.
    fn search(&mut self) {
        if let Some(beam) = Squared::new(self.view).beside() {
            self.refine(beam);
        }
        let rough = self.rough;
        let (e1, e2) = perpendicular_frame(&rough);
        for (angle, number) in FAN {
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            for k in 0..number {
                let turn = core::f64::consts::TAU * f64::from(k) / f64::from(number);
                let aside = e1 * libm::cos(turn) + e2 * libm::sin(turn);
                self.start(&(rough * cos + aside * sin));
            }
        }
        // What fits with the beam reversed tells a sign that was swapped.
        self.start(&self.right[0].map_or(-rough, |(best, _)| -best.direction));
        self.mirror();
    }

    /// Where the axes stay near a plane, the mirror image in it of the least minimum is another one. If that is less,
    /// its own image is looked at as well: the one before may have been of neither.
    fn mirror(&mut self) {
        let middle = squared::middle(self.view);
        let [_, _, normal] = squared::plane(self.view, &middle);
        for _ in 0..IMAGES {
            let Some((best, sum)) = self.right[0] else {
                return;
            };
            if let Some(image) = squared::image(&best, &middle, &normal) {
                self.refine(image);
            }
            if self.right[0].is_none_or(|(_, least)| least >= sum) {
                return;
            }
        }
    }

    /// Starts with the ball's centre behind the middle of the points.
    fn start(&mut self, direction: &Vector3<f64>) {
        let n = self.view.count();
        let (mut middle, mut radius) = (Vector3::zeros(), 0.0);
        for seen in self.view.sightings() {
            middle += (seen.from_center + direction * seen.spread) / n;
            radius += seen.radius / n;
        }
        self.refine(
            self.view
                .beam(-middle - direction * (0.75 * radius), *direction),
        );
    }

    /// Goes down from a beam; keeps the minimum unless it is known.
    fn refine(&mut self, start: Beam<K>) {
        let points = self.view.sightings();
        let coarse = match descend(start, &points, COARSE_STEPS) {
            Ok(converged) => return self.keep(&converged),
            Err(Stopped { surface, .. }) => surface,
        };
        let known = self.right.iter().chain([&self.wrong]).flatten();
        let mut near = false;
        for (beam, _) in known {
            near |= self.same(beam, &coarse);
        }
        if near {
            return;
        }
        match descend(coarse, &points, FINE_STEPS) {
            Ok(converged) => self.keep(&converged),
            Err(Stopped { surface, sum, .. }) => {
                let is_least = self.stopped.is_none_or(|(_, least)| sum < least);
                if is_least && self.is_right(&surface) {
                    self.stopped = Some((surface, sum));
                }
            }
        }
    }

    fn keep(&mut self, converged: &Converged<Beam<K>, K>) {
        let (beam, sum) = (converged.surface, converged.system.sum);
        if !self.is_right(&beam) {
            if self.wrong.is_none_or(|(_, least)| sum < least) {
                self.wrong = Some((beam, sum));
            }
            return;
        }
        match self.right {
            [Some((best, least)), second] => {
                if self.same(&best, &beam) {
                    // The same minimum, up to rounding.
                } else if sum < least {
                    self.right = [Some((beam, sum)), Some((best, least))];
                } else if second.is_none_or(|(_, other)| sum < other) {
                    self.right = [Some((best, least)), Some((beam, sum))];
                }
            }
            [None, _] => self.right = [Some((beam, sum)), None],
        }
    }

    /// Whether a beam is on the side of the rough direction, and strikes the balls from outside: there it runs
    /// against the normal.
    fn is_right(&self, beam: &Beam<K>) -> bool {
        let along: f64 = self
            .view
            .sightings()
            .filter_map(|seen| beam.normal(&seen))
            .fold(0.0, |sum, normal| sum + normal.dot(&beam.direction));
        beam.direction.dot(&self.rough) > 0.0 && along <= 0.0
    }

    /// Where a start ended without a minimum, but lower than the best one: that is not the least then. A set that is
    /// singular at its optimum, as points of a great circle are, has false minima beside a valley without one.
    /// With the radius free a start may end at the radius' bound, which is no answer however low.
    fn lower(&self) -> Option<Beam<K>> {
        let ((best, sum), (beam, lower)) = (self.right[0]?, self.stopped?);
        let rounding = ROUNDING_PART * self.view.least_radius();
        let is_lower =
            libm::sqrt(lower) + rounding * libm::sqrt(self.view.count()) < libm::sqrt(sum);
        (is_lower && !self.view.free_radius() && !self.same(&best, &beam)).then_some(beam)
    }

    fn same(&self, a: &Beam<K>, b: &Beam<K>) -> bool {
        norm(&(a.direction - b.direction)) < SAME
            && norm(&(a.foot - b.foot)) < SAME * self.view.least_radius()
    }
}
