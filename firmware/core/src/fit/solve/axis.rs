//! An axis in space, with the distance from it and its derivatives: what
//! cylinder and cone share.

use nalgebra::Vector3;

use super::linalg::{Square, orthonormal, perpendicular_frame, unit};

/// A directed straight line in local coordinates, with a frame across it.
#[derive(Clone, Copy)]
pub(crate) struct Axis {
    /// Foot of the local origin (the centroid) on the axis.
    pub(crate) foot: Vector3<f64>,
    pub(crate) e1: Vector3<f64>,
    pub(crate) e2: Vector3<f64>,
    /// Unit direction; (e1, e2, direction) is right-handed.
    pub(crate) direction: Vector3<f64>,
}

/// A point seen from an axis: along it, away from it, and the derivatives by
/// the steps (a, b, α, β) of [`Axis::moved`]; lower triangles only.
pub(crate) struct AxisTerm {
    /// Distance from the axis.
    pub(crate) away: f64,
    pub(crate) away_gradient: [f64; 4],
    pub(crate) away_second: Square<4>,
    /// Position along the axis from the foot.
    pub(crate) along: f64,
    pub(crate) along_gradient: [f64; 4],
    pub(crate) along_second: Square<4>,
}

impl Axis {
    /// The axis through a point; None if the direction has no length.
    pub(crate) fn new(point: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Self> {
        let direction = unit(direction)?;
        let (e1, e2) = perpendicular_frame(&direction);
        Some(Self {
            foot: point - direction * direction.dot(point),
            e1,
            e2,
            direction,
        })
    }

    /// Coordinates of a point across (x, y) and along (z) the axis.
    pub(crate) fn coordinates(&self, q: &Vector3<f64>) -> [f64; 3] {
        let v = q - self.foot;
        [v.dot(&self.e1), v.dot(&self.e2), v.dot(&self.direction)]
    }

    /// The axis shifted by `a e1 + b e2` and tilted to `direction + α e1 + β e2`,
    /// and how far its foot slid along it.
    pub(crate) fn moved(&self, [a, b, alpha, beta]: [f64; 4]) -> Option<(Self, f64)> {
        let point = self.foot + self.e1 * a + self.e2 * b;
        let direction = unit(&(self.direction + self.e1 * alpha + self.e2 * beta))?;
        let [direction, e1, e2] = orthonormal(&direction, &self.e1);
        let slid = -direction.dot(&point);
        Some((
            Self {
                foot: point + direction * slid,
                e1,
                e2,
                direction,
            },
            slid,
        ))
    }

    /// Whether two axes have one direction, up to its sense.
    pub(crate) fn agrees(&self, other: &Self) -> bool {
        /// Minima found from different starts agree far better.
        const SAME: f64 = 1e-3;
        self.direction.cross(&other.direction).amax() < SAME
    }

    /// The same axis in the opposite direction.
    pub(crate) fn reversed(&self) -> Self {
        Self {
            e1: self.e2,
            e2: self.e1,
            direction: -self.direction,
            ..*self
        }
    }

    /// Derivatives at a point; None on the axis, where the distance has none.
    pub(crate) fn term(&self, q: &Vector3<f64>) -> Option<AxisTerm> {
        // With v = q - (a, b, 0) and the tilted unit direction w, to second
        // order: along = v·w = z + αx + βy - z(α² + β²)/2, and
        // away² = |v|² - (v·w)²; away = sqrt(away²) gives
        // ∇away = ∇away²/(2 away), ∇²away = (∇²away²/2 - ∇away ∇awayᵀ)/away.
        let [x, y, z] = self.coordinates(q);
        let away = libm::sqrt(x * x + y * y);
        let inverse = 1.0 / away;
        if !inverse.is_finite() {
            return None;
        }
        let (ux, uy) = (x * inverse, y * inverse);
        let gradient = [-ux, -uy, -z * ux, -z * uy];
        let [ga, gb, gc, gd] = gradient;
        Some(AxisTerm {
            away,
            away_gradient: gradient,
            away_second: [
                [(1.0 - ga * ga) * inverse, 0.0, 0.0, 0.0],
                [-gb * ga * inverse, (1.0 - gb * gb) * inverse, 0.0, 0.0],
                [
                    (z - gc * ga) * inverse,
                    -gc * gb * inverse,
                    (z * z - x * x - gc * gc) * inverse,
                    0.0,
                ],
                [
                    -gd * ga * inverse,
                    (z - gd * gb) * inverse,
                    (-x * y - gd * gc) * inverse,
                    (z * z - y * y - gd * gd) * inverse,
                ],
            ],
            along: z,
            along_gradient: [0.0, 0.0, x, y],
            along_second: [
                [0.0; 4],
                [0.0; 4],
                [-1.0, 0.0, -z, 0.0],
                [0.0, -1.0, 0.0, -z],
            ],
        })
    }
}
