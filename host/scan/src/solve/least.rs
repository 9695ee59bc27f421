//! The pose of a model whose distances to points have the least sum of costs.

use nalgebra::{Matrix3, SMatrix, SVector, Vector6};

use super::kernel::Kernel;
use super::small::pseudo_solve;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::surface::{CompositeSurface, Near};

/// Points that one thread takes at a time.
const CHUNK: usize = 1024;

/// A point measured against the model where it stands: everything in the frame of the scan.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// The signed distance in mm.
    pub distance_mm: f64,
    /// The direction in which it grows.
    pub direction: Vec3,
    /// The face that is nearest.
    pub face: usize,
}

/// Every point against the surface carried by `motion`. `faces`: those that were nearest a moment ago, or nothing.
#[must_use]
pub fn measure(
    surface: &CompositeSurface,
    points: &[Vec3],
    motion: &Pose,
    faces: &[usize],
    threads: Threads,
) -> Vec<Measured> {
    measure_within(surface, points, motion, faces, f64::INFINITY, threads)
}

/// The same, faster: points farther than `limit` mm have the distance `f64::MAX`.
#[must_use]
pub(crate) fn measure_within(
    surface: &CompositeSurface,
    points: &[Vec3],
    motion: &Pose,
    faces: &[usize],
    limit: f64,
    threads: Threads,
) -> Vec<Measured> {
    let mut all = Vec::with_capacity(points.len());
    let parts = threads.chunks(points.len(), CHUNK, |range| {
        let mut last = 0;
        let part: Vec<Measured> = range
            .map(|i| {
                let hint = faces.get(i).copied().unwrap_or(last);
                let near = surface
                    .near_within(&motion.undo(&points[i]), hint, limit)
                    .unwrap_or(Near {
                        distance_mm: f64::MAX,
                        direction: Vec3::z(),
                        face: hint,
                    });
                last = near.face;
                Measured {
                    distance_mm: near.distance_mm,
                    direction: motion.rotation * near.direction,
                    face: near.face,
                }
            })
            .collect();
        part
    });
    for part in parts {
        all.extend(part);
    }
    all
}

/// Whether the distances are taken from zero or from a common offset that is sought too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offset {
    /// From zero.
    Zero,
    /// From their mean: only what varies counts.
    Free,
}

/// What is to be solved.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// The model.
    pub surface: &'a CompositeSurface,
    /// The points in the frame of the scan, in mm.
    pub points: &'a [Vec3],
    /// What each point counts; all the same if there are none.
    pub weights: &'a [f64],
    /// What a distance costs.
    pub kernel: Kernel,
    /// Whether an offset is free.
    pub offset: Offset,
    /// Where the turns go through, in the frame of the scan.
    pub pivot: Vec3,
    /// Locked components (turns a, b, c, then x, y, z): exactly zero from the start.
    pub locked: [bool; 6],
    /// Steps at most.
    pub steps: usize,
    /// Points farther than this, in mm, need no distance: the kernel takes them all alike.
    pub within_mm: f64,
    /// A step that moves no point by more than this, in mm, is the last one; 0: as far as the numbers go.
    pub enough_mm: f64,
    /// Threads.
    pub threads: Threads,
}

/// Where a solver has come to rest.
#[derive(Clone, Debug)]
pub struct Settled {
    /// Scan from model.
    pub motion: Pose,
    /// The offset in mm, 0 if it is not free.
    pub offset_mm: f64,
    /// The sum of costs in mm².
    pub cost: f64,
    /// The points against the model there.
    pub measured: Vec<Measured>,
    /// The steps it took.
    pub steps: usize,
}

