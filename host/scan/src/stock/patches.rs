//! Which patches of the model a scan does not show.

use std::collections::HashMap;

use super::shows::{PointOver, showing};
use super::windows::Sampled;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::Measured;
use crate::surface::{Mesh, Triangle};

/// A patch that owns less than this share of what its area would give is not scanned.
const OWNED: f64 = 0.1;
/// And one that owns less than a point to a square of this share of the model's size: between them nobody saw it.
pub(super) const SQUARE: f64 = 0.1;
/// Patches below this share of the area are not judged.
const LEAST: f64 = 0.01;
/// By so many times what chance leaves a face has fewer; and a window, of which many are asked, and which finds what has next
/// to none: a side that is scanned thinly is scanned.
const SURELY: f64 = 3.0;
const SURELY_OF_MANY: f64 = 10.0;
/// The normals of a face, in degrees from each other.
const SAME: f64 = 20.0;

/// A foot lies on an edge within this share of the model's size, and beside no face if its direction is the face's normal
/// but for this much (of the cosine).
const ON_EDGE: f64 = 1e-6;
const UPRIGHT: f64 = 1e-9;

/// The share of the area in patches that are not scanned, and the middle of each with its share.
///
/// A face is connected, and its normals lie within 20 degrees of that of its largest triangle. It is a patch as a whole, and
/// so is each part of it of 1 % of the area, or as much more as gives a hundred points. The points over it show it,
/// not those beyond its edges: a table about the part lies there.
pub(super) fn bare(
    model: &Mesh,
    motion: &Pose,
    points: &[Vec3],
    measured: &[Measured],
    threads: Threads,
) -> (f64, Vec<(Vec3, f64)>) {
    let triangles = model.triangles();
    let edges = by_edge(triangles);
    let patch_of = patches(triangles, &edges);
    let borders = borders(triangles, &edges, &patch_of);
    let near = ON_EDGE * model.diagonal_mm();
    let foot_over = |q: &Vec3, m: &Measured| {
        let t = &triangles[m.face];
        let direction = motion.rotation.tr_mul(&m.direction);
        let foot = motion.undo(q) - direction * m.distance_mm;
        let is_over = direction.dot(&t.normal).abs() > 1.0 - UPRIGHT
            || (0..3).all(|k| {
                let (a, b) = (t.corners[k], t.corners[(k + 1) % 3]);
                !borders[m.face][k] || to_edge(&foot, &a, &b) > near
            });
        is_over.then_some(PointOver {
            at: motion.undo(q),
            foot,
            face: m.face,
            normal: t.normal,
        })
    };
    let over: Vec<PointOver> = points
        .iter()
        .zip(measured)
        .filter_map(|(q, m)| foot_over(q, m))
        .collect();
    let over = showing(&over, threads);
    let count = patch_of.iter().max().map_or(0, |last| last + 1);
    let (mut area, mut own) = (vec![0.0; count], vec![0_usize; count]);
    for (t, &patch) in triangles.iter().zip(&patch_of) {
        area[patch] += t.area_mm2;
    }
    for point in &over {
        own[patch_of[point.face]] += 1;
    }
    let all = model.area_mm2();
    // Whether so many points are fewer than a patch of this share owes, by so many times what chance leaves.
    let due = OWNED * over.len() as f64;
    let lacks = |own: usize, share: f64, surely: f64| {
        let own = own as f64;
        own + surely * own.sqrt() < due * share
    };
    let square = (SQUARE * model.diagonal_mm()).powi(2);
    let is_bare: Vec<bool> = (0..count)
        .map(|p| {
            let few = (own[p] as f64) < area[p] / square;
            area[p] >= LEAST * all && (few || lacks(own[p], area[p] / all, SURELY))
        })
        .collect();
    let sampled = Sampled::new(triangles, SAME.to_radians().cos(), threads);
    let feet: Vec<(Vec3, Vec3)> = over
        .iter()
        .map(|point| (point.foot, point.normal))
        .collect();
    let counts = sampled.counts(&feet, threads);
    let is_window_bare = |own, share| lacks(own, share, SURELY_OF_MANY);
    let mut marked = sampled.bare(&counts, is_window_bare, threads);
    for (marked, t) in marked.iter_mut().zip(sampled.triangles()) {
        *marked |= is_bare[patch_of[t]];
    }
    let mut bare = sampled.bodies(&marked);
    bare.sort_by(|a, b| b.1.total_cmp(&a.1));
    // A sum of nothing is −0: it is printed as 0.
    let share = bare.iter().map(|(_, share)| share).sum::<f64>() + 0.0;
    (share, bare)
}

/// The number of the patch of each triangle.
fn patches(triangles: &[Triangle], edges: &HashMap<Edge, Vec<usize>>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by(|&a, &b| {
        triangles[b]
            .area_mm2
            .total_cmp(&triangles[a].area_mm2)
            .then(a.cmp(&b))
    });
    let least = SAME.to_radians().cos();
    let mut patch_of = vec![usize::MAX; triangles.len()];
    let mut patch = 0;
    for seed in order {
        if patch_of[seed] != usize::MAX {
            continue;
        }
        let mut front = vec![seed];
        patch_of[seed] = patch;
        while let Some(at) = front.pop() {
            for edge in edges_of(&triangles[at]) {
                for &next in edges.get(&edge).map_or(&[][..], Vec::as_slice) {
                    if patch_of[next] == usize::MAX
                        && triangles[next].normal.dot(&triangles[seed].normal) >= least
                    {
                        patch_of[next] = patch;
                        front.push(next);
                    }
                }
            }
        }
        patch += 1;
    }
    patch_of
}

/// Which edges of each triangle a patch ends at.
fn borders(
    triangles: &[Triangle],
    edges: &HashMap<Edge, Vec<usize>>,
    patch_of: &[usize],
) -> Vec<[bool; 3]> {
    let ends = |i: usize, edge: &Edge| {
        let beside = edges.get(edge).map_or(&[][..], Vec::as_slice);
        !beside
            .iter()
            .any(|&other| other != i && patch_of[other] == patch_of[i])
    };
    let all = triangles.iter().enumerate();
    all.map(|(i, t)| edges_of(t).map(|edge| ends(i, &edge)))
        .collect()
}

/// How far a place is from an edge.
fn to_edge(p: &Vec3, a: &Vec3, b: &Vec3) -> f64 {
    let along = b - a;
    let squared = along.norm_squared();
    let t = if squared > 0.0 {
        ((p - a).dot(&along) / squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + along * t - p).norm()
}

type Edge = ([u64; 3], [u64; 3]);

fn edges_of(t: &Triangle) -> [Edge; 3] {
    // Zero has two signs.
    let key = |v: &Vec3| [v.x, v.y, v.z].map(|x| (x + 0.0).to_bits());
    std::array::from_fn(|i| {
        let (a, b) = (key(&t.corners[i]), key(&t.corners[(i + 1) % 3]));
        if a < b { (a, b) } else { (b, a) }
    })
}

fn by_edge(triangles: &[Triangle]) -> HashMap<Edge, Vec<usize>> {
    let mut edges: HashMap<Edge, Vec<usize>> = HashMap::new();
    for (i, t) in triangles.iter().enumerate() {
        for edge in edges_of(t) {
            edges.entry(edge).or_default().push(i);
        }
    }
    edges
}
