//! A ball swept along a segment.

use nalgebra::Vector3;

/// The solid that a ball sweeps on a straight way: a cylinder with two half balls.
///
/// Above the point (x, y) its lower side is the lowest over the way of
/// `z(t) - sqrt(r² - d(t)²)`, `d` the horizontal distance of the ball's centre from
/// the point. That is convex in `t` (a linear function less a concave one), so the
/// minimum stands where the derivative is zero, or at the end of the way next to it.
#[derive(Clone, Copy, Debug)]
pub struct Capsule {
    from: Vector3<f64>,
    to: Vector3<f64>,
    radius_mm: f64,
    /// Direction of the way in plan, a unit vector; zero for a plunge.
    along: [f64; 2],
    /// Length of the way in plan, mm.
    length_mm: f64,
    /// Rise of the way per millimetre in plan.
    slope: f64,
    /// How far behind the point the ball's centre is when it is lowest there,
    /// per millimetre of the ball's half width at the point.
    lag: f64,
}

impl Capsule {
    /// The ball of this radius whose centre goes from one place to another, mm.
    #[must_use]
    pub fn new(from: Vector3<f64>, to: Vector3<f64>, radius_mm: f64) -> Self {
        let way = to - from;
        let length_mm = (way.x * way.x + way.y * way.y).sqrt();
        let (along, slope) = if length_mm > 0.0 {
            ([way.x / length_mm, way.y / length_mm], way.z / length_mm)
        } else {
            ([0.0, 0.0], 0.0)
        };
        Self {
            from,
            to,
            radius_mm,
            along,
            length_mm,
            slope,
            lag: slope / (1.0 + slope * slope).sqrt(),
        }
    }

    /// The height of its lower side above (x, y); None beside it.
    #[must_use]
    pub fn lowest_above(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let dx = x_mm - self.from.x;
        let dy = y_mm - self.from.y;
        let [ux, uy] = self.along;
        // Where the point is along the way, and beside it.
        let at = dx * ux + dy * uy;
        let beside_squared = if self.length_mm > 0.0 {
            let beside = dy * ux - dx * uy;
            beside * beside
        } else {
            dx * dx + dy * dy
        };
        let width_squared = self.radius_mm * self.radius_mm - beside_squared;
        if width_squared < 0.0 {
            return None;
        }
        if self.length_mm == 0.0 {
            let low = self.from.z.min(self.to.z);
            return Some(low - width_squared.sqrt());
        }
        // d/dw (slope w - sqrt(width² - w²)) = 0 at w = -lag * width.
        let best = at - self.lag * width_squared.sqrt();
        let center = best.clamp(0.0, self.length_mm);
        let off = at - center;
        let under = width_squared - off * off;
        (under >= 0.0).then(|| self.from.z + self.slope * center - under.sqrt())
    }

    /// The corners of its box in plan: x, then y, each lowest and highest, mm.
    #[must_use]
    pub fn plan_box(&self) -> [[f64; 2]; 2] {
        let r = self.radius_mm;
        [
            [
                self.from.x.min(self.to.x) - r,
                self.from.x.max(self.to.x) + r,
            ],
            [
                self.from.y.min(self.to.y) - r,
                self.from.y.max(self.to.y) + r,
            ],
        ]
    }

    /// The height below which no part of it is, mm.
    #[must_use]
    pub fn bottom_mm(&self) -> f64 {
        self.from.z.min(self.to.z) - self.radius_mm
    }
}
