//! Points with the direction of the surface around them: what a search without a first guess goes by.

use std::borrow::Cow;
use std::collections::HashSet;
use std::hash::BuildHasherDefault;

use crate::cloud::CubeHasher;
pub(in crate::localise) use crate::cloud::oriented::{NEIGHBOURS, Oriented, orient};
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::surface::Mesh;

/// `count` points spread evenly over the area of a mesh, always the same ones.
pub(in crate::localise) fn sample(mesh: &Mesh, count: usize) -> Vec<Oriented> {
    let triangles = mesh.triangles();
    let step = mesh.area_mm2() / count as f64;
    let mut points = Vec::with_capacity(count);
    let (mut passed, mut next) = (0.0, step / 2.0);
    for t in triangles {
        passed += t.area_mm2;
        while next < passed && points.len() < count {
            // Roberts' sequence in the plane, folded into the triangle.
            let i = points.len() as f64 + 1.0;
            let (mut u, mut v) = (
                (i * 0.754_877_666_246_69).fract(),
                (i * 0.569_840_290_998_05).fract(),
            );
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = t.corners;
            points.push(Oriented {
                at: a + (b - a) * u + (c - a) * v,
                normal: t.normal,
            });
            next += step;
        }
    }
    points
}

/// The points from another one on: with another seed, other points stand for their cubes and vote first.
pub(in crate::localise) fn from_seed(points: &[Vec3], seed: u64) -> Cow<'_, [Vec3]> {
    let first = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) % (points.len().max(1) as u64);
    if first == 0 {
        return Cow::Borrowed(points);
    }
    let (before, from) = points.split_at(first as usize);
    Cow::Owned([from, before].concat())
}

/// One point of each cube of `cell` mm: the first one in the order of the list.
pub(in crate::localise) fn thin(points: &[Vec3], cell: f64, threads: Threads) -> Vec<Vec3> {
    let Some(first) = points.first() else {
        return Vec::new();
    };
    // The first ones of each part of the list, then the first ones of those.
    let parts = threads.chunks(points.len(), PART, |range| {
        first_of_each(&points[range], first, cell)
    });
    match parts.len() {
        1 => parts.concat(),
        _ => first_of_each(&parts.concat(), first, cell),
    }
}

/// Points that one thread thins at a time.
const PART: usize = 1 << 18;

fn first_of_each(points: &[Vec3], origin: &Vec3, cell: f64) -> Vec<Vec3> {
    let mut taken: HashSet<[i64; 3], BuildHasherDefault<CubeHasher>> = HashSet::default();
    points
        .iter()
        .filter(|p| {
            let key = ((*p - origin) / cell).map(f64::floor);
            taken.insert([key.x as i64, key.y as i64, key.z as i64])
        })
        .copied()
        .collect()
}
