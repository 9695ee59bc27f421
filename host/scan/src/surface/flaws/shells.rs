//! Bodies of a mesh that look the wrong way: inwards where nothing is about them, or outwards within another, where a
//! cavity would look inwards.

use std::collections::HashMap;
use std::f64::consts::PI;

use crate::rigid::Vec3;
use crate::surface::Triangle;

/// Triangles that are looked at for all questions together; beyond that no more bodies are judged.
const MOST_LOOKS: usize = 50_000_000;

/// How many bodies of a closed mesh look the wrong way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct OddShells {
    /// Within no other, or within two: looking inwards.
    pub inward: usize,
    /// Within another one: looking outwards.
    pub nested: usize,
}

/// Triangles that hang together by their corners.
struct Shell<'a> {
    triangles: Vec<&'a Triangle>,
    least: Vec3,
    most: Vec3,
    volume_mm3: f64,
}

impl Shell<'_> {
    fn holds_box(&self, other: &Self) -> bool {
        (0..3).all(|k| self.least[k] < other.least[k] && other.most[k] < self.most[k])
    }

    /// Whether a point is within, whichever way the triangles look: by the solid angle that they fill about it
    /// (A. van Oosterom, J. Strackee, *The solid angle of a plane triangle*, 1983).
    fn holds(&self, point: &Vec3) -> bool {
        let angle: f64 = (self.triangles.iter())
            .map(|t| {
                let [a, b, c] = t.corners.map(|corner| corner - point);
                let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
                let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
                2.0 * a.dot(&b.cross(&c)).atan2(below)
            })
            .sum();
        angle.abs() > 2.0 * PI
    }
}

/// Looks at every body of a closed mesh.
pub(super) fn odd_shells(triangles: &[Triangle]) -> OddShells {
    let shells = shells(triangles);
    let mut odd = OddShells::default();
    if shells.len() < 2 {
        // One alone: its volume says all.
        return odd;
    }
    let mut looks = 0;
    for inner in &shells {
        let mut depth = 0;
        for outer in &shells {
            if !outer.holds_box(inner) {
                continue;
            }
            let n = inner.triangles.len();
            let three = [0, n / 2, n - 1].map(|place| inner.triangles[place].corners[0]);
            looks += 3 * outer.triangles.len();
            if looks > MOST_LOOKS {
                return odd;
            }
            depth += usize::from(three.iter().all(|point| outer.holds(point)));
        }
        if depth % 2 == 0 && inner.volume_mm3 < 0.0 {
            odd.inward += 1;
        } else if depth % 2 == 1 && inner.volume_mm3 > 0.0 {
            odd.nested += 1;
        }
    }
    odd
}

fn shells(triangles: &[Triangle]) -> Vec<Shell<'_>> {
    // Each corner's body, by way of others that it was joined to.
    let mut joined: Vec<usize> = Vec::new();
    let mut numbers = HashMap::new();
    let mut corners: Vec<[usize; 3]> = Vec::with_capacity(triangles.len());
    for t in triangles {
        let numbered = t.corners.map(|c| {
            let key = [c.x, c.y, c.z].map(|x| (x + 0.0).to_bits());
            *numbers.entry(key).or_insert_with(|| {
                joined.push(joined.len());
                joined.len() - 1
            })
        });
        let root = end(&mut joined, numbered[0]);
        for other in &numbered[1..] {
            let other = end(&mut joined, *other);
            joined[other] = root;
        }
        corners.push(numbered);
    }
    let mut places = HashMap::new();
    let mut shells: Vec<Shell<'_>> = Vec::new();
    for (t, numbered) in triangles.iter().zip(&corners) {
        let root = end(&mut joined, numbered[0]);
        let place = *places.entry(root).or_insert(shells.len());
        if place == shells.len() {
            shells.push(Shell {
                triangles: Vec::new(),
                least: Vec3::repeat(f64::INFINITY),
                most: Vec3::repeat(f64::NEG_INFINITY),
                volume_mm3: 0.0,
            });
        }
        let shell = &mut shells[place];
        for corner in &t.corners {
            (shell.least, shell.most) = (shell.least.inf(corner), shell.most.sup(corner));
        }
        shell.triangles.push(t);
    }
    for shell in &mut shells {
        let origin = shell.triangles[0].corners[0];
        let six = shell.triangles.iter().map(|t| {
            let [a, b, c] = t.corners.map(|corner| corner - origin);
            a.dot(&b.cross(&c))
        });
        shell.volume_mm3 = six.sum::<f64>() / 6.0;
    }
    shells
}

/// Where a chain of joined corners ends; it is half as long behind.
fn end(joined: &mut [usize], mut at: usize) -> usize {
    while joined[at] != at {
        joined[at] = joined[joined[at]];
        at = joined[at];
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::Mesh;

    /// A tetrahedron of this size at a place, outwards or inwards.
    fn body(at: f64, size: f64, outwards: bool) -> Vec<[Vec3; 3]> {
        let p = |x: f64, y: f64, z: f64| Vec3::repeat(at) + size * Vec3::new(x, y, z);
        let (o, x, y, z) = (
            p(0.0, 0.0, 0.0),
            p(1.0, 0.0, 0.0),
            p(0.0, 1.0, 0.0),
            p(0.0, 0.0, 1.0),
        );
        let faces = [[o, y, x], [o, x, z], [o, z, y], [x, y, z]];
        let way = |[a, b, c]: [Vec3; 3]| if outwards { [a, b, c] } else { [a, c, b] };
        faces.map(way).to_vec()
    }

    fn odd(bodies: &[Vec<[Vec3; 3]>]) -> (usize, usize) {
        let mesh = Mesh::new(&bodies.concat()).unwrap();
        let odd = odd_shells(mesh.triangles());
        (odd.inward, odd.nested)
    }

    #[test]
    fn each_body_is_judged_by_what_is_about_it() {
        let hull = body(0.0, 30.0, true);
        assert_eq!(odd(std::slice::from_ref(&hull)), (0, 0));
        // A cavity, and a core in it; the same looking outwards, and a core that looks inwards.
        let (cavity, core) = (body(1.0, 20.0, false), body(2.0, 10.0, true));
        assert_eq!(odd(&[hull.clone(), cavity.clone(), core.clone()]), (0, 0));
        assert_eq!(odd(&[hull.clone(), body(1.0, 20.0, true), core]), (0, 1));
        assert_eq!(odd(&[hull.clone(), cavity, body(2.0, 10.0, false)]), (1, 0));
        // Beside each other.
        assert_eq!(odd(&[hull.clone(), body(40.0, 5.0, true)]), (0, 0));
        assert_eq!(odd(&[hull.clone(), body(40.0, 5.0, false)]), (1, 0));
        // In the hull's box, but beyond its slope.
        assert_eq!(odd(&[hull, body(15.0, 5.0, true)]), (0, 0));
    }
}
