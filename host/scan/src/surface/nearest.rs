//! The nearest point of a mesh, exactly, with a sign.

use super::facets::Facet;
use super::mesh::Mesh;
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

struct Best {
    low: f64,
    /// What a distance may be, squared, to be as near.
    limit: f64,
    /// Of the triangle that looks most along the difference, among all that are as near.
    cosine: f64,
    off: Vec3,
    face: u32,
    /// The nearest of all, to the last bit.
    nearest: Nearest,
}

/// The nearest triangle: its number, the difference to its nearest point, and whether that lies within it.
#[derive(Clone, Copy)]
struct Nearest {
    face: u32,
    off: Vec3,
    within: bool,
}

/// Squared distances that differ by less are one: 5e-10 mm of the distance itself.
fn tie(low: f64) -> f64 {
    1e-18 + 1e-9 * low.sqrt()
}

/// No triangle.
const NONE: u32 = u32::MAX;

impl Mesh {
    /// The surface nearest to `q`. Where several triangles are nearest (an edge, a corner), all of them say the sign; where
    /// the surface is open, the one that looks most along the difference.
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
        let facets = &self.facets;
        let squared = (limit * limit).min(f64::MAX);
        let mut best = Best {
            low: squared,
            limit: squared,
            cosine: 0.0,
            off: Vec3::zeros(),
            face: NONE,
            nearest: Nearest {
                face: NONE,
                off: Vec3::zeros(),
                within: false,
            },
        };
        let hint = facets.places.get(hint).map_or(0, |place| *place as usize);
        best.consider(&facets.all[hint], q);
        facets.boxes.nearest(q, best.limit, |leaf| {
            for facet in &facets.all[leaf] {
                best.consider(facet, q);
            }
            best.limit
        });
        (best.face != NONE).then(|| best.near(self, q))
    }
}

impl Best {
    #[inline]
    fn consider(&mut self, facet: &Facet, q: &Vec3) {
        let Some((squared, off, within)) = facet.off(q, self.limit) else {
            return;
        };
        let cosine = facet.cosine(squared, &off, within);
        let clear = self.face == NONE || squared < 2.0 * self.low - self.limit;
        let looks = cosine.abs() > self.cosine.abs()
            || (cosine.abs() == self.cosine.abs() && facet.face < self.face);
        if clear || looks {
            self.cosine = cosine;
            self.off = off;
            self.face = facet.face;
        }
        let nearest = &mut self.nearest;
        if nearest.face == NONE
            || squared < self.low
            || squared == self.low && facet.face < nearest.face
        {
            *nearest = Nearest {
                face: facet.face,
                off,
                within,
            };
        }
        if squared < self.low || self.low == self.limit {
            self.low = self.low.min(squared);
            self.limit = self.low + tie(self.low);
        }
    }

    fn near(&self, mesh: &Mesh, q: &Vec3) -> Near {
        let distance = self.low.sqrt();
        let sign = if self.along(mesh, q) < 0.0 { -1.0 } else { 1.0 };
        let face = self.face as usize;
        Near {
            distance_mm: distance * sign,
            direction: if distance > 1e-12 {
                self.off * (sign / distance)
            } else {
                mesh.triangles[face].normal
            },
            face,
        }
    }

    /// Of the sign of how far outside the point is.
    fn along(&self, mesh: &Mesh, q: &Vec3) -> f64 {
        let Nearest { face, off, within } = self.nearest;
        if within {
            return match mesh.triangles.get(face as usize) {
                Some(triangle) => off.dot(&triangle.normal),
                None => self.cosine,
            };
        }
        let outward = mesh.facets.outward_at_border(&mesh.triangles, face, q);
        outward.map_or(self.cosine, |outward| off.dot(&outward))
    }
}
