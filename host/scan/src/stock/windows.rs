//! Parts of faces that a scan does not show: an even sampling of the surface, and windows over it.
//!
//! A face can be as large as half of the part, so it is not asked as a whole alone. Around every sample the nearest samples
//! of the same face make a window, whichever way its triangles are cut, and each point counts for the sample that its foot
//! is nearest to.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::cloud::tree::PointTree;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::surface::Triangle;

/// Samples of the surface, each of the same area.
const SAMPLES: usize = 6400;
/// The least window, in samples: just above 1 % of the area.
const LEAST: usize = SAMPLES / 100 + 1;
/// Points that the area of a window gives at least where all are even: of fewer, chance leaves none in a scanned one.
const GIVEN: usize = 100;
/// Windows are asked about every sample, or about so many in each.
const ASKED: usize = 64;
/// Samples are beside each other within so many times the side of the square that each has.
const BESIDE: f64 = 2.5;
/// The facets of a round may turn so far from one to the next (cosines): six make a bore. Where a countersink meets its face
/// it turns by 45 degrees or by 30, so it is asked with less, too.
const ROUNDS: [f64; 3] = [0.47, 0.77, 0.91];
/// Neighbours that a sample is asked for, and that a foot is: the other side of a thin wall is among them.
const NEIGHBOURS: usize = 24;
const OTHERS: usize = 4;

/// A place on the surface that stands for the area around it.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Vec3,
    normal: Vec3,
    triangle: usize,
}

/// The samples of a surface, and which of them are beside each other on one face, or on one round of facets.
pub(super) struct Sampled {
    samples: Vec<Sample>,
    beside: Vec<Vec<u32>>,
    /// By each of the turns of [`ROUNDS`].
    around: [Vec<Vec<u32>>; ROUNDS.len()],
    tree: PointTree,
    /// The least cosine between the normals of one face.
    least: f64,
}

impl Sampled {
    /// Samples these triangles; the normals of a face have this cosine at least.
    pub fn new(triangles: &[Triangle], least: f64, threads: Threads) -> Self {
        let all: f64 = triangles.iter().map(|t| t.area_mm2).sum();
        let samples = spread(triangles, all);
        let at: Vec<Vec3> = samples.iter().map(|s| s.at).collect();
        let tree = PointTree::new(&at);
        let reach = BESIDE * (all / SAMPLES as f64).sqrt();
        let near = |i: usize| {
            let mut found = Vec::new();
            tree.within(&samples[i].at, reach, NEIGHBOURS, &mut found);
            found.into_iter().map(|(_, k)| k)
        };
        // With normals that have this cosine, and neither far above the other.
        let is_beside = |i: usize, k: u32, least: f64| {
            let (here, other) = (samples[i], samples[k as usize]);
            let way = other.at - here.at;
            let steep = (1.0 - least * least).sqrt() * way.norm();
            let up = |normal: &Vec3| way.dot(normal).abs() <= steep;
            k as usize != i
                && here.normal.dot(&other.normal) >= least
                && up(&here.normal)
                && up(&other.normal)
        };
        let by = |least: f64| {
            threads.each(samples.len(), |i| {
                near(i).filter(|k| is_beside(i, *k, least)).collect()
            })
        };
        let (beside, around) = (by(least), ROUNDS.map(|turn| by(turn.min(least))));
        Self {
            samples,
            beside,
            around,
            tree,
            least,
        }
    }

    /// The triangle that each sample lies on.
    pub fn triangles(&self) -> impl Iterator<Item = usize> {
        self.samples.iter().map(|s| s.triangle)
    }

    /// How many of these feet, each with the normal of its triangle, are nearest to each sample.
    pub fn counts(&self, feet: &[(Vec3, Vec3)], threads: Threads) -> Vec<usize> {
        let nearest = |(foot, normal): &(Vec3, Vec3)| {
            let mut found = Vec::new();
            let is_own = |k: &usize| self.samples[*k].normal.dot(normal) >= self.least;
            [OTHERS, NEIGHBOURS].into_iter().find_map(|count| {
                self.tree.nearest(foot, count, &mut found);
                found.iter().map(|(_, k)| *k as usize).find(is_own)
            })
        };
        let mut counts = vec![0; self.samples.len()];
        let each = threads.each(feet.len(), |i| nearest(&feet[i]));
        for k in each.into_iter().flatten() {
            counts[k] += 1;
        }
        counts
    }

