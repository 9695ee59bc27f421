//! A search without a first guess: pairs of oriented points vote for poses (Drost et al., Model Globally, Match Locally,
//! CVPR 2010), and the distance field judges what they propose.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use nalgebra::Matrix3;

use crate::localise::search::oriented::{Oriented, sample};
use crate::localise::search::rough::{Points, Rough};
use crate::localise::search::walls::shifts;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::surface::Mesh;

/// Points of the model that pairs are made of.
const SAMPLES: usize = 450;
/// Steps of the length of a pair, over the model's diagonal.
const LENGTHS: f64 = 22.0;
/// A step of an angle.
const ANGLE: f64 = PI / 15.0;
/// Steps of the turn about the normal.
const TURNS: usize = 30;
/// Partners that each voter asks.
const PARTNERS: usize = 350;
/// Proposals of a voter for each sign of its normal.
const PROPOSALS: usize = 14;

/// A model prepared for searches.
pub(in crate::localise) struct Prepared {
    pub samples: Vec<Oriented>,
    pub rough: Rough,
    pub diagonal: f64,
    pub corners: [Vec3; 8],
    /// Of each triangle the flat side that it is of: triangles in one plane are of one.
    pub sides: Vec<u32>,
    /// By how much a fit may lie beside its place where walls and steps are thin, in the model's frame.
    pub shifts: Vec<Vec3>,
    /// Whether there is an inside in which no point can be.
    pub closed: bool,
    /// Where the pairs of each feature begin, and the pairs.
    first: Vec<u32>,
    pairs: Vec<Pair>,
}

/// How much a search takes.
pub(in crate::localise) struct Effort {
    /// Points that vote at most.
    voters: usize,
    /// How many times what is wanted is moved onto the surface.
    moved: usize,
}

/// In a scan most points may be of other things.
pub(in crate::localise) const IN_A_SCAN: Effort = Effort {
    voters: 160,
    moved: 12,
};
/// The model in itself: no noise, and nothing else.
pub(in crate::localise) const IN_ITSELF: Effort = Effort {
    voters: 80,
    moved: 4,
};

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

/// A pair of the model's samples: the first of them, and the turn of the second about its normal.
#[derive(Clone, Copy, Debug, Default)]
struct Pair {
    sample: u16,
    turn: u16,
}

/// Features that there can be: steps of the length, and of the angles.
const FEATURES: usize = (LENGTHS as usize + 1) * 16 * 8 * 16;

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
    // `along` is not negative: half as many steps.
    Some(((l * 16 + step(c1)) * 8 + step(along)) * 16 + step(c12))
}

/// A whole turn.
const WHOLE: f64 = 65536.0;

/// The turn of `d` about the normal of a frame, in parts of a whole one.
fn turn(frame: &Matrix3<f64>, d: &Vec3) -> u16 {
    let d = frame.tr_mul(d);
    ((d.y.atan2(d.x) / TAU).rem_euclid(1.0) * WHOLE) as u32 as u16
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

/// The pairs by feature, and where those of each begin.
fn by_feature(all: &[(u32, Pair)]) -> (Vec<u32>, Vec<Pair>) {
    let mut first = vec![0_u32; FEATURES + 1];
    for (key, _) in all {
        first[*key as usize + 1] += 1;
    }
    for key in 0..FEATURES {
        first[key + 1] += first[key];
    }
    let mut next = first.clone();
    let mut pairs = vec![Pair::default(); all.len()];
    for (key, pair) in all {
        let place = &mut next[*key as usize];
        pairs[*place as usize] = *pair;
        *place += 1;
    }
    (first, pairs)
}

impl Prepared {
    pub fn new(mesh: &Mesh, threads: Threads) -> Self {
        let samples = sample(mesh, SAMPLES);
        let (low, high) = mesh.bounds();
        let diagonal = (high - low).norm();
        let mut all: Vec<(u32, Pair)> = Vec::new();
        for (i, a) in samples.iter().enumerate() {
            let frame = frame(&a.normal);
            for (j, b) in samples.iter().enumerate() {
                if i == j {
                    continue;
                }
                let keys = [false, true]
                    .map(|flip| feature((&a.at, &a.normal), (&b.at, &b.normal), diagonal, flip));
                if keys == [None, None] {
                    continue;
                }
                let pair = Pair {
                    sample: i as u16,
                    turn: turn(&frame, &(b.at - a.at)),
                };
                all.extend(keys.into_iter().flatten().map(|key| (key, pair)));
            }
        }
        let (first, pairs) = by_feature(&all);
        let planes: Vec<(Vec3, f64)> = mesh
            .triangles()
            .iter()
            .map(|t| (t.normal, t.normal.dot(&t.corners[0])))
            .collect();
        let sides = sides(&planes, diagonal);
        Self {
            corners: mesh.corners(),
            shifts: shifts(mesh, &sides, diagonal),
            sides,
            rough: Rough::new(mesh, &planes, threads),
            samples,
            diagonal,
            closed: mesh.is_closed(),
            first,
            pairs,
        }
    }

    /// The best proposals for a scene, distinct, best first.
    pub fn search(
        &self,
        scene: &[Oriented],
        count: usize,
        effort: &Effort,
        threads: Threads,
    ) -> Vec<Proposal> {
        let with_normal: Vec<Oriented> =
            scene.iter().filter(|o| o.is_oriented()).copied().collect();
        let voters = spread(with_normal.len(), effort.voters);
        let some = |most: usize| {
            let chosen = spread(scene.len(), most);
            Points::new(chosen.into_iter().map(|i| &scene[i]))
        };
        let (few, more, many) = (some(400), some(1200), some(2000));
        let mut all: Vec<Proposal> = threads
            .each(voters.len(), |k| {
                let mut all = Vec::new();
                for sign in [1.0, -1.0] {
                    all.extend(self.vote(&with_normal, voters[k], sign));
                }
                for proposal in &mut all {
                    proposal.score = self.rough.score(&few, &proposal.motion);
                }
                all
            })
            .concat();
        sort(&mut all);
        let mut best = self.distinct(&all, count * effort.moved, 0.06);
        let moved = threads.each(best.len(), |i| {
            let voted = &best[i];
            let moved = self.rough.moved_near([&few, &more], &voted.motion);
            let motion = if self.rough.score(&few, &moved) > voted.score {
                moved
            } else {
                voted.motion
            };
            let score = self.rough.score(&many, &motion);
            Proposal { motion, score }
        });
        best = moved;
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
            let [from, to] = [key, key + 1].map(|key| self.first[key as usize] as usize);
            if from == to {
                continue;
            }
            let here = turn(&frame_here, &(partner.at - at));
            for pair in &self.pairs[from..to] {
                let turned = u32::from(here.wrapping_sub(pair.turn));
                let bin = (turned * TURNS as u32) >> 16;
                let cell = &mut votes[usize::from(pair.sample) * TURNS + bin as usize];
                *cell = cell.saturating_add(1);
            }
        }
        let mut order: Vec<u32> = (0..votes.len() as u32)
            .filter(|&k| votes[k as usize] > 2)
            .collect();
        let rank = |k: &u32| (std::cmp::Reverse(votes[*k as usize]), *k);
        if order.len() > PROPOSALS {
            order.select_nth_unstable_by_key(PROPOSALS, rank);
            order.truncate(PROPOSALS);
        }
        order.sort_unstable_by_key(rank);
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
