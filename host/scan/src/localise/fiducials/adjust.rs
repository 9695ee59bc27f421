//! Whether fiducials agree: each is fitted by itself, and what the others say of its place is compared with that.

use nalgebra::{Matrix6, Vector6};

use super::super::fit::row;
use super::FiducialTask;
use super::own::{Own, rank};
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::{eigen, pseudo_solve};

/// What scans and fiducials are never better than, in units of the noise: errors that all points of one fiducial share.
const SHARED: f64 = 0.5;

/// What is more than chance, in standard deviations of χ²; and how much more one alone can bend the pose, in squares, than
/// all of them do that differ as much.
const SURELY: f64 = 3.0;
const ONE: f64 = 2.0;

/// Fiducials, each where its own points put it.
pub(super) struct Seen {
    /// Scan from machine, by all of them.
    pub machine: Pose,
    /// Number of the fiducial, and where it is.
    pub own: Vec<(usize, Own)>,
}

/// One that the others put elsewhere.
#[derive(Clone, Debug)]
pub(super) struct Stray {
    pub fiducial: usize,
    /// Where it is, less where the others put it, in the machine's frame, in mm.
    pub off_mm: Vec3,
    /// By how much it is turned against where the others put it, in rad; 0 where that is not known.
    pub turned_rad: f64,
}

/// Whether all agree, as far as they are known.
pub(super) struct Agreement {
    /// Those that do not; none where a scale brings all of them together.
    pub strays: Vec<Stray>,
    /// The scale that does, with its standard uncertainty.
    pub scale: Option<(f64, f64)>,
    /// By how much more they differ than their noise and their own doubts say: χ² over its degrees of freedom.
    pub ratio: f64,
}

/// A motion is held by all together if they hold it by this share of the best one, in squares: less than what the fit of the
/// points takes for free, which has the last word.
const TOGETHER: f64 = 1e-4;
/// Where all motions are held, what is nothing but rounding.
const LEAST: f64 = 1e-12;

struct Equations {
    /// The information of each, with its own doubt in it.
    weights: Vec<Matrix6<f64>>,
    /// Where each says that the machine is: a step from the common pose.
    steps: Vec<Vector6<f64>>,
    ranks: Vec<usize>,
    about: Vec3,
    arm: f64,
}

impl Seen {
    /// The pose by all of them, each weighed by what its points and its own doubt say.
    pub fn settled(mut self, task: &FiducialTask<'_>) -> Self {
        // What none of them holds stays: there noise alone would carry it far.
        let least = if self.rank() == 6 { LEAST } else { TOGETHER };
        for _ in 0..3 {
            let e = self.equations(task, SHARED);
            let x = e.of(&(0..e.steps.len()).collect::<Vec<_>>(), least);
            let step = Vector6::new(x[0] / e.arm, x[1] / e.arm, x[2] / e.arm, x[3], x[4], x[5]);
            self.machine = stepped(&self.machine, &step, &e.about);
        }
        self
    }

    /// How many motions all their points together hold.
    pub fn rank(&self) -> usize {
        let (about, arm) = self.middle();
        let of = |(_, own): &(usize, Own)| own.information(&about, arm);
        rank(&self.own.iter().map(of).sum(), TOGETHER)
    }

    /// How well the others say where these points lie, one of its sides, of the fiducial `own[k]`: the standard uncertainty
    /// along their normals, in mm.
    pub fn told_by_others(&self, task: &FiducialTask<'_>, k: usize, side: &[usize]) -> f64 {
        let mut others = Self {
            machine: self.machine,
            own: self.own.clone(),
        };
        let on = &mut others.own[k].1.on;
        let taken: Vec<_> = side.iter().map(|&i| on[i]).collect();
        let mut i = 0;
        on.retain(|_| {
            i += 1;
            side.binary_search(&(i - 1)).is_err()
        });
        others.own.retain(|(_, own)| !own.on.is_empty());
        let Some((first, measured)) = taken.first() else {
            return 0.0;
        };
        let middle =
            first + taken.iter().map(|(q, _)| q - first).sum::<Vec3>() / taken.len() as f64;
        let e = others.equations(task, SHARED);
        let (values, vectors) = eigen(&e.weights.iter().sum());
        let row = row(&middle, measured, &e.about, e.arm);
        let squares: f64 = (0..6)
            .map(|i| vectors.column(i).dot(&row).powi(2) / values[i].max(1e-12))
            .sum();
        squares.sqrt()
    }

