//! Which of the things that were seen is which fiducial: sets whose places in the scan are as those in the file.

use nalgebra::{Matrix3, Matrix4};

use super::adjust::Seen;
use super::features::Feature;
use super::own::Own;
use super::{FiducialShape, Sought};
use crate::rigid::{Pose, Vec3, rotation_vector};
use crate::solve::eigen;

/// Fiducials taken for features.
#[derive(Clone, Debug)]
pub(super) struct Match {
    /// Scan from machine.
    pub machine: Pose,
    /// Fiducial and feature.
    pub pairs: Vec<(usize, usize)>,
    /// The points on the features.
    pub points: usize,
    /// The largest distance between a landmark where it is seen and where it should be, in mm.
    pub off_mm: f64,
}

/// How far places may be from where they should be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    pub mm: f64,
    /// For each mm between fiducials.
    pub of_distance: f64,
}

/// Matches at most.
const MOST: usize = 20_000;
/// Of them, those that are told.
const KEPT: usize = 40;
/// Bodies are turned alike to so many rad.
const ALIKE: f64 = 0.03;

/// The motion that carries `from` nearest to `to` in the sense of least squares (Horn, J. Opt. Soc. Am. A 4, 1987), and
/// whether there is but one.
pub(super) fn carry(from: &[Vec3], to: &[Vec3]) -> (Pose, bool) {
    let n = from.len().max(1) as f64;
    let middle = |all: &[Vec3]| all[0] + all.iter().map(|p| p - all[0]).sum::<Vec3>() / n;
    let (a, b) = (middle(from), middle(to));
    let mut s = Matrix3::zeros();
    let mut spread = Matrix3::zeros();
    for (p, q) in from.iter().zip(to) {
        s += (p - a) * (q - b).transpose();
        spread += (p - a) * (p - a).transpose();
    }
    let k = Matrix4::new(
        s[(0, 0)] + s[(1, 1)] + s[(2, 2)],
        s[(1, 2)] - s[(2, 1)],
        s[(2, 0)] - s[(0, 2)],
        s[(0, 1)] - s[(1, 0)],
        s[(1, 2)] - s[(2, 1)],
        s[(0, 0)] - s[(1, 1)] - s[(2, 2)],
        s[(0, 1)] + s[(1, 0)],
        s[(2, 0)] + s[(0, 2)],
        s[(2, 0)] - s[(0, 2)],
        s[(0, 1)] + s[(1, 0)],
        -s[(0, 0)] + s[(1, 1)] - s[(2, 2)],
        s[(1, 2)] + s[(2, 1)],
        s[(0, 1)] - s[(1, 0)],
        s[(2, 0)] + s[(0, 2)],
        s[(1, 2)] + s[(2, 1)],
        -s[(0, 0)] - s[(1, 1)] + s[(2, 2)],
    );
    let (_, vectors) = eigen(&k);
    let q = vectors.column(3);
    let rotation = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
        q[0], q[1], q[2], q[3],
    ))
    .to_rotation_matrix()
    .into_inner();
    let (values, _) = eigen(&spread);
    let motion = Pose {
        rotation,
        translation_mm: b - rotation * a,
    };
    (motion, values[1] > 1e-4 * values[2] && values[2] > 0.0)
}

/// All that matching goes by.
pub(super) struct Matching<'a> {
    sought: &'a Sought<'a>,
    features: &'a [Feature],
    /// The landmarks of each fiducial in the machine.
    marks: Vec<Vec<Vec3>>,
    tolerance: Tolerance,
}

impl<'a> Matching<'a> {
    pub fn new(sought: &'a Sought<'a>, features: &'a [Feature], tolerance: Tolerance) -> Self {
        let marks = (sought.task.fiducials.iter())
            .map(|f| {
                f.shape
                    .landmarks()
                    .iter()
                    .map(|p| f.pose.point(p))
                    .collect()
            })
            .collect();
        Self {
            sought,
            features,
            marks,
            tolerance,
        }
    }

    /// Sets that hold the pose, those with the most fiducials first; if there are none, sets that leave a motion free.
    pub fn all(&self) -> Vec<Match> {
        self.best(self.sets())
    }