impl Task<'_> {
    /// Gauss and Newton with weights renewed at each step, from `start`. A step that costs more is halved.
    #[must_use]
    pub fn solve(&self, start: &Pose) -> Settled {
        self.solve_on(start, self.measure(start, &[]))
    }

    /// The same, from points that are measured already: at `start`, and to `within_mm` at least.
    #[must_use]
    pub fn solve_on(&self, start: &Pose, mut measured: Vec<Measured>) -> Settled {
        let arm = self
            .points
            .iter()
            .map(|q| (q - self.pivot).norm())
            .fold(1e-3, f64::max);
        let mut x = Vector6::zeros();
        let mut offset = 0.0;
        let mut motion = *start;
        if self.offset == Offset::Free {
            offset = mean(&measured);
        }
        let mut cost = self.cost(&measured, offset);
        let mut taken = 0;
        while taken < self.steps {
            taken += 1;
            let step = self.step(&x, arm, offset, &measured);
            let faces: Vec<usize> = measured.iter().map(|m| m.face).collect();
            let mut part = 1.0;
            let (next, next_offset, next_motion, there, next_cost) = loop {
                let mut next = x;
                for i in 0..6 {
                    next[i] += part * step[i] / if i < 3 { arm } else { 1.0 };
                }
                let moved = crate::rigid::stepped(start, &next, &self.pivot);
                let there = self.measure(&moved, &faces);
                let next_offset = offset + part * step[6];
                let next_cost = self.cost(&there, next_offset);
                if next_cost <= cost * (1.0 + 1e-9) || part < 1e-3 {
                    break (next, next_offset, moved, there, next_cost);
                }
                part *= 0.5;
            };
            if next_cost > cost * (1.0 + 1e-9) {
                break;
            }
            (x, offset, motion, measured, cost) =
                (next, next_offset, next_motion, there, next_cost);
            let exact = 2e-12 * (1.0 + motion.translation_mm.amax() * 1e-3);
            if step.amax() * part < exact.max(self.enough_mm / 3.0) {
                break;
            }
        }
        Settled {
            motion,
            offset_mm: offset,
            cost,
            measured,
            steps: taken,
        }
    }

    fn measure(&self, motion: &Pose, faces: &[usize]) -> Vec<Measured> {
        measure_within(
            self.surface,
            self.points,
            motion,
            faces,
            self.within_mm,
            self.threads,
        )
    }

    /// The sum of costs of these distances.
    fn cost(&self, measured: &[Measured], offset: f64) -> f64 {
        let part = |range: std::ops::Range<usize>| -> f64 {
            range
                .map(|i| self.weight(i) * self.kernel.cost(measured[i].distance_mm - offset))
                .sum()
        };
        self.threads
            .chunks(measured.len(), CHUNK * 16, part)
            .into_iter()
            .sum()
    }

    fn weight(&self, i: usize) -> f64 {
        self.weights.get(i).copied().unwrap_or(1.0)
    }

    /// The step from `x`: turns times `arm` and shifts in mm, then the offset.
    fn step(
        &self,
        x: &Vector6<f64>,
        arm: f64,
        offset: f64,
        measured: &[Measured],
    ) -> SVector<f64, 7> {
        let w = Vec3::new(x[0], x[1], x[2]);
        let turned = left_jacobian(&w);
        let pivot = self.pivot + Vec3::new(x[3], x[4], x[5]);
        let part = |range: std::ops::Range<usize>| {
            let mut matrix = SMatrix::<f64, 7, 7>::zeros();
            let mut right = SVector::<f64, 7>::zeros();
            for i in range {
                let m = &measured[i];
                let r = m.distance_mm - offset;
                let weight = self.weight(i) * self.kernel.weight(r);
                if weight == 0.0 {
                    continue;
                }
                let turn = turned.tr_mul(&(self.points[i] - pivot).cross(&m.direction)) / arm;
                let n = m.direction;
                let mut row =
                    SVector::<f64, 7>::from([-turn.x, -turn.y, -turn.z, -n.x, -n.y, -n.z, -1.0]);
                for (k, locked) in self.locked.iter().enumerate() {
                    if *locked {
                        row[k] = 0.0;
                    }
                }
                if self.offset == Offset::Zero {
                    row[6] = 0.0;
                }
                for a in 0..7 {
                    let scaled = row[a] * weight;
                    right[a] -= scaled * r;
                    for b in 0..=a {
                        matrix[(a, b)] += scaled * row[b];
                    }
                }
            }
            (matrix, right)
        };
        let mut matrix = SMatrix::<f64, 7, 7>::zeros();
        let mut right = SVector::<f64, 7>::zeros();
        for (m, r) in self.threads.chunks(measured.len(), CHUNK, part) {
            matrix += m;
            right += r;
        }
        for a in 0..7 {
            for b in a + 1..7 {
                matrix[(a, b)] = matrix[(b, a)];
            }
        }
        pseudo_solve(&matrix, &right, 1e-13)
    }
}

/// The mean distance in mm.
fn mean(measured: &[Measured]) -> f64 {
    measured.iter().map(|m| m.distance_mm).sum::<f64>() / (measured.len().max(1)) as f64
}

/// J with exp(w + δ) = exp(J δ) exp(w) to first order.
pub(crate) fn left_jacobian(w: &Vec3) -> Matrix3<f64> {
    let angle = w.norm();
    let k = w.cross_matrix();
    let (a, b) = if angle < 1e-3 {
        let x2 = angle * angle;
        (0.5 - x2 / 24.0, 1.0 / 6.0 - x2 / 120.0)
    } else {
        let x2 = angle * angle;
        (
            (1.0 - angle.cos()) / x2,
            (angle - angle.sin()) / (x2 * angle),
        )
    };
    Matrix3::identity() + k * a + k * k * b
}
