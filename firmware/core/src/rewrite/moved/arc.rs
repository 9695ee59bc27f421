//! Arcs: what the words mean, what a control makes of rounded ones, and chords.

use core::f64::consts::PI;

use libm::{asin, atan2, ceil, fabs, hypot, sincos, sqrt};

/// How far the radii at both ends may differ, mm: LinuxCNC and Fanuc 3410 take more.
pub(in crate::rewrite) const RADII_MM: f64 = 0.0127;

/// An arc in the plane of its first two coordinates, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) struct Arc {
    pub start: [f64; 2],
    pub center: [f64; 2],
    /// Radius at the start and at the end: they may differ by rounding.
    pub radii: [f64; 2],
    /// Angle passed, positive to the left; whole turns with it.
    pub sweep: f64,
    /// Whole turns that were added.
    pub turns: u32,
}

impl Arc {
    /// From a centre. None if the radii differ, or are nothing.
    pub fn about(start: [f64; 2], end: [f64; 2], center: [f64; 2], left: bool) -> Option<Self> {
        let [x0, y0] = [start[0] - center[0], start[1] - center[1]];
        let [x1, y1] = [end[0] - center[0], end[1] - center[1]];
        let radii = [hypot(x0, y0), hypot(x1, y1)];
        let fits = radii[0] > 1e-6 && fabs(radii[0] - radii[1]) <= RADII_MM;
        if !fits {
            return None;
        }
        Some(Self {
            start,
            center,
            radii,
            sweep: turn([x0, y0], [x1, y1], left),
            turns: 0,
        })
    }

    /// From a radius: below half a turn, or above with a negative one.
    pub fn with_radius(start: [f64; 2], end: [f64; 2], radius: f64, left: bool) -> Option<Self> {
        let [dx, dy] = [end[0] - start[0], end[1] - start[1]];
        let half = hypot(dx, dy) / 2.0;
        // A whole circle has no direction to lie in.
        let reaches = half > 1e-6 && half <= fabs(radius) + RADII_MM / 2.0;
        if !reaches {
            return None;
        }
        let height = sqrt((radius * radius - half * half).max(0.0));
        let side = if left == (radius > 0.0) {
            height
        } else {
            -height
        };
        let center = [
            f64::midpoint(start[0], end[0]) - side * dy / (2.0 * half),
            f64::midpoint(start[1], end[1]) + side * dx / (2.0 * half),
        ];
        Self::about(start, end, center, left)
    }

    /// The same arc with whole turns added.
    pub fn with_turns(self, turns: u32) -> Self {
        let more = f64::from(turns) * 2.0 * PI;
        Self {
            sweep: self.sweep + if self.sweep < 0.0 { -more } else { more },
            turns,
            ..self
        }
    }

    /// Whether it comes back to where it began.
    pub fn is_full(&self) -> bool {
        let turns = f64::from(self.turns + 1);
        fabs(fabs(self.sweep) - turns * 2.0 * PI) < 1e-9 * turns
    }

    /// The place after this part of the angle, 0 to 1.
    pub fn at(&self, part: f64) -> [f64; 2] {
        let [x, y] = [
            (self.start[0] - self.center[0]) / self.radii[0],
            (self.start[1] - self.center[1]) / self.radii[0],
        ];
        let (sin, cos) = sincos(self.sweep * part);
        let radius = self.radii[0] + (self.radii[1] - self.radii[0]) * part;
        [
            self.center[0] + radius * (x * cos - y * sin),
            self.center[1] + radius * (x * sin + y * cos),
        ]
    }

    /// Chords that stay this near, mm: half the angle of a chord has the versine
    /// `tolerance / radius`.
    pub fn chords(&self, tolerance_mm: f64) -> f64 {
        let radius = self.radii[0].max(self.radii[1]);
        let half = if tolerance_mm < radius {
            // acos(1 - x), without losing the digits of a small x.
            2.0 * asin(sqrt(tolerance_mm / (2.0 * radius)))
        } else {
            PI / 2.0
        };
        // A chord over more than a quarter turn is no arc any more.
        ceil(fabs(self.sweep) / (2.0 * half).min(PI / 2.0)).max(1.0)
    }

    /// How far the arc leaves its own plane's slope when the plane is tilted: the height
    /// goes as a sine of the angle, and a control makes it a straight line of the angle.
    pub fn bow(&self) -> f64 {
        let sweep = fabs(self.sweep);
        self.radii[0] * (sweep * sweep / 8.0).min(2.0)
    }
}

/// The angle from one direction to another; none is a full turn.
fn turn(from: [f64; 2], to: [f64; 2], left: bool) -> f64 {
    let [x0, y0] = from;
    let [x1, y1] = to;
    let angle = atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1);
    let angle = if fabs(angle) < 1e-9 { 0.0 } else { angle };
    match (left, angle > 0.0) {
        (true, true) => angle,
        (false, false) if angle != 0.0 => angle,
        (true, false) => angle + 2.0 * PI,
        (false, _) => angle - 2.0 * PI,
    }
}
