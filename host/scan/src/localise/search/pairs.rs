//! A search without a first guess: pairs of oriented points vote for poses (Drost et al., Model Globally, Match Locally,
//! CVPR 2010), and the distance field judges what they propose.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Matrix6, Vector6};

use crate::localise::search::field::HeightField;
use crate::localise::search::oriented::{Oriented, sample};
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::pseudo_solve;
use crate::surface::Mesh;

/// Points of the model that pairs are made of.
const SAMPLES: usize = 450;
/// Steps of the length of a pair, over the model's diagonal.
const LENGTHS: f64 = 22.0;
/// A step of an angle.
const ANGLE: f64 = PI / 15.0;
/// Steps of the turn about the normal.
const TURNS: usize = 30;
/// Points of the scan that vote at most, and partners that each asks.
const VOTERS: usize = 160;
const PARTNERS: usize = 350;
/// Proposals of a voter for each sign of its normal.
const PROPOSALS: usize = 14;

/// A model prepared for searches.
pub(in crate::localise) struct Prepared {
    pub samples: Vec<Oriented>,
    pub field: HeightField,
    pub diagonal: f64,
    pub corners: [Vec3; 8],
    /// Of each triangle its normal, and how far from the origin its plane is along it, in mm.
    planes: Vec<(Vec3, f64)>,
    /// Of each triangle the flat side that it is of: triangles in one plane are of one.
    pub sides: Vec<u32>,
    /// Whether there is an inside in which no point can be.
    pub closed: bool,
    pairs: HashMap<u32, Vec<(u16, f32)>>,
}

/// A pose with what speaks for it.
#[derive(Clone, Copy, Debug)]
pub(in crate::localise) struct Proposal {
    pub motion: Pose,
    pub score: f64,
}

/// Two directions that are square to `n` and to each other.
pub(in crate::localise) fn frame(n: &Vec3) -> Matrix3<f64> {
    let least = n.iamin();
    let mut other = Vec3::zeros();
    other[least] = 1.0;
    let a = n.cross(&other).normalize();
    Matrix3::from_columns(&[a, n.cross(&a), *n])
}

/// What a pair is, whatever its place: its length and three angles, with the second normal towards its partner's far
/// side. None for pairs in one plane: they fit everywhere.
fn feature(
    first: (&Vec3, &Vec3),
    second: (&Vec3, &Vec3),
    diagonal: f64,
    flip: bool,
) -> Option<u32> {
    let d = second.0 - first.0;
    let length = d.norm();
    if length < diagonal * 0.06 || length > diagonal {
        return None;
    }
    let d = d / length;
    let mut n2 = *second.1;
    let mut along = n2.dot(&d);
    if along < 0.0 {
        (n2, along) = (-n2, -along);
    }
    if flip {
        // As near to square as that, its sign means nothing.
        if along > 0.15 {
            return None;
        }
        (n2, along) = (-n2, 0.0);
    }
    let (c1, c12) = (first.1.dot(&d), first.1.dot(&n2));
    if c1.abs() < 0.15 && along < 0.15 && c12.abs() > 0.93 {
        return None;
    }
    let step = |cosine: f64| (cosine.clamp(-1.0, 1.0).acos() / ANGLE) as u32;
    let l = (length / diagonal * LENGTHS) as u32;
    Some(((l * 16 + step(c1)) * 16 + step(along)) * 16 + step(c12))
}

/// The turn of `d` about the normal of a frame.
fn turn(frame: &Matrix3<f64>, d: &Vec3) -> f64 {
    let d = frame.tr_mul(d);
    d.y.atan2(d.x)
}

/// The number of the flat side that each of these planes is of.
fn sides(planes: &[(Vec3, f64)], diagonal: f64) -> Vec<u32> {
    let mut known: HashMap<[i64; 4], u32> = HashMap::new();
    planes
        .iter()
        .map(|(n, height)| {
            let step = |x: f64| (x * 100.0).round() as i64;
            let key = [
                step(n.x),
                step(n.y),
                step(n.z),
                (height / (1e-3 * diagonal)).round() as i64,
            ];
            let next = known.len() as u32;
            *known.entry(key).or_insert(next)
        })
        .collect()
}

