//! A triangle as the nearest one is sought.

use crate::rigid::Vec3;
use crate::surface::triangle::Triangle;

/// A triangle with what its distance needs, beside those of its leaf.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(in crate::surface) struct Facet {
    // First what tells most of them from the nearest.
    corner: Vec3,
    normal: Vec3,
    sides: [Vec3; 2],
    /// Squares and product of the sides, and the square of twice the area.
    d00: f64,
    d01: f64,
    d11: f64,
    area: f64,
    /// The triangle's number.
    pub face: u32,
}

/// A part of a triangle's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::surface) enum Border {
    /// A corner, by its place.
    Corner(usize),
    /// A side: from the first corner to the second, from the first to the third, from the second to the third.
    Side(usize),
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

    /// From `q`: the squared distance, the difference (q − foot), and whether the foot lies within the triangle; none if
    /// the distance is larger than the root of `limit`.
    #[inline]
    pub fn off(&self, q: &Vec3, limit: f64) -> Option<(f64, Vec3, bool)> {
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
            return Some((h * h, self.normal * h, true));
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
        (low <= limit).then_some((low, off, false))
    }

    /// On what of the triangle the point nearest to `q` lies, where that is not within: its corner (a, b, c) or its side
    /// (from a to b, from a to c, from b to c).
    pub fn border(&self, q: &Vec3) -> Border {
        let w = q - self.corner;
        let [e0, e1] = &self.sides;
        let across = e1 - e0;
        let beside = w - e0;
        // Each side with its ends, the way to the point from its beginning, and itself.
        let sides = [(0, 1, &w, e0), (0, 2, &w, e1), (1, 2, &beside, &across)];
        let mut low = f64::INFINITY;
        let mut border = Border::Corner(0);
        for (side, (begin, end, from, along)) in sides.into_iter().enumerate() {
            let share = (from.dot(along) / along.norm_squared().max(1e-300)).clamp(0.0, 1.0);
            let squared = (from - along * share).norm_squared();
            if squared < low {
                low = squared;
                border = match share {
                    0.0 => Border::Corner(begin),
                    1.0 => Border::Corner(end),
                    _ => Border::Side(side),
                };
            }
        }
        border
    }

    /// The cosine of a difference to the normal.
    pub fn cosine(&self, squared: f64, off: &Vec3, within: bool) -> f64 {
        let along = off.dot(&self.normal);
        match along {
            _ if !within => along / squared.sqrt().max(1e-300),
            _ if along < 0.0 => -1.0,
            _ => f64::from(along > 0.0),
        }
    }
}

/// From the nearest point of the segment 0..e to `w`; `p` is their product, `d` the square of e.
#[inline]
fn to_segment(w: &Vec3, e: &Vec3, p: f64, d: f64) -> Vec3 {
    w - e * (p / d.max(1e-300)).clamp(0.0, 1.0)
}