    /// The same, and bodies with others: of a body the scan may show two sides only, along which it slides.
    pub fn all_with_bodies(&self) -> Vec<Match> {
        let mut all = self.sets();
        for f in (0..self.marks.len()).filter(|&f| self.is_body(f)) {
            // Each two bodies once.
            for g in (0..self.marks.len()).filter(|&g| g > f || !self.is_body(g)) {
                for c in self.like(f) {
                    let others = self.like(g).filter(|d| *d != c);
                    all.extend(others.filter_map(|d| self.together((f, c), (g, d))));
                }
            }
        }
        self.best(all)
    }

    fn sets(&self) -> Vec<Match> {
        let (mut whole, mut part) = (Vec::new(), Vec::new());
        let mut pairs = Vec::new();
        self.extend(0, &mut pairs, &mut whole, &mut part);
        if whole.is_empty() { part } else { whole }
            .iter()
            .map(|pairs| self.grown(pairs))
            .filter(|m| self.agrees(m))
            .collect()
    }

    /// Those with the most fiducials, and of these with the most points, each pose once.
    fn best(&self, mut all: Vec<Match>) -> Vec<Match> {
        all.sort_by(|a, b| {
            (b.pairs.len(), b.points)
                .cmp(&(a.pairs.len(), a.points))
                .then(a.off_mm.total_cmp(&b.off_mm))
        });
        let mut kept: Vec<Match> = Vec::new();
        for m in all {
            if kept.len() == KEPT {
                break;
            }
            if kept
                .iter()
                .all(|k| self.apart_mm(k, &m) > self.tolerance.mm)
            {
                kept.push(m);
            }
        }
        kept
    }

    /// How far two matches put the fiducials apart, in mm.
    fn apart_mm(&self, a: &Match, b: &Match) -> f64 {
        let marks = self.marks.concat();
        a.machine.apart_mm(&b.machine, &marks)
    }

    fn is_body(&self, f: usize) -> bool {
        let shape = &self.sought.task.fiducials[f].shape;
        matches!(shape, FiducialShape::Mesh(_))
    }

    /// The features that look like a fiducial.
    fn like(&self, f: usize) -> impl Iterator<Item = usize> + use<'_, 'a> {
        let class = self.sought.class[f];
        (0..self.features.len()).filter(move |&c| self.features[c].class == class)
    }

    /// A body and another fiducial where their points, of both together, put them; none if these contradict each other.
    fn together(&self, (f, c): (usize, usize), (g, d): (usize, usize)) -> Option<Match> {
        let task = self.sought.task;
        let machine =
            |f: usize, c: usize| (self.features[c].motion).after(&task.fiducials[f].pose.inverse());
        let by_body = machine(f, c);
        let turned = || {
            let turn = machine(g, d).rotation * by_body.rotation.transpose();
            rotation_vector(&turn).norm() > ALIKE
        };
        if self.is_body(g) && turned() {
            return None;
        }
        let like = by_body.after(&task.fiducials[g].pose);
        let other = Own {
            motion: self.sought.turned_to(&like, &self.features[d], g),
            ..self.features[d].own.clone()
        };
        let seen = Seen {
            machine: by_body,
            own: vec![(f, self.features[c].own.clone()), (g, other)],
        };
        let seen = seen.settled(task);
        let slack = self.slack((self.marks[f][0] - self.marks[g][0]).norm());
        let mut off_mm = 0f64;
        for (k, own) in &seen.own {
            let fiducial = &task.fiducials[*k];
            let there = seen.machine.after(&fiducial.pose);
            off_mm = off_mm.max(own.off_mm(&there));
            // It slides along what it shows, and not off it.
            let middle = fiducial.shape.middle();
            let slid = (there.point(&middle) - own.motion.point(&middle)).norm();
            if off_mm > slack || slid > fiducial.shape.size_mm() {
                return None;
            }
        }
        let mut pairs = vec![(f, c), (g, d)];
        for k in (0..self.marks.len()).filter(|&k| k != f && k != g) {
            let off = |c: &usize| self.off(&seen.machine, k, *c);
            let best = self.like(k).min_by(|a, b| off(a).total_cmp(&off(b)));
            pairs.extend(best.filter(|c| off(c) < slack).map(|c| (k, c)));
        }
        Some(Match {
            machine: seen.machine,
            points: pairs.iter().map(|(_, c)| self.features[*c].inliers).sum(),
            pairs,
            off_mm,
        })
    }

