//! Mounts by the sides of the laser's plane that balls may be on. A cut shows where the ball's centre is, but for the sign of
//! how far it is from that plane. With the sign given, the mount follows without a wrong valley, so every choice of signs of
//! a few cuts is tried: one of them is the right one.

use nalgebra::Vector3;

use super::distance::apart;
use super::model::{MountModel, step_mount};
use crate::calibrate::features::{Cut, SampleSights};
use crate::calibrate::observations::Observations;
use crate::calibrate::solve::{Model, TakeRow, descend};
use umi_kinematics::Pose;

/// So many cuts' signs are tried, every choice: with a radius that is known, and one that is not.
const MOST_CUTS: (usize, usize) = (10, 8);
/// A radius that is not known is tried as so many times that of the largest cut.
const RADII: [f64; 7] = [1.001, 1.01, 1.03, 1.07, 1.15, 1.3, 1.5];
/// Balls of centres that are not known need so many cuts each to say something of the mount.
const CUTS_EACH: usize = 3;
/// Steps to a mount: without the wrong sides it is nearly linear.
const STEPS: usize = 8;
/// A mount may be so far from the guess, which is right to 20 mm and 6°: mm, degrees. What signs and a radius that are
/// nearly right leave is beyond that.
const NEAR: (f64, f64) = (35.0, 12.0);
/// Mounts that are less apart begin the same descent: mm, degrees.
const SAME: (f64, f64) = (1.0, 0.5);
/// So many mounts are given, the best first.
const MOST_MOUNTS: usize = 12;

/// Balls whose centres are known in the sensor's frame.
#[derive(Clone)]
struct SidedBalls<'a> {
    all: &'a Observations,
    cuts: &'a [Cut],
    /// How far each is across the laser's plane.
    across_mm: Vec<f64>,
    mount: Pose,
    centres: Vec<Vector3<f64>>,
    centres_known: bool,
    sought: [bool; 6],
}

impl Model for SidedBalls<'_> {
    fn unknowns(&self) -> (usize, usize) {
        let centres = if self.centres_known {
            0
        } else {
            3 * self.centres.len()
        };
        (
            centres,
            self.sought.iter().filter(|sought| **sought).count(),
        )
    }

    fn residuals(&self) -> usize {
        3 * self.cuts.len()
    }

    fn rows(&self, row: &mut TakeRow<'_>) {
        let (nuisances, _) = self.unknowns();
        for (cut, across_mm) in self.cuts.iter().zip(&self.across_mm) {
            let flange = &self.all.flanges[cut.flange];
            let seen_mm = cut.centre_mm + Vector3::new(0.0, *across_mm, 0.0);
            let arm_mm = self.mount.rotation * seen_mm;
            let at_mm = flange.point(&(arm_mm + self.mount.translation_mm));
            let off_mm = at_mm - self.centres[cut.feature];
            for axis in 0..3 {
                row(off_mm[axis], &mut |line| {
                    if !self.centres_known {
                        line[3 * cut.feature + axis] = -1.0;
                    }
                    let by_shift: Vector3<f64> = flange.rotation.row(axis).transpose();
                    let by_turn = arm_mm.cross(&by_shift);
                    let by = by_turn.iter().chain(&by_shift).zip(&self.sought);
                    let sought = by.filter(|(_, sought)| **sought);
                    for (value, (by, _)) in line[nuisances..].iter_mut().zip(sought) {
                        *value = *by;
                    }
                });
            }
        }
    }

    fn step(&mut self, step: &[f64]) {
        let (nuisances, _) = self.unknowns();
        let (centres, mount) = step.split_at(nuisances);
        for (centre, step) in self.centres.iter_mut().zip(centres.chunks_exact(3)) {
            *centre += Vector3::from_column_slice(step);
        }
        step_mount(&mut self.mount, &self.sought, mount);
    }
}

/// Where to begin descents, the best first: mounts near the first one that bring the cuts' centres together, each with
/// sides of its own.
pub(super) fn by_sides<'a>(first: &MountModel<'a>, cuts: &[Cut]) -> Vec<MountModel<'a>> {
    let few = few_of(first, cuts);
    if few.is_empty() {
        return Vec::new();
    }
    let largest_mm = cuts.iter().map(|cut| cut.radius_mm).fold(0.0, f64::max);
    let radii = if first.radius_free {
        RADII.map(|times| times * largest_mm).to_vec()
    } else {
        vec![first.radius_mm]
    };
    let mut found: Vec<(f64, f64, SidedBalls<'_>)> = Vec::new();
    for radius_mm in radii {
        for sides in 0..1_usize << few.len() {
            let mut balls = SidedBalls {
                all: first.all,
                across_mm: across(&few, radius_mm, sides),
                cuts: &few,
                mount: first.mount,
                centres: centres(first),
                centres_known: first.centres_known,
                sought: first.sought,
            };
            let ssq = descend(&mut balls, STEPS);
            let (shift_mm, turn_deg) = apart(&balls.mount, &first.mount);
            if shift_mm <= NEAR.0 && turn_deg <= NEAR.1 {
                found.push((ssq, radius_mm, balls));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut mounts: Vec<MountModel<'a>> = Vec::new();
    for (_, radius_mm, balls) in found {
        let is_same = |other: &MountModel<'_>| {
            let (shift_mm, turn_deg) = apart(&balls.mount, &other.mount);
            shift_mm < SAME.0 && turn_deg < SAME.1
        };
        if mounts.len() == MOST_MOUNTS {
            break;
        }
        if mounts.iter().any(is_same) {
            continue;
        }
        let mut begin = first.clone();
        begin.mount = balls.mount;
        begin.radius_mm = radius_mm;
        for (feature, centre) in begin.features.iter_mut().zip(&balls.centres) {
            *feature = SampleSights::Ball { centre_mm: *centre };
        }
        mounts.push(begin);
    }
    mounts
}

/// A few cuts, spread over all and over the balls.
fn few_of(first: &MountModel<'_>, cuts: &[Cut]) -> Vec<Cut> {
    let most = if first.radius_free {
        MOST_CUTS.1
    } else {
        MOST_CUTS.0
    };
    let mut of_balls: Vec<Vec<Cut>> = vec![Vec::new(); first.features.len()];
    for cut in cuts {
        of_balls[cut.feature].push(*cut);
    }
    if !first.centres_known {
        of_balls.sort_by_key(|of| std::cmp::Reverse(of.len()));
        of_balls.truncate(most / CUTS_EACH);
    }
    let sorted = of_balls.concat();
    let n = sorted.len();
    let few = n.min(most);
    (0..few).map(|i| sorted[i * n / few]).collect()
}

/// How far the cuts are across the laser's plane, by a bit each on this side or on that.
fn across(cuts: &[Cut], radius_mm: f64, sides: usize) -> Vec<f64> {
    let mm = |(place, cut): (usize, &Cut)| {
        let mm = (radius_mm.powi(2) - cut.radius_mm.powi(2)).max(0.0).sqrt();
        if sides >> place & 1 == 0 { mm } else { -mm }
    };
    cuts.iter().enumerate().map(mm).collect()
}

fn centres(model: &MountModel<'_>) -> Vec<Vector3<f64>> {
    let of = model.features.iter().map(|feature| match feature {
        SampleSights::Ball { centre_mm } => *centre_mm,
        SampleSights::Plane { anchor_mm, .. } => *anchor_mm,
    });
    of.collect()
}
