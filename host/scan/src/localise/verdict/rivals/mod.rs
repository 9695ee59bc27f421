//! Poses against each other: which points one explains and the other does not.

pub(in crate::localise) mod rims;

use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};

use crate::localise::fit::{Fit, INLIER, boxed};
use crate::localise::search::field::HeightField;
use crate::localise::search::oriented::Oriented;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::{measure, measure_within};
use crate::surface::CompositeSurface;

/// Where points stand by a pose.
pub(in crate::localise) struct Standing {
    /// How far each lies from the part, in units of the noise, negative within the material; infinite, with that sign,
    /// where it is clearly none of the part's.
    pub off: Vec<f64>,
    /// The face that each is nearest to; 0 for those that are clearly none of the part's.
    pub face: Vec<u32>,
}

impl Standing {
    /// Which points lie on the part.
    pub fn on(&self) -> Vec<bool> {
        self.off.iter().map(|off| on(*off)).collect()
    }
}

/// Where each point stands if `motion` puts the part, for a noise of `sigma_mm`.
pub(in crate::localise) fn off(
    (surface, field): (&CompositeSurface, &HeightField),
    points: &[Vec3],
    motion: &Pose,
    sigma_mm: f64,
    threads: Threads,
) -> Standing {
    let limit = CLEARLY * sigma_mm;
    let inside = boxed(surface, motion, limit);
    let mut off = vec![f64::INFINITY; points.len()];
    let mut face = vec![0; points.len()];
    let (mut place, mut near, mut hints) = (Vec::new(), Vec::new(), Vec::new());
    for (i, q) in points.iter().enumerate() {
        if !inside(q) {
            continue;
        }
        let p = motion.undo(q);
        match field.beyond(&p, limit) {
            Some(far) => off[i] = far,
            None => {
                place.push(i);
                near.push(*q);
                hints.push(field.at(&p).map_or(0, |(_, face)| face));
            }
        }
    }
    let measured = measure(surface, &near, motion, &hints, threads);
    for (m, i) in measured.iter().zip(place) {
        off[i] = m.distance_mm / sigma_mm;
        face[i] = m.face as u32;
    }
    Standing { off, face }
}

/// Which points lie on the part where `motion` puts it.
pub(in crate::localise) fn explained(
    (surface, field): (&CompositeSurface, &HeightField),
    points: &[Vec3],
    motion: &Pose,
    sigma_mm: f64,
    threads: Threads,
) -> Vec<bool> {
    let limit = INLIER * sigma_mm;
    let inside = boxed(surface, motion, limit);
    let mut seen = vec![false; points.len()];
    let (mut place, mut near, mut hints) = (Vec::new(), Vec::new(), Vec::new());
    for (i, q) in points.iter().enumerate() {
        let p = motion.undo(q);
        if inside(q) && field.beyond(&p, limit).is_none() {
            place.push(i);
            near.push(*q);
            hints.push(field.at(&p).map_or(0, |(_, face)| face));
        }
    }
    let measured = measure_within(surface, &near, motion, &hints, limit, threads);
    for (m, i) in measured.iter().zip(place) {
        seen[i] = on(m.distance_mm / sigma_mm);
    }
    seen
}

/// By how many points the first explains more than the second, and what of that chance can be.
pub(in crate::localise) fn advantage(first: &[bool], second: &[bool]) -> (f64, f64) {
    let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count() as f64;
    let (mine, theirs) = (only(first, second), only(second, first));
    (mine - theirs, 5.0 * (mine + theirs).sqrt() + 8.0)
}

/// The same of points that lie on the part by the one and are none of it by the other. Stray points fall to either by the
/// toss of a coin.
pub(in crate::localise) fn clear_advantage(first: &Standing, second: &Standing) -> (f64, f64) {
    let only = |a: &[f64], b: &[f64]| {
        let only = a
            .iter()
            .zip(b)
            .filter(|(a, b)| on(**a) && is_clearly_off(**b));
        only.count() as f64
    };
    let (mine, theirs) = (only(&first.off, &second.off), only(&second.off, &first.off));
    (mine - theirs, 4.0 * (mine + theirs).sqrt() + 4.0)
}

/// A point this many times the noise off is none of the part's, whatever the noise of either pose does.
const CLEARLY: f64 = 3.0 * INLIER;

/// Points in the air that what lies within material can support.
const LEAST_IN_AIR: f64 = 3.0;

/// Two poses contradict each other if the lesser has this share of the points of its own that the other has.
const CONFLICT: f64 = 0.1;

/// Whether a point at this distance ([`off`]) lies on the part.
pub(in crate::localise) fn on(off: f64) -> bool {
    off.abs() < INLIER
}