    fn slack(&self, distance: f64) -> f64 {
        self.tolerance.mm + self.tolerance.of_distance * distance
    }

    /// Sets of up to three features that hold a pose, and those of one or two that do not.
    fn extend(
        &self,
        from: usize,
        pairs: &mut Vec<(usize, usize)>,
        whole: &mut Vec<Vec<(usize, usize)>>,
        part: &mut Vec<Vec<(usize, usize)>>,
    ) {
        if !pairs.is_empty() {
            let (p, q) = self.marks_of(pairs);
            if carry(&p, &q).1 {
                if whole.len() < MOST {
                    whole.push(pairs.clone());
                }
                return;
            }
            if part.len() < MOST {
                part.push(pairs.clone());
            }
        }
        if pairs.len() >= 3 {
            return;
        }
        for f in from..self.sought.task.fiducials.len() {
            for (c, feature) in self.features.iter().enumerate() {
                if feature.class == self.sought.class[f]
                    && pairs.iter().all(|(_, other)| *other != c)
                    && pairs.iter().all(|pair| self.fits(*pair, (f, c)))
                {
                    pairs.push((f, c));
                    self.extend(f + 1, pairs, whole, part);
                    pairs.pop();
                }
            }
        }
    }

    /// Whether the distances between two are those of the file.
    fn fits(&self, (f, c): (usize, usize), (g, d): (usize, usize)) -> bool {
        let (a, b) = (&self.marks[f], &self.marks[g]);
        let (p, q) = (&self.features[c].landmarks, &self.features[d].landmarks);
        a.iter().zip(p).all(|(a, p)| {
            b.iter().zip(q).all(|(b, q)| {
                let distance = (a - b).norm();
                (distance - (p - q).norm()).abs() < 2.0 * self.slack(distance)
            })
        })
    }

    fn marks_of(&self, pairs: &[(usize, usize)]) -> (Vec<Vec3>, Vec<Vec3>) {
        let p = pairs
            .iter()
            .flat_map(|(f, _)| self.marks[*f].iter())
            .copied()
            .collect();
        let q = pairs
            .iter()
            .flat_map(|(_, c)| self.features[*c].landmarks.iter())
            .copied()
            .collect();
        (p, q)
    }

    /// The set with everything that its pose explains too.
    fn grown(&self, pairs: &[(usize, usize)]) -> Match {
        let (p, q) = self.marks_of(pairs);
        let (mut machine, whole) = carry(&p, &q);
        let mut pairs = pairs.to_vec();
        if whole {
            let middle = p.iter().sum::<Vec3>() / p.len() as f64;
            for f in 0..self.sought.task.fiducials.len() {
                if pairs.iter().any(|(g, _)| *g == f) {
                    continue;
                }
                let slack = self.slack((self.marks[f][0] - middle).norm());
                let best = (0..self.features.len())
                    .filter(|&c| self.features[c].class == self.sought.class[f])
                    .filter(|c| pairs.iter().all(|(_, d)| d != c))
                    .map(|c| (self.off(&machine, f, c), c))
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                if let Some((_, c)) = best.filter(|(off, _)| *off < slack) {
                    pairs.push((f, c));
                }
            }
            let (p, q) = self.marks_of(&pairs);
            machine = carry(&p, &q).0;
        }
        Match {
            points: pairs.iter().map(|(_, c)| self.features[*c].inliers).sum(),
            off_mm: pairs
                .iter()
                .map(|(f, c)| self.off(&machine, *f, *c))
                .fold(0.0, f64::max),
            machine,
            pairs,
        }
    }

    fn agrees(&self, m: &Match) -> bool {
        let (p, _) = self.marks_of(&m.pairs);
        let far = p.iter().map(|a| (a - p[0]).norm()).fold(0.0, f64::max);
        m.off_mm < 2.0 * self.slack(far)
    }

    /// How far the feature `c` is from where the fiducial `f` should be, in mm.
    pub fn off(&self, machine: &Pose, f: usize, c: usize) -> f64 {
        self.marks[f]
            .iter()
            .zip(&self.features[c].landmarks)
            .map(|(p, q)| (machine.point(p) - q).norm())
            .fold(0.0, f64::max)
    }
}
