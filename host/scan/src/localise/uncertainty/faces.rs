//! Which points are on a face, and not at an edge.
//!
//! A point at an edge is nearest to either of two faces by its own noise, and where the last points of a face lie is
//! chance, as far as they are apart: neither measures a face. So a pose that nothing else holds is free, however many
//! points there are at the edges.

use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::Measured;
use crate::surface::CompositeSurface;

/// Another face is as near as this to a point at an edge, in units of the noise.
const EDGE: f64 = 5.0;
/// What lies so much less deep, or less high, than a point of a face is another face: facets of a round do not.
const OTHER: f64 = 0.9;

/// Those of the points on the part (`on_part`, with noise `sigma_mm`) that are on a face.
pub(in crate::localise) fn on_faces(
    surface: &CompositeSurface,
    points: &[Vec3],
    measured: &[Measured],
    on_part: &[usize],
    motion: &Pose,
    sigma_mm: f64,
    threads: Threads,
) -> Vec<usize> {
    let depth = EDGE * sigma_mm;
    let is_on_face = |&i: &usize| {
        let m = &measured[i];
        let Some(normal) = surface.facet_normal(m.face) else {
            return true;
        };
        let foot = motion.undo(&(points[i] - m.direction * m.distance_mm));
        [depth, -depth].iter().all(|depth| {
            let near = surface.near_within(&(foot + normal * *depth), m.face, OTHER * depth.abs());
            near.is_none_or(|near| near.distance_mm.abs() >= OTHER * depth.abs())
        })
    };
    threads
        .chunks(on_part.len(), 4096, |range| {
            let some = on_part[range].iter().copied();
            some.filter(is_on_face).collect::<Vec<usize>>()
        })
        .concat()
}

#[cfg(test)]
mod tests {
    use crate::localise::tests::{Random, scan, straight, task};

    /// The edges of two sides hold the third direction by chance: the spacing of the points is 0.9 mm.
    #[test]
    fn two_sides_do_not_hold_a_part_by_their_edges() {
        let model = straight();
        let mut random = Random(23);
        for _ in 0..4 {
            let pose = random.pose();
            let points = scan(&model, 3000, 0.02, &pose, &mut random, |n| {
                n.z > 0.9 || n.x < -0.9
            });
            let error = task(&model, &points).find().unwrap_err();
            assert_eq!(error.code, "degenerate", "{}", error.message);
        }
    }
}
