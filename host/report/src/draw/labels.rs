//! Labels that do not overlap: each takes the first free place around what it
//! names.

use crate::draw::markup::Element;
use crate::draw::svg::{self, TEXT, text_width};

/// Where a label may stand, best first.
const DIRECTIONS: [[f64; 2]; 12] = [
    [1.0, 0.0],
    [-1.0, 0.0],
    [0.0, -1.0],
    [0.0, 1.0],
    [0.8, -0.8],
    [-0.8, -0.8],
    [0.8, 0.8],
    [-0.8, 0.8],
    [0.4, -1.0],
    [-0.4, -1.0],
    [0.4, 1.0],
    [-0.4, 1.0],
];

/// What is taken in a picture.
#[derive(Clone, Debug)]
pub struct Labels {
    low: [f64; 2],
    high: [f64; 2],
    taken: Vec<Area>,
}

#[derive(Clone, Copy, Debug)]
struct Area {
    low: [f64; 2],
    high: [f64; 2],
}

impl Area {
    /// The area by which two overlap.
    fn overlap(&self, other: &Self) -> f64 {
        (0..2)
            .map(|i| (self.high[i].min(other.high[i]) - self.low[i].max(other.low[i])).max(0.0))
            .product()
    }
}

impl Labels {
    /// An empty picture between two corners.
    pub const fn new(low: [f64; 2], high: [f64; 2]) -> Self {
        Self {
            low,
            high,
            taken: Vec::new(),
        }
    }

    /// Keeps labels off a place.
    pub fn keep_off(&mut self, middle: [f64; 2], half: f64) {
        self.taken.push(Area {
            low: middle.map(|c| c - half),
            high: middle.map(|c| c + half),
        });
    }

    /// Keeps labels off a line.
    pub fn keep_off_line(&mut self, from: [f64; 2], to: [f64; 2]) {
        let steps = 16;
        for step in 0..=steps {
            let at = f64::from(step) / f64::from(steps);
            self.keep_off(
                std::array::from_fn(|i| from[i] + (to[i] - from[i]) * at),
                2.5,
            );
        }
    }

    /// Keeps labels off the line of a circle, not off its inside.
    pub fn keep_off_circle(&mut self, middle: [f64; 2], radius: f64) {
        for step in 0..48 {
            let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 48.0).sin_cos();
            self.keep_off([middle[0] + radius * cos, middle[1] + radius * sin], 1.5);
        }
    }

    /// Draws a label near a point, at `distance` from it or somewhat farther;
    /// where nothing is free, where it covers least.
    pub fn place(&mut self, class: &str, near: [f64; 2], distance: f64, content: &str) -> Element {
        let half = [text_width(class, content) / 2.0, TEXT / 2.0];
        let mut best: Option<(f64, Area)> = None;
        for reach in [1.0, 1.5, 2.2, 3.2, 4.5, 6.0] {
            let d = distance * reach;
            for [u, v] in DIRECTIONS {
                // The middle of the label, so that its near edge is `d` away.
                let middle = [near[0] + u * (d + half[0]), near[1] + v * (d + half[1])];
                let area = Area {
                    low: std::array::from_fn(|i| middle[i] - half[i]),
                    high: std::array::from_fn(|i| middle[i] + half[i]),
                };
                let cost = self.cost(&area);
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, area));
                }
            }
            if best.is_some_and(|(cost, _)| cost <= 0.0) {
                break;
            }
        }
        let area = best.map_or(
            Area {
                low: near,
                high: near,
            },
            |(_, area)| area,
        );
        self.taken.push(area);
        // The baseline lies above the bottom of the area by the descenders.
        svg::text(class, [area.low[0], area.high[1] - 2.0], content)
    }

    /// How much is covered, with what leaves the picture counted most.
    fn cost(&self, area: &Area) -> f64 {
        let covered: f64 = self.taken.iter().map(|taken| taken.overlap(area)).sum();
        let outside: f64 = (0..2)
            .map(|i| (self.low[i] - area.low[i]).max(0.0) + (area.high[i] - self.high[i]).max(0.0))
            .sum();
        covered + outside * 100.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten labels for one point: none lies on another, none leaves the picture.
    #[test]
    fn labels_find_their_own_place() {
        let mut labels = Labels::new([0.0, 0.0], [300.0, 300.0]);
        for _ in 0..10 {
            let _ = labels.place("t", [150.0, 150.0], 8.0, "SPHERE1");
        }
        for (i, one) in labels.taken.iter().enumerate() {
            assert!(one.low.iter().all(|c| *c >= 0.0) && one.high.iter().all(|c| *c <= 300.0));
            for other in &labels.taken[i + 1..] {
                assert!(one.overlap(other) < 1e-9, "{one:?} {other:?}");
            }
        }
    }
}
