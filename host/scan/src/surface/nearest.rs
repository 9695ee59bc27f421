//! The nearest point of a mesh, exactly, with a sign.

use super::mesh::Mesh;
use super::triangle::Triangle;
use crate::rigid::Vec3;

/// What a surface is to a point near it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// The distance in mm: positive outside, where the normals point.
    pub distance_mm: f64,
    /// The direction in which the distance grows, of length 1: away from the nearest point of the surface, or its normal on it.
    pub direction: Vec3,
    /// The number of the triangle; of the body for a ball or a cone, counted on from the last triangle.
    pub face: usize,
}

/// Levels of a tree of 2³² triangles, and one.
const DEPTH: usize = 64;

struct Best {
    low: f64,
    cosine: f64,
    off: Vec3,
    face: usize,
}

/// Squared distances that differ by less are one: 5e-10 mm of the distance itself.
fn tie(low: f64) -> f64 {
    1e-18 + 1e-9 * low.sqrt()
}

impl Mesh {
    /// The surface nearest to `q`. Where several triangles are nearest (an edge, a corner), the sign is that of the one
    /// that looks most along the difference.
    #[must_use]
    pub fn near(&self, q: &Vec3) -> Near {
        self.near_from(q, 0)
    }

    /// The same, faster where `hint` is a triangle that is near.
    #[must_use]
    pub fn near_from(&self, q: &Vec3, hint: usize) -> Near {
        let hint = if hint < self.triangles.len() { hint } else { 0 };
        let (squared, off, cosine) = to_triangle(&self.triangles[hint], q);
        let mut best = Best {
            low: squared,
            cosine,
            off,
            face: hint,
        };
        let nodes = &self.tree.nodes;
        let mut stack = [(0_u32, 0.0_f64); DEPTH];
        stack[0].1 = nodes[0].distance_squared(q);
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (at, box_squared) = stack[height];
            if box_squared > best.low + tie(best.low) {
                continue;
            }
            let node = &nodes[at as usize];
            if node.count > 0 {
                for &k in &self.tree.order[node.start as usize..(node.start + node.count) as usize]
                {
                    best.consider(k as usize, to_triangle(&self.triangles[k as usize], q));
                }
                continue;
            }
            let (left, right) = (at + 1, node.start);
            let (l, r) = (
                nodes[left as usize].distance_squared(q),
                nodes[right as usize].distance_squared(q),
            );
            let (near, far) = if l <= r {
                ((left, l), (right, r))
            } else {
                ((right, r), (left, l))
            };
            // A median split is never deeper than the stack: 64 levels would need 2⁶⁴ triangles.
            stack[height] = far;
            stack[height + 1] = near;
            height += 2;
        }
        best.near(&self.triangles)
    }
}

impl Best {
    fn consider(&mut self, face: usize, (squared, off, cosine): (f64, Vec3, f64)) {
        let tie = tie(self.low);
        if squared > self.low + tie {
            return;
        }
        let clear = squared < self.low - tie;
        let looks = cosine.abs() > self.cosine.abs()
            || (cosine.abs() == self.cosine.abs() && face < self.face);
        if clear || looks {
            self.cosine = cosine;
            self.off = off;
            self.face = face;
        }
        self.low = self.low.min(squared);
    }

    fn near(&self, triangles: &[Triangle]) -> Near {
        let distance = self.low.sqrt();
        let sign = if self.cosine < 0.0 { -1.0 } else { 1.0 };
        Near {
            distance_mm: distance * sign,
            direction: if distance > 1e-12 {
                self.off * (sign / distance)
            } else {
                triangles[self.face].normal
            },
            face: self.face,
        }
    }
}

/// To the triangle from `q`: the squared distance, the difference (q − foot), and its cosine to the normal.
fn to_triangle(t: &Triangle, q: &Vec3) -> (f64, Vec3, f64) {
    let [a, b, c] = &t.corners;
    let (e0, e1, w) = (b - a, c - a, q - a);
    let h = w.dot(&t.normal);
    let (d00, d01, d11) = (e0.norm_squared(), e0.dot(&e1), e1.norm_squared());
    let (p0, p1) = (w.dot(&e0), w.dot(&e1));
    let area = (d00 * d11 - d01 * d01).max(1e-300);
    let (v, u) = (d11 * p0 - d01 * p1, d00 * p1 - d01 * p0);
    if v >= 0.0 && u >= 0.0 && u + v <= area {
        return (
            h * h,
            t.normal * h,
            if h < 0.0 { -1.0 } else { f64::from(h > 0.0) },
        );
    }
    let mut off = to_segment(&w, &e0);
    let mut low = off.norm_squared();
    for other in [to_segment(&w, &e1), to_segment(&(q - b), &(c - b))] {
        let squared = other.norm_squared();
        if squared < low {
            (low, off) = (squared, other);
        }
    }
    (low, off, off.dot(&t.normal) / low.sqrt().max(1e-300))
}

/// From the nearest point of the segment 0..e to `w`.
fn to_segment(w: &Vec3, e: &Vec3) -> Vec3 {
    let along = w.dot(e) / e.norm_squared().max(1e-300);
    w - e * along.clamp(0.0, 1.0)
}
