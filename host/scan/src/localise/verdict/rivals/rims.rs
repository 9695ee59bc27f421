//! Where a side of the part ends, the scan must not go on. A side that lies flush on a table, or on a face of a chuck, has
//! the points of that face on it, however many: they say nothing of the part.

use std::collections::{HashMap, HashSet};

use crate::cloud::tree::PointTree;
use crate::localise::search::oriented::Oriented;
use crate::rigid::{Pose, Vec3};
use crate::surface::Mesh;

/// A place where a flat side ends at a sharp outer edge.
#[derive(Clone, Copy, Debug)]
pub(in crate::localise) struct Rim {
    /// On the side, a little before its edge.
    before: Vec3,
    /// In its plane, beyond the edge, in the air.
    beyond: Vec3,
    normal: Vec3,
    side: u32,
}

/// How far beyond an edge is looked, in cells of the search.
const BEYOND: f64 = 2.0;
/// A point of the scan within this share of that distance is there.
const THERE: f64 = 0.45;
/// The part itself must be farther from there than this share of it: the edge is sharp.
const SHARP: f64 = 0.7;
/// A side is passed if the scan goes on beyond this share of the edges that it shows, and at so many places.
const PASSED: f64 = 0.3;
const LEAST: usize = 3;

/// The rims of a closed model's sides, `cell` mm apart; `sides` by triangle.
pub(in crate::localise) fn rims(mesh: &Mesh, sides: &[u32], cell: f64) -> Vec<Rim> {
    let key = |c: &Vec3| [c.x, c.y, c.z].map(|x| (x + 0.0).to_bits());
    let mut by_edge: HashMap<_, Vec<u32>> = HashMap::new();
    let edge = |t: usize, k: usize| {
        let corners = &mesh.triangles()[t].corners;
        let [a, b] = [key(&corners[k]), key(&corners[(k + 1) % 3])];
        if a < b { (a, b) } else { (b, a) }
    };
    for (t, side) in sides.iter().enumerate() {
        for k in 0..3 {
            by_edge.entry(edge(t, k)).or_default().push(*side);
        }
    }
    let off = BEYOND * cell;
    let mut all = Vec::new();
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        for k in 0..3 {
            if by_edge[&edge(t, k)].iter().all(|side| *side == sides[t]) {
                continue;
            }
            let (a, b) = (triangle.corners[k], triangle.corners[(k + 1) % 3]);
            let Some(out) = (b - a).cross(&triangle.normal).try_normalize(1e-12) else {
                continue;
            };
            let count = ((b - a).norm() / cell) as usize;
            for i in 0..count {
                let p = a + (b - a) * ((i as f64 + 0.5) / count as f64);
                let beyond = p + out * off;
                if mesh.near_from(&beyond, t).distance_mm > SHARP * off {
                    all.push(Rim {
                        before: p - out * (0.5 * off),
                        beyond,
                        normal: triangle.normal,
                        side: sides[t],
                    });
                }
            }
        }
    }
    all
}

/// The sides beyond whose edges the scan goes on in their plane, if `motion` puts the part.
pub(in crate::localise) fn passed(
    rims: &[Rim],
    (tree, places): (&PointTree, &[Oriented]),
    motion: &Pose,
    cell: f64,
) -> HashSet<u32> {
    let radius = THERE * BEYOND * cell;
    let mut found = Vec::new();
    let mut is_there = |rim: &Rim, p: &Vec3| {
        let (q, normal) = (motion.point(p), motion.rotation * rim.normal);
        tree.within(&q, radius, 8, &mut found);
        found.iter().any(|(_, i)| {
            let near = &places[*i as usize];
            let flat = !near.is_oriented() || near.normal.dot(&normal).abs() > 0.8;
            flat && (near.at - q).dot(&normal).abs() < 0.5 * radius
        })
    };
    let mut counts: HashMap<u32, (usize, usize)> = HashMap::new();
    for rim in rims {
        if is_there(rim, &rim.before) {
            let (shown, passed) = counts.entry(rim.side).or_default();
            *shown += 1;
            *passed += usize::from(is_there(rim, &rim.beyond));
        }
    }
    counts
        .into_iter()
        .filter(|(_, (shown, passed))| *passed >= LEAST && *passed as f64 > PASSED * *shown as f64)
        .map(|(side, _)| side)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localise::search::oriented::sample;
    use crate::localise::search::pairs::Prepared;
    use crate::localise::search::scene::cell_mm;
    use crate::localise::tests::bracket;
    use crate::parallel::Threads;

    /// A flat floor at this height, its points 1.5 mm apart.
    fn floor(z: f64) -> impl Iterator<Item = Oriented> {
        (0..10_000).map(move |k| Oriented {
            at: Vec3::new(
                f64::from(k % 100) * 1.5 - 50.0,
                f64::from(k / 100) * 1.5 - 50.0,
                z,
            ),
            normal: Vec3::z(),
        })
    }

    #[test]
    fn a_side_in_the_plane_of_a_table_is_passed_and_no_other_is() {
        let model = bracket();
        let prepared = Prepared::new(&model, Threads::new(1));
        let cell = cell_mm(&model);
        let rims = rims(&model, &prepared.sides, cell);
        let shown = sample(&model, 4000);
        let passed_with = |floor_at: Option<f64>| {
            let mut places = shown.clone();
            places.extend(floor_at.into_iter().flat_map(floor));
            let at: Vec<Vec3> = places.iter().map(|o| o.at).collect();
            let tree = PointTree::new(&at);
            let scene = (&tree, &places[..]);
            passed(&rims, scene, &Pose::identity(), cell)
        };
        assert!(!rims.is_empty());
        assert!(passed_with(None).is_empty());
        let low = model.bounds().0.z;
        assert!(passed_with(Some(low - 20.0)).is_empty());
        let of = passed_with(Some(low));
        let under: HashSet<u32> = model
            .triangles()
            .iter()
            .zip(&prepared.sides)
            .filter(|(t, _)| t.normal.z < -0.9 && (t.corners[0].z - low).abs() < 1e-6)
            .map(|(_, side)| *side)
            .collect();
        assert_eq!(of, under);
    }
}