    /// The middle of all, and how far they are from it.
    fn middle(&self) -> (Vec3, f64) {
        let middles: Vec<Vec3> = self.own.iter().map(|(_, own)| own.middle()).collect();
        let about = middles.iter().sum::<Vec3>() / middles.len().max(1) as f64;
        let arm = middles.iter().map(|m| (m - about).norm());
        (about, arm.fold(10.0, f64::max))
    }

    fn equations(&self, task: &FiducialTask<'_>, shared: f64) -> Equations {
        let (about, arm) = self.middle();
        let mut e = Equations {
            weights: Vec::new(),
            steps: Vec::new(),
            ranks: Vec::new(),
            about,
            arm,
        };
        for (k, own) in &self.own {
            let fiducial = &task.fiducials[*k];
            let mut group = fiducial.group(&self.machine);
            let rough = shared * own.sigma_mm;
            for i in 0..3 {
                group.cov[(i, i)] += (rough / fiducial.shape.size_mm()).powi(2);
                group.cov[(i + 3, i + 3)] += rough * rough;
            }
            let h = own.information(&about, arm);
            let sigma2 = own.sigma_mm * own.sigma_mm;
            let groups = super::super::uncertainty::Groups {
                all: &[group],
                of: &[],
            };
            let damping = groups.damping(&[h], &about, arm, sigma2);
            let w = damping[0] * h / sigma2;
            e.weights.push((w + w.transpose()) / 2.0);
            let from = self.machine.after(&fiducial.pose);
            e.steps.push(own.step_from(&from, &about, arm));
            e.ranks.push(own.rank());
        }
        e
    }

    /// How well they agree where the noise of each is known.
    pub fn agreement(&self, task: &FiducialTask<'_>) -> Agreement {
        let all: Vec<usize> = (0..self.own.len()).collect();
        let bare = self.equations(task, 0.0);
        let freedom = bare.freedom(&all).max(1);
        let ratio = bare.misfit(&all) / freedom as f64;
        // More than chance is of one of them, mostly, and where the others hardly check it, it bends the pose by more than
        // what all would.
        let chance = 1.0 + SURELY * (2.0 / freedom as f64).sqrt();
        let ratio = if ratio > chance { ONE * ratio } else { ratio };
        let e = self.equations(task, SHARED);
        if e.agree_of(&all) {
            return Agreement {
                strays: Vec::new(),
                scale: None,
                ratio,
            };
        }
        let middles = self.own.iter().map(|(_, own)| own.middle() - e.about);
        let scale = e.scaled(&middles.collect::<Vec<_>>());
        let strays = if scale.is_some() {
            Vec::new()
        } else {
            self.strays(task)
        };
        Agreement {
            strays,
            scale,
            ratio,
        }
    }

