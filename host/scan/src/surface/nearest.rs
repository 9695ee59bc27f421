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

/// Levels of a tree of 2³² triangles, and some more.
const DEPTH: usize = 40;

/// A triangle with what its distance needs, beside those of its leaf.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    corner: Vec3,
    sides: [Vec3; 2],
    normal: Vec3,
    /// Squares and product of the sides, and the square of twice the area.
    d00: f64,
    d01: f64,
    d11: f64,
    area: f64,
    /// The triangle's number.
    face: u32,
}

impl Facet {
    pub fn new(t: &Triangle, face: u32) -> Self {
        let [a, b, c] = &t.corners;
        let (e0, e1) = (b - a, c - a);
        let (d00, d01, d11) = (e0.norm_squared(), e0.dot(&e1), e1.norm_squared());
        Self {
            corner: *a,
            sides: [e0, e1],
            normal: t.normal,
            d00,
            d01,
            d11,
            area: (d00 * d11 - d01 * d01).max(1e-300),
            face,
        }
    }

    /// From `q`: the squared distance, the difference (q − foot), and its cosine to the normal; none if the distance is
    /// larger than the root of `limit`.
    #[inline]
    fn from(&self, q: &Vec3, limit: f64) -> Option<(f64, Vec3, f64)> {
        let w = q - self.corner;
        let h = w.dot(&self.normal);
        // The plane is not farther than the triangle.
        if h * h > limit {
            return None;
        }
        let [e0, e1] = &self.sides;
        let (p0, p1) = (w.dot(e0), w.dot(e1));
        let (v, u) = (self.d11 * p0 - self.d01 * p1, self.d00 * p1 - self.d01 * p0);
        let beyond = u + v > self.area;
        if v >= 0.0 && u >= 0.0 && !beyond {
            let cosine = if h < 0.0 { -1.0 } else { f64::from(h > 0.0) };
            return Some((h * h, self.normal * h, cosine));
        }
        // The nearest point lies on a side that the foot on the plane is beyond.
        let mut low = f64::INFINITY;
        let mut off = w;
        let mut side = |other: Vec3| {
            let squared = other.norm_squared();
            if squared < low {
                (low, off) = (squared, other);
            }
        };
        if u < 0.0 {
            side(to_segment(&w, e0, p0, self.d00));
        }
        if v < 0.0 {
            side(to_segment(&w, e1, p1, self.d11));
        }
        if beyond {
            let (w, e) = (w - e0, e1 - e0);
            side(to_segment(&w, &e, w.dot(&e), e.norm_squared()));
        }
        Some((low, off, off.dot(&self.normal) / low.sqrt().max(1e-300)))
    }
}

struct Best {
    low: f64,
    /// What a distance may be, squared, to be as near.
    limit: f64,
    cosine: f64,
    off: Vec3,
    face: u32,
}

/// Squared distances that differ by less are one: 5e-10 mm of the distance itself.
fn tie(low: f64) -> f64 {
    1e-18 + 1e-9 * low.sqrt()
}

/// No triangle.
const NONE: u32 = u32::MAX;

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
        // There is a triangle, and it is nearer than that.
        self.near_within(q, hint, f64::INFINITY).unwrap_or(Near {
            distance_mm: f64::MAX,
            direction: Vec3::z(),
            face: 0,
        })
    }

    /// The same, none if the surface is farther than `limit` mm: most is not looked at then.
    #[must_use]
    pub fn near_within(&self, q: &Vec3, hint: usize, limit: f64) -> Option<Near> {
        let tree = &self.tree;
        let squared = (limit * limit).min(f64::MAX);
        let mut best = Best {
            low: squared,
            limit: squared,
            cosine: 0.0,
            off: Vec3::zeros(),
            face: NONE,
        };
        let hint = tree.places.get(hint).map_or(0, |place| *place as usize);
        best.consider(&tree.facets[hint], q);
        let nodes = &tree.nodes;
        let mut stack = [(0_u32, 0.0_f64); DEPTH];
        stack[0].1 = nodes[0].distance_squared(q);
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (at, box_squared) = stack[height];
            if box_squared > best.limit {
                continue;
            }
            let node = &nodes[at as usize];
            if node.count > 0 {
                for facet in &tree.facets[node.start as usize..(node.start + node.count) as usize] {
                    best.consider(facet, q);
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
            // A median split is never deeper than the stack: 40 levels would need 2⁴⁰ triangles.
            if far.1 <= best.limit {
                stack[height] = far;
                height += 1;
            }
            if near.1 <= best.limit {
                stack[height] = near;
                height += 1;
            }
        }
        (best.face != NONE).then(|| best.near(&self.triangles))
    }
}

impl Best {
    #[inline]
    fn consider(&mut self, facet: &Facet, q: &Vec3) {
        let Some((squared, off, cosine)) = facet.from(q, self.limit) else {
            return;
        };
        if squared > self.limit {
            return;
        }
        let clear = self.face == NONE || squared < 2.0 * self.low - self.limit;
        let looks = cosine.abs() > self.cosine.abs()
            || (cosine.abs() == self.cosine.abs() && facet.face < self.face);
        if clear || looks {
            self.cosine = cosine;
            self.off = off;
            self.face = facet.face;
        }
        if squared < self.low || self.low == self.limit {
            self.low = self.low.min(squared);
            self.limit = self.low + tie(self.low);
        }
    }

    fn near(&self, triangles: &[Triangle]) -> Near {
        let distance = self.low.sqrt();
        let sign = if self.cosine < 0.0 { -1.0 } else { 1.0 };
        let face = self.face as usize;
        Near {
            distance_mm: distance * sign,
            direction: if distance > 1e-12 {
                self.off * (sign / distance)
            } else {
                triangles[face].normal
            },
            face,
        }
    }
}

/// From the nearest point of the segment 0..e to `w`; `p` is their product, `d` the square of e.
#[inline]
fn to_segment(w: &Vec3, e: &Vec3, p: f64, d: f64) -> Vec3 {
    w - e * (p / d.max(1e-300)).clamp(0.0, 1.0)
}
