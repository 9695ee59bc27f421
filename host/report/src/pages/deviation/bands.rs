//! Nine bands of deviation: each has a colour and a mark, so that a map is read without colour, too.

use crate::draw::markup::{Element, el};
use crate::draw::number::fixed;
use crate::draw::svg::{px, rect, text};

/// How many bands there are: seven between the limits, and one beyond either.
pub const BANDS: usize = 9;

/// Where bands end, in halves of the way between the limits, from the middle.
pub const EDGES: [f64; BANDS - 1] = [-1.0, -0.7, -0.4, -0.1, 0.1, 0.4, 0.7, 1.0];

/// Colours of the bands, the lowest first; the same on every page, light or dark.
pub const COLOURS: [&str; BANDS] = [
    "#08306b", "#2171b5", "#6baed6", "#c6dbef", "#e4e4e4", "#fdd0a2", "#fd8d3c", "#d94801",
    "#7f2704",
];

/// Between which deviations the colours change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bands {
    /// The lower limit in mm.
    pub low_mm: f64,
    /// The upper limit in mm.
    pub high_mm: f64,
}

impl Default for Bands {
    fn default() -> Self {
        Self {
            low_mm: -1.0,
            high_mm: 1.0,
        }
    }
}

impl Bands {
    /// The middle between the limits.
    #[must_use]
    pub fn middle_mm(&self) -> f64 {
        f64::midpoint(self.low_mm, self.high_mm)
    }

    /// Half of the way between the limits.
    #[must_use]
    pub fn half_mm(&self) -> f64 {
        (self.high_mm - self.low_mm) / 2.0
    }

    /// The end of band `k`; the last band has none.
    #[must_use]
    pub fn edge_mm(&self, k: usize) -> f64 {
        match k {
            0 => self.low_mm,
            k if k == EDGES.len() - 1 => self.high_mm,
            k => self.middle_mm() + EDGES[k] * self.half_mm(),
        }
    }

    /// The band of a deviation. A limit itself is kept.
    #[must_use]
    pub fn of(&self, deviation_mm: f64) -> usize {
        if deviation_mm > self.high_mm {
            return BANDS - 1;
        }
        (0..BANDS - 2)
            .find(|k| {
                let edge = self.edge_mm(*k);
                deviation_mm < edge || (*k > 0 && deviation_mm == edge)
            })
            .unwrap_or(BANDS - 2)
    }

    /// The unit that suits the limits: its name, and how many of it are a mm.
    #[must_use]
    pub fn unit(&self) -> (&'static str, f64) {
        if self.low_mm.abs().max(self.high_mm.abs()) < 0.9995 {
            ("\u{b5}m", 1e3)
        } else {
            ("mm", 1.0)
        }
    }

    /// A deviation in that unit, with as many digits as a band needs; signed.
    #[must_use]
    pub fn said(&self, deviation_mm: f64) -> String {
        let (_, times) = self.unit();
        let step = 0.1 * self.half_mm() * times;
        let decimals = (0..6)
            .find(|d| {
                (step * 10_f64.powi(*d)).fract().min(1.0) < 1e-6 || step * 10_f64.powi(*d) >= 10.0
            })
            .unwrap_or(6);
        crate::draw::number::signed(deviation_mm * times, decimals as usize)
    }

    /// What the bands mean, from top to bottom, at a place of a picture.
    pub fn legend(&self, [x, y]: [f64; 2]) -> Vec<Element> {
        let mut out = vec![text("t b", [x, y], self.unit().0)];
        for (row, band) in (0..BANDS).rev().enumerate() {
            let top = y + 8.0 + row as f64 * SWATCH;
            out.push(rect("", [x, top], [x + SWATCH, top + SWATCH]).attr("fill", COLOURS[band]));
            out.extend(
                strokes(band, [x + SWATCH / 2.0, top + SWATCH / 2.0], SWATCH * 0.62)
                    .map(|d| stroke_path(band, &d)),
            );
            if band > 0 {
                let edge = self.said(self.edge_mm(band - 1));
                out.push(text("t", [x + SWATCH + 5.0, top + SWATCH + 4.0], &edge));
            }
        }
        out
    }