    /// The samples that lie in windows of which `is_bare` says so, by their points and their share of the area.
    pub fn bare(
        &self,
        counts: &[usize],
        is_bare: impl Fn(usize, f64) -> bool + Sync,
        threads: Threads,
    ) -> Vec<bool> {
        let shown: usize = counts.iter().sum();
        let size = (GIVEN * SAMPLES).div_ceil(shown.max(1)).max(LEAST);
        let every = (size / ASKED).max(1);
        let asked = self.samples.len().div_ceil(every);
        let is_bare = |window: &Vec<u32>| {
            let own: usize = window.iter().map(|&i| counts[i as usize]).sum();
            let share = window.len() as f64 / self.samples.len() as f64;
            window.len() >= LEAST && is_bare(own, share)
        };
        let found = threads.each(asked, |k| {
            let one_way = self.window(k * every, size, None);
            // What looks one way of a bore is little: the whole of it is asked as well.
            let is_little = one_way.len() < size;
            let rounds = self.around.iter().filter(|_| is_little);
            let rounds = rounds.map(|around| self.window(k * every, size, Some(around)));
            let all = rounds.chain([one_way]).filter(is_bare);
            all.flatten().collect::<Vec<u32>>()
        });
        let mut bare = vec![false; self.samples.len()];
        for i in found.into_iter().flatten() {
            bare[i as usize] = true;
        }
        bare
    }

    /// The `size` samples nearest to one, of its own face and direction or, if so told, of the whole round of facets that
    /// are beside each other; all that there are where they are fewer.
    fn window(&self, centre: usize, size: usize, round: Option<&Vec<Vec<u32>>>) -> Vec<u32> {
        let here = self.samples[centre];
        let mut known = vec![false; self.samples.len()];
        let mut front = BinaryHeap::from([Reverse((0_u64, centre as u32))]);
        known[centre] = true;
        let mut window = Vec::new();
        while let Some(Reverse((_, at))) = front.pop() {
            window.push(at);
            if window.len() == size {
                break;
            }
            for &next in &round.unwrap_or(&self.beside)[at as usize] {
                let other = self.samples[next as usize];
                let is_asked = round.is_some() || other.normal.dot(&here.normal) >= self.least;
                if !known[next as usize] && is_asked {
                    known[next as usize] = true;
                    // What is not negative is in the order of its bits.
                    let far = (other.at - here.at).norm_squared().to_bits();
                    front.push(Reverse((far, next)));
                }
            }
        }
        window
    }

    /// What hangs together of the samples that are marked: the middle of each, and its share of the area.
    pub fn bodies(&self, marked: &[bool]) -> Vec<(Vec3, f64)> {
        let mut left = marked.to_vec();
        let mut all = Vec::new();
        for seed in 0..left.len() {
            if !std::mem::take(&mut left[seed]) {
                continue;
            }
            let (mut front, mut sum, mut count) = (vec![seed], Vec3::zeros(), 0.0);
            while let Some(at) = front.pop() {
                sum += self.samples[at].at;
                count += 1.0;
                let beside = self.beside[at].iter().map(|&k| k as usize);
                front.extend(beside.filter(|&k| std::mem::take(&mut left[k])));
            }
            all.push((sum / count, count / self.samples.len() as f64));
        }
        all
    }
}

/// Samples of equal area in the order of the triangles, evenly within each (Roberts' sequence of two dimensions).
fn spread(triangles: &[Triangle], all: f64) -> Vec<Sample> {
    const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
    let mut samples = Vec::with_capacity(SAMPLES);
    let mut before = 0.0;
    for (triangle, t) in triangles.iter().enumerate() {
        before += t.area_mm2;
        while samples.len() < SAMPLES
            && (samples.len() as f64 + 0.5) * all < before * SAMPLES as f64
        {
            let [mut u, mut v] = STEPS.map(|step| (step * (samples.len() + 1) as f64).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = t.corners;
            samples.push(Sample {
                at: a + (b - a) * u + (c - a) * v,
                normal: t.normal,
                triangle,
            });
        }
    }
    samples
}
