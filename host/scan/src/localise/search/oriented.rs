//! Points with the direction of the surface around them: what a search without a first guess goes by.

use std::borrow::Cow;
use std::collections::HashSet;
use std::hash::BuildHasherDefault;

use nalgebra::Matrix3;

use crate::cloud::CubeHasher;
use crate::cloud::tree::PointTree;
use crate::parallel::Threads;
use crate::rigid::Vec3;
use crate::solve::eigen;
use crate::surface::Mesh;

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub(in crate::localise) struct Oriented {
    /// Where it is, in mm.
    pub at: Vec3,
    /// The normal, of either sign in a scan; zero where the neighbourhood has none.
    pub normal: Vec3,
}

impl Oriented {
    /// Whether the neighbourhood has a direction.
    pub fn is_oriented(&self) -> bool {
        self.normal != Vec3::zeros()
    }
}

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

/// Neighbours that a normal is taken from, where a surface has many.
pub(in crate::localise) const NEIGHBOURS: usize = 24;
/// Neighbours that a normal needs.
const LEAST: usize = 7;

/// The points of `places` with normals by their neighbours among `points` within `radius` mm, and the noise along the
/// normals (mm, the median over the points; 0 if there are none). A normal is taken from the nearest `most` of them.
pub(in crate::localise) fn orient(
    places: &[Vec3],
    points: &[Vec3],
    radius: f64,
    most: usize,
    threads: Threads,
) -> (Vec<Oriented>, f64) {
    let tree = PointTree::new(points);
    let all = threads.each(places.len(), |i| {
        let mut found = Vec::new();
        tree.within(&places[i], radius, most, &mut found);
        let none = (
            Oriented {
                at: places[i],
                normal: Vec3::zeros(),
            },
            f64::NAN,
        );
        if found.len() < LEAST {
            return none;
        }
        let n = found.len() as f64;
        let middle = found.iter().map(|f| points[f.1 as usize]).sum::<Vec3>() / n;
        let mut spread = Matrix3::zeros();
        for f in &found {
            let off = points[f.1 as usize] - middle;
            spread += off * off.transpose();
        }
        let (values, vectors) = eigen(&spread);
        // Flat enough to have a direction, and no line.
        if values[0] > 0.12 * values[1] || values[1] < 0.02 * values[2] {
            return none;
        }
        let noise = (values[0].max(0.0) / (n - 3.0)).sqrt();
        (
            Oriented {
                at: places[i],
                normal: vectors.column(0).into_owned(),
            },
            noise,
        )
    });
    let mut noises: Vec<f64> = all.iter().map(|a| a.1).filter(|x| x.is_finite()).collect();
    let noise = crate::stock::median(&mut noises);
    (all.into_iter().map(|a| a.0).collect(), noise)
}