impl Prepared {
    pub fn new(mesh: &Mesh, threads: Threads) -> Self {
        let samples = sample(mesh, SAMPLES);
        let (low, high) = mesh.bounds();
        let diagonal = (high - low).norm();
        let mut pairs: HashMap<u32, Vec<(u16, f32)>> = HashMap::new();
        for (i, a) in samples.iter().enumerate() {
            let frame = frame(&a.normal);
            for (j, b) in samples.iter().enumerate() {
                if i == j {
                    continue;
                }
                for flip in [false, true] {
                    if let Some(key) =
                        feature((&a.at, &a.normal), (&b.at, &b.normal), diagonal, flip)
                    {
                        let angle = turn(&frame, &(b.at - a.at));
                        pairs.entry(key).or_default().push((i as u16, angle as f32));
                    }
                }
            }
        }
        let planes: Vec<(Vec3, f64)> = mesh
            .triangles()
            .iter()
            .map(|t| (t.normal, t.normal.dot(&t.corners[0])))
            .collect();
        Self {
            field: HeightField::new(mesh, threads),
            corners: mesh.corners(),
            sides: sides(&planes, diagonal),
            planes,
            samples,
            diagonal,
            closed: mesh.is_closed(),
            pairs,
        }
    }

    /// How near a point counts as on the surface before anything is refined, in mm.
    pub fn coarse_mm(&self) -> f64 {
        self.diagonal / 45.0
    }

    /// What speaks for a pose: points on the surface that look its way, less those within the material.
    pub fn score(&self, scene: &[Oriented], motion: &Pose) -> f64 {
        let coarse = self.coarse_mm();
        let mut score = 0.0;
        for q in scene {
            let Some((distance, face)) = self.field.at(&motion.undo(&q.at)) else {
                continue;
            };
            if distance.abs() < coarse {
                let looks = motion
                    .rotation
                    .tr_mul(&q.normal)
                    .dot(&self.planes[face].0)
                    .abs();
                if looks > 0.8 || q.normal == Vec3::zeros() {
                    score += 1.0 - distance.abs() / coarse;
                }
            } else if self.closed && distance < -1.5 * coarse {
                score -= 1.0;
            }
        }
        score
    }

    /// A pose moved to where the points near its surface fit its planes: a few rough steps, with the field alone. What
    /// votes propose is off by half a step of each angle.
    fn moved_near(&self, scene: &[Oriented], motion: &Pose) -> Pose {
        let about = self.corners.iter().sum::<Vec3>() / 8.0;
        let arm = self.diagonal / 2.0;
        let mut motion = *motion;
        for reach in [4.0, 3.5, 3.0, 2.0, 1.5, 1.0] {
            let reach = reach * self.coarse_mm();
            let mut h = Matrix6::zeros();
            let mut g = Vector6::zeros();
            for q in scene {
                let p = motion.undo(&q.at);
                let Some((_, face)) = self.field.at(&p).filter(|(d, _)| d.abs() < reach) else {
                    continue;
                };
                let (normal, height) = self.planes[face];
                let off = normal.dot(&p) - height;
                let looks = motion.rotation.tr_mul(&q.normal).dot(&normal).abs();
                if off.abs() >= reach || (q.is_oriented() && looks < 0.7) {
                    continue;
                }
                let weight = (1.0 - (off / reach).powi(2)).powi(2);
                let turn = (p - about).cross(&normal) / arm;
                let row = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
                h += row * row.transpose() * weight;
                g -= row * (weight * off);
            }
            let x = pseudo_solve(&h, &g, 1e-3);
            let x = Vector6::new(x[0] / arm, x[1] / arm, x[2] / arm, x[3], x[4], x[5]);
            motion = motion.after(&stepped(&Pose::identity(), &x, &about).inverse());
        }
        motion
    }

