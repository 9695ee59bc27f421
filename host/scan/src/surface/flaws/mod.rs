//! What is odd about a mesh as a nominal, and no reason to refuse it.

mod shells;

use std::collections::HashMap;

use super::mesh::Mesh;
use crate::rigid::Vec3;
use shells::odd_shells;

/// What rounding to single precision leaves of a length, as a share of the mesh's size.
const FLAT: f64 = 1e-6;

impl Mesh {
    /// What whoever compares with this mesh must know, each beginning with its name.
    #[must_use]
    pub fn flaws(&self) -> Vec<String> {
        let mut flaws = Vec::new();
        if self.turned > 0 {
            flaws.push(format!(
                "turned_faces: {} of {} faces of the nominal looked inwards in the file; here they look outwards",
                self.turned,
                self.triangles.len()
            ));
        }
        let is_closed = self.is_closed();
        if !is_closed {
            flaws.push(
                "open_mesh: the nominal has edges where no face goes on; which side is outside, its \
                 faces alone say"
                    .to_owned(),
            );
        }
        let odd = self.edges_at_odds();
        if odd > 0 {
            flaws.push(format!(
                "mixed_faces: at {odd} edges of the nominal one face looks outwards and the other inwards; the sign of \
                 a deviation changes there"
            ));
        }
        if self.is_flat() {
            flaws.push(
                "flat_mesh: all faces of the nominal lie in one plane; a point beside it has the distance to its border"
                    .to_owned(),
            );
        }
        if is_closed {
            let least = FLAT * self.area_mm2() * self.diagonal_mm();
            let volume = self.volume_mm3();
            if volume.abs() <= least {
                flaws.push(
                    "no_volume: the faces of the nominal enclose nothing; the sign of a deviation means nothing"
                        .to_owned(),
                );
            } else if volume < 0.0 {
                flaws.push(
                    "inward_faces: the faces of the nominal look inwards and could not be turned; a point outside has a \
                     negative deviation"
                        .to_owned(),
                );
            } else {
                let odd = odd_shells(&self.triangles);
                if odd.inward > 0 {
                    flaws.push(format!(
                        "inward_faces: {} bodies of the nominal look inwards; a point outside them has a negative deviation",
                        odd.inward
                    ));
                }
                if odd.nested > 0 {
                    flaws.push(format!(
                        "nested_faces: {} bodies of the nominal lie within others and look outwards; as cavities they \
                         would look inwards, and the sign of a deviation there is the other one",
                        odd.nested
                    ));
                }
            }
        }
        flaws
    }

    /// The volume that the faces enclose; negative where they look inwards.
    fn volume_mm3(&self) -> f64 {
        let Some(origin) = self.triangles.first().map(|t| t.corners[0]) else {
            return 0.0;
        };
        let six: f64 = (self.triangles.iter())
            .map(|t| {
                let [a, b, c] = t.corners.map(|c| c - origin);
                a.dot(&b.cross(&c))
            })
            .sum();
        six / 6.0
    }

    /// Whether all corners lie in the plane of the largest face.
    fn is_flat(&self) -> bool {
        let largest = self
            .triangles
            .iter()
            .max_by(|a, b| a.area_mm2.total_cmp(&b.area_mm2));
        let most = FLAT * self.diagonal_mm();
        largest.is_some_and(|plane| {
            let off = |c: &Vec3| plane.normal.dot(&(c - plane.corners[0])).abs();
            (self.triangles.iter()).all(|t| t.corners.iter().all(|c| off(c) <= most))
        })
    }

    /// Edges of two faces that run along it the same way: one of them is turned over.
    fn edges_at_odds(&self) -> usize {
        let key = |c: &Vec3| [c.x, c.y, c.z].map(|x| (x + 0.0).to_bits());
        // How many faces run along an edge, and how many of them upwards.
        let mut edges: HashMap<_, (u32, u32)> = HashMap::new();
        for t in &self.triangles {
            for k in 0..3 {
                let (a, b) = (key(&t.corners[k]), key(&t.corners[(k + 1) % 3]));
                let edge = edges.entry(if a < b { (a, b) } else { (b, a) });
                let (faces, upwards) = edge.or_default();
                *faces += 1;
                *upwards += u32::from(a < b);
            }
        }
        let odd = edges.values().filter(|edge| matches!(edge, (2, 0 | 2)));
        odd.count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::outward;

    fn names(faces: &[[[f64; 3]; 3]]) -> Vec<String> {
        let faces: Vec<[Vec3; 3]> = faces.iter().map(|t| t.map(Vec3::from)).collect();
        let mesh = outward(Mesh::new(&faces).unwrap()).unwrap();
        let flaws = mesh.flaws();
        let name = |flaw: &String| flaw.split(':').next().unwrap().to_owned();
        flaws.iter().map(name).collect()
    }

    const O: [f64; 3] = [0.0, 0.0, 0.0];
    const X: [f64; 3] = [10.0, 0.0, 0.0];
    const Y: [f64; 3] = [0.0, 10.0, 0.0];
    const Z: [f64; 3] = [0.0, 0.0, 10.0];
    const SOLID: [[[f64; 3]; 3]; 4] = [[O, Y, X], [O, X, Z], [O, Z, Y], [X, Y, Z]];

    #[test]
    fn a_sound_body_has_no_flaw_and_each_flaw_its_name() {
        assert!(names(&SOLID).is_empty());
        // Each face as it may be exported: turned over, and put right.
        let mut one = SOLID;
        one[2].swap(0, 1);
        assert_eq!(names(&one), ["turned_faces"]);
        assert_eq!(names(&SOLID.map(|[a, b, c]| [a, c, b])), ["turned_faces"]);
        assert_eq!(names(&SOLID[..3]), ["open_mesh"]);
        // Without a cover nothing says which of them is turned over.
        assert_eq!(names(&one[..3]), ["open_mesh", "mixed_faces"]);
        assert_eq!(names(&SOLID[..1]), ["open_mesh", "flat_mesh"]);
        assert_eq!(names(&[[O, X, Y], [O, Y, X]]), ["flat_mesh", "no_volume"]);
        // A roof of two slopes, both sides of it: closed, and nothing within.
        let roof = [[O, X, Y], [O, Y, X], [O, Z, Y], [O, Y, Z]];
        assert_eq!(names(&roof), ["no_volume"]);
        // Two bodies that share an edge cannot be told apart by their edges.
        let beside = [[-10.0, 0.0, 0.0], [0.0, -10.0, 0.0]];
        let other = [[O, beside[1], beside[0]], [O, beside[0], Z]];
        let other = [
            other[0],
            other[1],
            [O, Z, beside[1]],
            [beside[0], beside[1], Z],
        ];
        let inwards = [SOLID, other]
            .concat()
            .iter()
            .map(|[a, b, c]| [*a, *c, *b])
            .collect::<Vec<_>>();
        assert_eq!(names(&inwards), ["inward_faces"]);
    }
}