/// Whether a point at this distance is none of the part's.
pub(in crate::localise) fn is_clearly_off(off: f64) -> bool {
    off.abs() >= CLEARLY
}

/// Whether a point at this distance lies deep within the part's material, where a scan has none.
pub(in crate::localise) fn is_within(off: f64) -> bool {
    off < -CLEARLY
}

/// Which of two poses the points ([`off`]) speak for: the first if greater, the second if less, neither if equal.
///
/// Points on the one that stand clearly in the air by the other are not of the other: few of them are enough, more than
/// stray points make where the surfaces part (`own_share` of the model's surface). Points that lie within the other's
/// material only say that something of it is missing there. A pin that no scan shows may have been left out, so they
/// must be many.
///
/// If either pose has points of its own in the air of the other, one of them lies on things that are none of the part's.
/// A table or a vice shows more points than a part of which little is seen, and any side of a part can be put on it: the
/// sides (`sides`, by face) that the scan goes beyond (`passed`) do not count then, nor, where there is none, the side with
/// the most points of its own of either.
pub(in crate::localise) fn compare(
    first: &Standing,
    second: &Standing,
    own_share: f64,
    sides: &[u32],
    passed: [&HashSet<u32>; 2],
) -> Ordering {
    let (mut air, mut all, mut strays) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    let mut by_side: [HashMap<u32, f64>; 2] = Default::default();
    for (i, (a, b)) in first.off.iter().zip(&second.off).enumerate() {
        for (k, (here, there)) in [(a, b), (b, a)].into_iter().enumerate() {
            if on(*here) && there.abs() > CLEARLY {
                all[k] += 1.0;
                if *there > 0.0 {
                    air[k] += 1.0;
                    let face = [first, second][k].face[i] as usize;
                    let side = sides.get(face).copied().unwrap_or(u32::MAX);
                    *by_side[k].entry(side).or_default() += 1.0;
                }
            } else if !on(*here) && here.abs() <= CLEARLY {
                strays[k] += 1.0;
            }
        }
    }
    let net = |of: [f64; 2]| of[0] - of[1];
    let sum = |of: [f64; 2]| of[0] + of[1];
    // Stray points fall to either pose by the toss of a coin; and the layers beside the surface, twice as thick as that
    // on it, tell how many there are at all.
    let tossed = 3.0 * sum(air).sqrt();
    let strays = (f64::max(strays[0], strays[1]) / 2.0 + 1.0) * own_share;
    let stray = strays + 3.0 * strays.sqrt() + 5.0;
    let (less, more) = (air[0].min(air[1]), air[0].max(air[1]));
    let any = passed.iter().any(|passed| !passed.is_empty());
    if less > stray && (any || less > CONFLICT * more) {
        let left = [0, 1].map(|k| {
            if any {
                let kept = by_side[k]
                    .iter()
                    .filter(|(side, _)| !passed[k].contains(side));
                kept.map(|(_, count)| count).sum::<f64>()
            } else {
                air[k] - by_side[k].values().fold(0.0, |a, b| f64::max(a, *b))
            }
        });
        return if net(left).abs() > 3.0 * sum(left).sqrt() + stray {
            net(left).total_cmp(&0.0)
        } else {
            Ordering::Equal
        };
    }
    let many = 5.0 * sum(all).sqrt() + 8.0;
    let speaks = net(air).abs();
    // What lies within the other's material supports them, if they are some.
    let inside = (net(all) - net(air)) * net(air).signum();
    let supported = if speaks >= LEAST_IN_AIR {
        speaks + inside.max(0.0) / 3.0
    } else {
        speaks
    };
    let by_air = (speaks > tossed || supported > stray) && speaks + inside > 0.5 * speaks;
    if by_air {
        net(air).total_cmp(&0.0)
    } else if net(all).abs() > many {
        net(all).total_cmp(&0.0)
    } else {
        Ordering::Equal
    }
}

/// The share of the model's surface that is clearly off the surface after a motion of the model.
pub(in crate::localise) fn own_share(
    part: (&CompositeSurface, &HeightField),
    samples: &[Oriented],
    turn: &Pose,
    sigma_mm: f64,
    threads: Threads,
) -> f64 {
    let points: Vec<Vec3> = samples.iter().map(|s| s.at).collect();
    let standing = off(part, &points, turn, sigma_mm, threads);
    let apart = standing
        .off
        .iter()
        .filter(|off| off.abs() > CLEARLY)
        .count();
    // As many more as chance may have left out.
    (apart as f64 + 3.0) / points.len().max(1) as f64
}