    /// The best proposals for a scene, distinct, best first.
    pub fn search(&self, scene: &[Oriented], count: usize, threads: Threads) -> Vec<Proposal> {
        let with_normal: Vec<Oriented> = scene
            .iter()
            .filter(|o| o.normal != Vec3::zeros())
            .copied()
            .collect();
        let voters = spread(with_normal.len(), VOTERS);
        let some = |most: usize| -> Vec<Oriented> {
            let chosen = spread(scene.len(), most);
            chosen.into_iter().map(|i| scene[i]).collect()
        };
        let (few, more, many) = (some(400), some(1200), some(2000));
        let mut all: Vec<Proposal> = threads
            .each(voters.len(), |k| {
                let mut all = Vec::new();
                for sign in [1.0, -1.0] {
                    all.extend(self.vote(&with_normal, voters[k], sign));
                }
                for proposal in &mut all {
                    proposal.score = self.score(&few, &proposal.motion);
                }
                all
            })
            .concat();
        sort(&mut all);
        let mut best = self.distinct(&all, count * 12, 0.06);
        let moved = threads.each(best.len(), |i| {
            let motion = self.moved_near(&more, &best[i].motion);
            [motion, best[i].motion].map(|motion| Proposal {
                motion,
                score: self.score(&many, &motion),
            })
        });
        for (proposal, [moved, voted]) in best.iter_mut().zip(moved) {
            *proposal = if moved.score > voted.score {
                moved
            } else {
                voted
            };
        }
        sort(&mut best);
        self.distinct(&best, count, 0.03)
    }

    /// The first of `sorted` that lie apart by more than `share` of the diagonal, `count` at most.
    pub fn distinct(&self, sorted: &[Proposal], count: usize, share: f64) -> Vec<Proposal> {
        let mut kept: Vec<Proposal> = Vec::new();
        for proposal in sorted {
            if kept.len() >= count {
                break;
            }
            let apart = |k: &Proposal| proposal.motion.apart_mm(&k.motion, &self.corners);
            if kept.iter().all(|k| apart(k) > share * self.diagonal) {
                kept.push(*proposal);
            }
        }
        kept
    }

    /// What the point `voter` of a scene, its normal with this sign, says of the pose.
    pub fn vote(&self, scene: &[Oriented], voter: usize, sign: f64) -> Vec<Proposal> {
        let (at, normal) = (scene[voter].at, scene[voter].normal * sign);
        let frame_here = frame(&normal);
        let mut votes = vec![0_u16; self.samples.len() * TURNS];
        let near: Vec<usize> = (0..scene.len())
            .filter(|&j| {
                j != voter && (scene[j].at - at).norm_squared() < self.diagonal * self.diagonal
            })
            .collect();
        for k in spread(near.len(), PARTNERS) {
            let partner = &scene[near[k]];
            let Some(key) = feature(
                (&at, &normal),
                (&partner.at, &partner.normal),
                self.diagonal,
                false,
            ) else {
                continue;
            };
            let Some(same) = self.pairs.get(&key) else {
                continue;
            };
            let here = turn(&frame_here, &(partner.at - at));
            for (i, angle) in same {
                let turned = (here - f64::from(*angle)).rem_euclid(TAU) / TAU;
                let bin = ((turned * TURNS as f64) as usize).min(TURNS - 1);
                let cell = &mut votes[*i as usize * TURNS + bin];
                *cell = cell.saturating_add(1);
            }
        }
        let mut order: Vec<u32> = (0..votes.len() as u32)
            .filter(|&k| votes[k as usize] > 2)
            .collect();
        order.sort_unstable_by_key(|&k| (std::cmp::Reverse(votes[k as usize]), k));
        order.truncate(PROPOSALS);
        order
            .into_iter()
            .map(|k| {
                let (i, bin) = (k as usize / TURNS, k as usize % TURNS);
                let model = &self.samples[i];
                let angle = (bin as f64 + 0.5) / TURNS as f64 * TAU;
                let about = crate::rigid::rotation(&(normal * angle));
                let rotation = about * frame_here * frame(&model.normal).transpose();
                Proposal {
                    motion: Pose {
                        rotation,
                        translation_mm: at - rotation * model.at,
                    },
                    score: 0.0,
                }
            })
            .collect()
    }
}

/// Best first; of equal ones the order stays.
pub(in crate::localise) fn sort(proposals: &mut [Proposal]) {
    proposals.sort_by(|a, b| b.score.total_cmp(&a.score));
}

/// At most `most` numbers of `0..count`, spread evenly.
pub(in crate::localise) fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|k| k * count / most).collect()
}