    /// The bands as rows of a table: what, from, to, points, share in %.
    #[must_use]
    pub fn rows(&self, counts: &[u64; BANDS]) -> Vec<Vec<String>> {
        let all: u64 = counts.iter().sum();
        let names = [
            "below the limits (\u{25bc})",
            "low (\u{2261})",
            "low (=)",
            "low (\u{2212})",
            "middle (no mark)",
            "high (|)",
            "high (||)",
            "high (|||)",
            "above the limits (\u{25b2})",
        ];
        (0..BANDS)
            .rev()
            .map(|band| {
                let from = band.checked_sub(1).map(|k| self.said(self.edge_mm(k)));
                let to = (band < BANDS - 1).then(|| self.said(self.edge_mm(band)));
                vec![
                    names[band].to_owned(),
                    from.unwrap_or_default(),
                    to.unwrap_or_default(),
                    counts[band].to_string(),
                    fixed(100.0 * counts[band] as f64 / all.max(1) as f64, 2),
                ]
            })
            .collect()
    }
}

const SWATCH: f64 = 16.0;

/// A path with a band's marks.
pub fn stroke_path(band: usize, d: &str) -> Element {
    let dark = matches!(band, 0 | 1 | 7 | 8);
    let colour = if dark { "#ffffff" } else { "#1b1f24" };
    let path = el("path").attr("d", d);
    if band == 0 || band == BANDS - 1 {
        path.attr("fill", colour)
    } else {
        path.attr("fill", "none")
            .attr("stroke", colour)
            .attr("stroke-width", 0.9)
    }
}

/// The mark of a band about a place: lying strokes below, standing ones above, triangles beyond the limits.
pub fn strokes(band: usize, [x, y]: [f64; 2], size: f64) -> Option<String> {
    let half = size / 2.0;
    if band == 0 || band == BANDS - 1 {
        let way = if band == 0 { -half } else { half };
        return Some(format!(
            "M{} {}L{} {}L{} {}Z",
            px(x),
            px(y - way),
            px(x - half),
            px(y + way),
            px(x + half),
            px(y + way)
        ));
    }
    let middle = BANDS / 2;
    let count = band.abs_diff(middle);
    let mut path = String::new();
    for k in 0..count {
        let off = (k as f64 - (count as f64 - 1.0) / 2.0) * size * 0.42;
        path += &if band < middle {
            format!("M{} {}h{}", px(x - half), px(y + off), px(size))
        } else {
            format!("M{} {}v{}", px(x + off), px(y - half), px(size))
        };
    }
    (count > 0).then_some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_kept_and_what_is_beyond_is_not() {
        let bands = Bands {
            low_mm: -0.05,
            high_mm: 0.05,
        };
        for (deviation, band) in [
            (-0.0501, 0),
            (-0.05, 1),
            (-0.036, 1),
            (-0.034, 2),
            (-0.006, 3),
            (0.0, 4),
            (0.006, 5),
            (0.034, 6),
            (0.036, 7),
            (0.05, 7),
            (0.0501, 8),
        ] {
            assert_eq!(bands.of(deviation), band, "{deviation}");
        }
        assert_eq!(bands.said(0.035), "+35");
        assert_eq!(bands.said(-0.005), "-5");
        let uneven = Bands {
            low_mm: 0.1,
            high_mm: 0.3,
        };
        assert_eq!(uneven.of(0.2), 4);
        assert_eq!(uneven.of(0.0), 0);
        let large = Bands {
            low_mm: -2.0,
            high_mm: 2.0,
        };
        assert_eq!((large.unit().0, large.said(0.2)), ("mm", "+0.2".into()));
    }

    #[test]
    fn every_band_is_told_apart_without_colour() {
        let marks: std::collections::BTreeSet<_> = (0..BANDS)
            .map(|band| strokes(band, [0.0, 0.0], 4.0))
            .collect();
        assert_eq!(marks.len(), BANDS);
    }
}
