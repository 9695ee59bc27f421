//! Rays and boxes against a mesh.

use super::mesh::Mesh;
use crate::rigid::Vec3;

/// Where a ray meets the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Along the ray, as a multiple of its direction's length.
    pub at: f64,
    /// The triangle's number.
    pub face: usize,
}

/// A box that stands anyhow in space.
#[derive(Clone, Copy, Debug)]
pub struct StandingBox {
    /// Its middle in mm.
    pub centre: Vec3,
    /// Unit vectors along its edges, at right angles.
    pub axes: [Vec3; 3],
    /// Half its length along each.
    pub half_mm: Vec3,
}

const DEPTH: usize = 64;

/// A ray made ready for triangles: seen along itself, so that a triangle is met where it has the
/// ray within.
///
/// Two triangles with an edge in common make the same products of it with the sign turned, so
/// that a ray is on one side of it or on it, never between the two (S. Woop, C. Benthin, I. Wald,
/// "Watertight Ray/Triangle Intersection", JCGT 2 (1), 2013).
struct Sheared {
    origin: Vec3,
    /// The axes: the one along which the ray goes most is the last.
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Sheared {
    fn new(origin: &Vec3, direction: &Vec3) -> Self {
        let last = direction.iamax();
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let along = direction[last];
        Self {
            origin: *origin,
            axes,
            shear: [
                direction[axes[0]] / along,
                direction[axes[1]] / along,
                1.0 / along,
            ],
        }
    }

    /// Where the ray meets one triangle, from either side.
    fn meet(&self, t: &[Vec3; 3]) -> Option<f64> {
        let [x, y, z] = self.axes;
        let [sx, sy, sz] = self.shear;
        let [a, b, c] = t.map(|corner| {
            let from = corner - self.origin;
            (from[x] - sx * from[z], from[y] - sy * from[z], sz * from[z])
        });
        let u = c.0 * b.1 - c.1 * b.0;
        let v = a.0 * c.1 - a.1 * c.0;
        let w = b.0 * a.1 - b.1 * a.0;
        let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let det = u + v + w;
        // Edge on, it is its neighbours that are met.
        (inside && det != 0.0).then(|| (u * a.2 + v * b.2 + w * c.2) / det)
    }
}

impl Mesh {
    /// How often the faces go around a point: 1 inside a closed mesh and 0 outside, a needle that looks the wrong way
    /// notwithstanding. The sum of their solid angles (A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30 (2),
    /// 1983) over 4π.
    #[must_use]
    pub fn winding(&self, p: &Vec3) -> f64 {
        let half_angles = self.triangles().iter().map(|t| {
            let [a, b, c] = t.corners.map(|corner| corner - p);
            let [x, y, z] = [a, b, c].map(|v| v.norm());
            let whole = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
            a.dot(&b.cross(&c)).atan2(whole)
        });
        half_angles.sum::<f64>() / std::f64::consts::TAU
    }

    /// The first triangle that the ray meets strictly between 0 and `far` times its direction.
    #[must_use]
    pub fn first_hit(&self, origin: &Vec3, direction: &Vec3, far: f64) -> Option<RayHit> {
        let mut best: Option<RayHit> = None;
        self.along(origin, direction, far, |hit| {
            best = Some(hit);
            Some(hit.at)
        });
        best
    }

    /// Does any triangle stand between two points, more than `margin_mm` before the second?
    #[must_use]
    pub fn stands_between(&self, from: &Vec3, to: &Vec3, margin_mm: f64) -> bool {
        let way = to - from;
        let far = 1.0 - margin_mm / way.norm().max(margin_mm);
        let mut blocked = false;
        self.along(from, &way, far, |_| {
            blocked = true;
            None
        });
        blocked
    }