    /// Those that disagree with the others; all of them if it cannot be told which. None if all agree.
    pub fn strays(&self, task: &FiducialTask<'_>) -> Vec<Stray> {
        let e = self.equations(task, SHARED);
        if e.agree_of(&(0..self.own.len()).collect::<Vec<_>>()) {
            return Vec::new();
        }
        let mut left: Vec<usize> = (0..self.own.len()).collect();
        let mut out: Vec<usize> = Vec::new();
        // One after the other, the one without which the rest agrees best. Two balls turn about their line: what they say of
        // a third one's place is nothing, so the rest must hold what all do.
        let held = e.held(&left);
        while left.len() > 2 && !e.agree_of(&left) {
            let mut without: Vec<(f64, usize)> = (0..left.len())
                .filter_map(|i| {
                    let mut rest = left.clone();
                    rest.remove(i);
                    (e.freedom(&rest) > 0 && e.held(&rest) == held)
                        .then(|| (e.misfit(&rest) - e.likely(&rest), i))
                })
                .collect();
            without.sort_by(|a, b| a.0.total_cmp(&b.0));
            // Where the rest agrees without this one or without that one, it cannot be told which it is.
            if without.len() < 2 || without[1].0 <= 0.0 {
                break;
            }
            out.push(left.remove(without[0].1));
        }
        if !e.agree_of(&left) || e.freedom(&left) == 0 {
            out = (0..self.own.len()).collect();
            left.clear();
        }
        out.into_iter()
            .map(|i| {
                let others: Vec<usize> = if left.is_empty() {
                    (0..self.own.len()).filter(|j| *j != i).collect()
                } else {
                    left.clone()
                };
                let x = e.steps[i] - e.of(&others, LEAST);
                let (k, own) = &self.own[i];
                let w = Vec3::new(x[0], x[1], x[2]) / e.arm;
                let shape = &task.fiducials[*k].shape;
                let at = own.motion.point(&shape.middle());
                let off = Vec3::new(x[3], x[4], x[5]) + w.cross(&(at - e.about));
                Stray {
                    fiducial: *k,
                    off_mm: self.machine.rotation.tr_mul(&off),
                    // A ball has no turn.
                    turned_rad: if e.ranks[i] > 3 { w.norm() } else { 0.0 },
                }
            })
            .collect()
    }
}

impl Equations {
    /// `least`: motions that are held by a smaller share of the best one are left out.
    fn of(&self, these: &[usize], least: f64) -> Vector6<f64> {
        let sum: Matrix6<f64> = these.iter().map(|&i| self.weights[i]).sum();
        let right: Vector6<f64> = these.iter().map(|&i| self.weights[i] * self.steps[i]).sum();
        pseudo_solve(&sum, &right, least)
    }

    fn agree_of(&self, these: &[usize]) -> bool {
        self.misfit(these) <= self.likely(these)
    }

    /// The scale by which all agree, if there is one, with its standard uncertainty. `middles`: where each is, from `about`.
    fn scaled(&self, middles: &[Vec3]) -> Option<(f64, f64)> {
        const STEP: f64 = 1e-3;
        let all: Vec<usize> = (0..self.steps.len()).collect();
        let grown = |by: f64| {
            let mut other = Self {
                weights: self.weights.clone(),
                steps: self.steps.clone(),
                ranks: self.ranks.clone(),
                ..*self
            };
            for (step, middle) in other.steps.iter_mut().zip(middles) {
                for k in 0..3 {
                    step[k + 3] -= by * middle[k];
                }
            }
            other
        };
        // A sum of squares is a parabola in the scale.
        let [less, same, more] = [-STEP, 0.0, STEP].map(|by| grown(by).misfit(&all));
        let bent = (less + more - 2.0 * same) / (STEP * STEP);
        if bent.is_nan() || bent <= 0.0 || self.freedom(&all) < 2 {
            return None;
        }
        let best = (less - more) / (2.0 * STEP * bent);
        let agrees = grown(best).agree_of(&all);
        agrees.then_some((1.0 + best, (2.0 / bent).sqrt()))
    }

    /// The sum of squares that is left.
    fn misfit(&self, these: &[usize]) -> f64 {
        let x = self.of(these, LEAST);
        these
            .iter()
            .map(|&i| {
                let off = self.steps[i] - x;
                off.dot(&(self.weights[i] * off))
            })
            .sum()
    }

    /// What of that chance can be, once in a hundred thousand.
    fn likely(&self, these: &[usize]) -> f64 {
        let dof = self.freedom(these) as f64;
        dof + 5.0 * (2.0 * dof).sqrt() + 12.0
    }

    /// Conditions beyond those that hold the pose.
    fn freedom(&self, these: &[usize]) -> usize {
        let all: usize = these.iter().map(|&i| self.ranks[i]).sum();
        all.saturating_sub(self.held(these))
    }

    /// The motions that these hold.
    fn held(&self, these: &[usize]) -> usize {
        let sum: Matrix6<f64> = these.iter().map(|&i| self.weights[i]).sum();
        let (values, _) = eigen(&sum);
        values.iter().filter(|v| **v > 1e-7 * values[5]).count()
    }
}