/// The best first.
pub(in crate::localise) fn sort(fits: &mut [Fit]) {
    fits.sort_by(|a, b| {
        b.worth
            .cmp(&a.worth)
            .then(a.sigma_mm.total_cmp(&b.sigma_mm))
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing(off: Vec<f64>) -> Standing {
        Standing {
            face: vec![0; off.len()],
            off,
        }
    }

    /// Distances of points to two poses: so many on both, and on the one alone where the other has this.
    fn seen(both: usize, alone: &[(usize, f64)]) -> [Standing; 2] {
        let mut of = [vec![0.5; both], vec![0.5; both]];
        for &(count, there) in alone {
            of[0].extend(std::iter::repeat_n(-0.5, count));
            of[1].extend(std::iter::repeat_n(there, count));
        }
        of.map(standing)
    }

    fn says(alone: &[(usize, f64)], strays: usize) -> Ordering {
        let [mut first, mut second] = seen(1000, alone);
        for (of, off) in [(&mut first, 8.0), (&mut second, -8.0)] {
            of.off.extend(vec![off; strays]);
            of.face.extend(vec![0; strays]);
        }
        way(&first, &second)
    }

    fn way(first: &Standing, second: &Standing) -> Ordering {
        let sides = [0, 1, 2];
        let none = HashSet::new();
        let way = compare(first, second, 0.02, &sides, [&none; 2]);
        let back = compare(second, first, 0.02, &sides, [&none; 2]);
        assert_eq!(back, way.reverse());
        way
    }

    #[test]
    fn few_points_in_the_air_of_the_other_pose_decide_and_as_few_within_it_do_not() {
        assert_eq!(says(&[(7, 50.0)], 4), Ordering::Greater);
        assert_eq!(says(&[(4, 50.0)], 4), Ordering::Equal);
        // Just off, as the noise of either pose makes them: no word.
        assert_eq!(says(&[(30, 8.0)], 4), Ordering::Equal);
        // Where a pin would hide them, if it were there.
        assert_eq!(says(&[(14, -50.0)], 4), Ordering::Equal);
        assert_eq!(says(&[(60, -50.0)], 4), Ordering::Greater);
        assert_eq!(says(&[(5, 50.0), (14, -50.0)], 4), Ordering::Greater);
        // Among many stray points seven are nothing.
        assert_eq!(says(&[(7, 50.0)], 900), Ordering::Equal);
    }
    /// So many points of the first on each of three sides, in the air of the second, and the other way round.
    fn contrary(first: [usize; 3], second: [usize; 3]) -> Ordering {
        let mut of = [standing(vec![0.5; 500]), standing(vec![0.5; 500])];
        for (k, counts) in [first, second].into_iter().enumerate() {
            for (face, count) in counts.into_iter().enumerate() {
                of[k].off.extend(std::iter::repeat_n(0.5, count));
                of[1 - k].off.extend(std::iter::repeat_n(50.0, count));
                for of in &mut of {
                    of.face.extend(std::iter::repeat_n(face as u32, count));
                }
            }
        }
        way(&of[0], &of[1])
    }

    /// A bar within the corner of a chuck: three of its sides lie in the chuck's faces.
    #[test]
    fn sides_that_the_scan_goes_beyond_are_not_worth_their_many_points() {
        let mut of = [standing(vec![0.5; 100]), standing(vec![0.5; 100])];
        for (k, counts) in [[300, 200, 100], [3000, 2000, 3000]]
            .into_iter()
            .enumerate()
        {
            for (face, count) in counts.into_iter().enumerate() {
                of[k].off.extend(std::iter::repeat_n(0.5, count));
                of[1 - k].off.extend(std::iter::repeat_n(50.0, count));
                for of in &mut of {
                    of.face.extend(std::iter::repeat_n(face as u32, count));
                }
            }
        }
        let (none, all) = (HashSet::new(), HashSet::from([0, 1, 2]));
        let says = |passed| compare(&of[0], &of[1], 0.02, &[0, 1, 2], passed);
        assert_eq!(says([&none, &all]), Ordering::Greater);
        assert_eq!(says([&none, &none]), Ordering::Less);
        assert_eq!(says([&all, &all]), Ordering::Equal);
    }

    /// A table under a part of which little is seen: more points than the part has.
    #[test]
    fn a_side_put_on_a_table_is_not_worth_its_many_points() {
        assert_eq!(contrary([240, 130, 90], [0, 500, 0]), Ordering::Greater);
        assert_eq!(contrary([240, 130, 90], [0, 900, 4]), Ordering::Greater);
        // One side against another one: who knows?
        assert_eq!(contrary([400, 0, 0], [0, 900, 0]), Ordering::Equal);
        // Nothing speaks against the first.
        assert_eq!(contrary([400, 0, 0], [0, 3, 0]), Ordering::Greater);
    }
}