    /// Calls `each` for hits nearer than `far`; it answers how far to go on looking, or no further.
    fn along(
        &self,
        origin: &Vec3,
        direction: &Vec3,
        far: f64,
        mut each: impl FnMut(RayHit) -> Option<f64>,
    ) {
        let mut far = far;
        let inverse = direction.map(|d| 1.0 / d);
        let enters = |low: &Vec3, high: &Vec3, far: f64| {
            let (mut from, mut to) = (0.0_f64, far);
            for k in 0..3 {
                if direction[k] == 0.0 {
                    if origin[k] < low[k] || origin[k] > high[k] {
                        return false;
                    }
                    continue;
                }
                let (a, b) = (
                    (low[k] - origin[k]) * inverse[k],
                    (high[k] - origin[k]) * inverse[k],
                );
                from = from.max(a.min(b));
                to = to.min(a.max(b));
            }
            // Rounding must not lose a flat box that the ray only grazes.
            from <= to + 1e-12 * (1.0 + to.abs())
        };
        let ray = Sheared::new(origin, direction);
        let mut stack = [0_u32; DEPTH];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let at = stack[height];
            let node = &self.tree.nodes[at as usize];
            if !enters(&node.low, &node.high, far) {
                continue;
            }
            if node.count == 0 {
                stack[height] = node.start;
                stack[height + 1] = at + 1;
                height += 2;
                continue;
            }
            for &k in &self.tree.order[node.start as usize..(node.start + node.count) as usize] {
                let face = k as usize;
                if let Some(t) = ray.meet(&self.triangles[face].corners)
                    && t > 1e-9
                    && t < far
                {
                    match each(RayHit { at: t, face }) {
                        Some(shorter) => far = shorter,
                        None => return,
                    }
                }
            }
        }
    }

    /// Does a standing box meet any triangle?
    #[must_use]
    pub fn touches(&self, bx: &StandingBox) -> bool {
        let reach: Vec3 = bx
            .axes
            .iter()
            .zip(bx.half_mm.iter())
            .fold(Vec3::zeros(), |sum, (axis, half)| sum + axis.abs() * *half);
        let (low, high) = (bx.centre - reach, bx.centre + reach);
        let mut stack = [0_u32; DEPTH];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let at = stack[height];
            let node = &self.tree.nodes[at as usize];
            if (0..3).any(|k| node.low[k] > high[k] || node.high[k] < low[k])
                || bx.misses_box(&node.low, &node.high)
            {
                continue;
            }
            if node.count == 0 {
                stack[height] = node.start;
                stack[height + 1] = at + 1;
                height += 2;
                continue;
            }
            let leaf = &self.tree.order[node.start as usize..(node.start + node.count) as usize];
            if leaf
                .iter()
                .any(|&k| bx.meets(&self.triangles[k as usize].corners))
            {
                return true;
            }
        }
        false
    }
}

impl StandingBox {
    /// Certainly apart from an upright box: one of this box's faces parts them.
    fn misses_box(&self, low: &Vec3, high: &Vec3) -> bool {
        let (middle, half) = ((low + high) / 2.0 - self.centre, (high - low) / 2.0);
        (0..3).any(|k| {
            middle.dot(&self.axes[k]).abs() > self.half_mm[k] + self.axes[k].abs().dot(&half) + 1e-9
        })
    }

    /// Separating axes of box and triangle.
    fn meets(&self, corners: &[Vec3; 3]) -> bool {
        let h = &self.half_mm;
        let t = corners.map(|c| {
            let d = c - self.centre;
            Vec3::new(
                d.dot(&self.axes[0]),
                d.dot(&self.axes[1]),
                d.dot(&self.axes[2]),
            )
        });
        for k in 0..3 {
            let (a, b, c) = (t[0][k], t[1][k], t[2][k]);
            if a.min(b).min(c) > h[k] || a.max(b).max(c) < -h[k] {
                return false;
            }
        }
        let e = [t[1] - t[0], t[2] - t[1], t[0] - t[2]];
        let n = e[0].cross(&e[1]);
        if n.dot(&t[0]).abs() > n.abs().dot(h) {
            return false;
        }
        for k in 0..3 {
            let mut unit = Vec3::zeros();
            unit[k] = 1.0;
            for f in &e {
                let axis = unit.cross(f);
                let p = t.map(|c| c.dot(&axis));
                let r = axis.abs().dot(h);
                if p[0].min(p[1]).min(p[2]) > r || p[0].max(p[1]).max(p[2]) < -r {
                    return false;
                }
            }
        }
        true
    }
}
