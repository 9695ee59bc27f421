//! Scales: from millimetres to picture coordinates, magnified where errors are
//! to be seen, and always with a scale bar that says so.

use crate::draw::markup::Element;
use crate::draw::number;
use crate::draw::svg;

/// The largest of 1, 2, 5 times a power of ten that is not above `value`.
#[must_use]
pub fn nice_below(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let decade = 10f64.powi(floor_log10(value));
    [5.0, 2.0, 1.0]
        .into_iter()
        .map(|m| m * decade)
        .find(|nice| *nice <= value * (1.0 + 1e-9))
        .unwrap_or(decade)
}

/// The same with finer steps, for magnifications.
fn round_below(value: f64) -> f64 {
    let nice = nice_below(value);
    // 1, 1.2, 1.5, 2, 2.4, 3, 5, 6, 7.5: all easy to reckon with.
    [1.5, 1.2]
        .into_iter()
        .map(|m| m * nice)
        .find(|round| *round <= value)
        .unwrap_or(nice)
}

#[allow(clippy::cast_possible_truncation, reason = "between -308 and 308")]
fn floor_log10(value: f64) -> i32 {
    // The tiny addition keeps 1000 from becoming 999.99..., so one decade less.
    (value.log10() + 1e-9).floor() as i32
}

/// Ticks at nice steps, about `most` of them, within the two bounds.
#[must_use]
pub fn ticks(from: f64, to: f64, most: u32) -> Vec<f64> {
    let span = to - from;
    if !(span.is_finite() && span > 0.0) {
        return Vec::new();
    }
    let rough = span / f64::from(most.max(1));
    let mut step = nice_below(rough);
    if step < rough * (1.0 - 1e-9) {
        // The next larger nice number: 1 to 2, 2 to 5, 5 to 10.
        step = [2.0, 2.5, 5.0, 10.0]
            .into_iter()
            .map(|m| nice_below(step * m))
            .find(|larger| *larger >= rough)
            .unwrap_or(step * 2.0);
    }
    let mut at = (from / step).ceil();
    let mut ticks = Vec::new();
    while at * step <= to + step * 1e-6 && ticks.len() < 50 {
        ticks.push(at * step);
        at += 1.0;
    }
    ticks
}

/// A plan view: equal scales on both axes, up is up.
#[derive(Clone, Copy, Debug)]
pub struct PlanView {
    /// Picture coordinates of the middle of the data.
    middle_px: [f64; 2],
    /// The middle of the data, mm.
    middle_mm: [f64; 2],
    /// px per mm.
    pub scale: f64,
}

impl PlanView {
    /// Fits points into a box with a margin on each side. Points that are not
    /// finite do not count.
    #[must_use]
    pub fn fit(points_mm: &[[f64; 2]], corner: [f64; 2], size: [f64; 2], margin: f64) -> Self {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for p in points_mm.iter().filter(|p| p.iter().all(|c| c.is_finite())) {
            for i in 0..2 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        let middle_px = [corner[0] + size[0] / 2.0, corner[1] + size[1] / 2.0];
        // Without a point the bounds are still infinite.
        if low[0].is_infinite() {
            return Self {
                middle_px,
                middle_mm: [0.0; 2],
                scale: 1.0,
            };
        }
        let scale = (0..2)
            .map(|i| (size[i] - 2.0 * margin) / (high[i] - low[i]).max(1e-6))
            .fold(f64::INFINITY, f64::min);
        Self {
            middle_px,
            middle_mm: std::array::from_fn(|i| f64::midpoint(low[i], high[i])),
            scale,
        }
    }

    /// Where a point is drawn.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [
            self.middle_px[0] + (x - self.middle_mm[0]) * self.scale,
            self.middle_px[1] - (y - self.middle_mm[1]) * self.scale,
        ]
    }

    /// The data at a place of the picture: the inverse of [`Self::at`].
    #[must_use]
    pub fn data_at(&self, px: [f64; 2]) -> [f64; 2] {
        [
            self.middle_mm[0] + (px[0] - self.middle_px[0]) / self.scale,
            self.middle_mm[1] - (px[1] - self.middle_px[1]) / self.scale,
        ]
    }
}

/// Magnified errors: how many px show one mm of error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnified {
    /// px per mm of error.
    pub px_per_mm: f64,
    /// Times true to scale.
    pub times: f64,
}

impl Magnified {
    /// A round magnification that shows `largest_mm` with at most `room_px`,
    /// in a picture drawn with `scale` px per mm.
    #[must_use]
    pub fn for_largest(largest_mm: f64, room_px: f64, scale: f64) -> Self {
        // Below 0.1 µm there is nothing to see on any machine tool.
        let largest = if largest_mm.is_finite() {
            largest_mm.max(1e-4)
        } else {
            1.0
        };
        let times = round_below(room_px / largest / scale);
        Self {
            px_per_mm: times * scale,
            times,
        }
    }

    /// In words: "magnified ×500", "true to scale", "reduced 1:2".
    #[must_use]
    pub fn stated(&self) -> String {
        if self.times == 1.0 {
            "true to scale".into()
        } else if self.times >= 1.0 {
            format!("magnified \u{d7}{}", grouped(self.times))
        } else {
            format!("reduced 1:{}", grouped(1.0 / self.times))
        }
    }

    /// A round length in mm that is drawn with at most `most_px`.
    #[must_use]
    pub fn bar_mm(&self, most_px: f64) -> f64 {
        nice_below(most_px / self.px_per_mm)
    }
}

/// A whole number with thin spaces between groups of three.
fn grouped(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) && digits.len() > 4 {
            out.push('\u{2009}');
        }
        out.push(c);
    }
    out
}

/// A length with its unit: µm below 1 mm.
#[must_use]
pub fn length_text(mm: f64) -> String {
    let (value, unit) = if mm < 0.9995 {
        (mm * 1e3, "\u{b5}m")
    } else {
        (mm, "mm")
    };
    let decimals = if value < 0.995 { 1 } else { 0 };
    format!("{} {unit}", number::fixed(value, decimals))
}

/// A scale bar with its length; gives the drawing and its width.
pub fn bar(class: &str, at: [f64; 2], length_mm: f64, px_per_mm: f64) -> Vec<Element> {
    let [x, y] = at;
    let width = length_mm * px_per_mm;
    vec![
        svg::line(class, [x, y], [x + width, y]),
        svg::line(class, [x, y - 3.5], [x, y + 3.5]),
        svg::line(class, [x + width, y - 3.5], [x + width, y + 3.5]),
        svg::text("t", [x + width + 5.0, y + 4.0], &length_text(length_mm)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Magnifications and ticks are the numbers that people read.
    #[test]
    fn nice_numbers() {
        for (value, nice) in [
            (658.0, 500.0),
            (1000.0, 1000.0),
            (0.0199, 0.01),
            (49.9, 20.0),
        ] {
            assert!((nice_below(value) - nice).abs() < 1e-9 * nice, "{value}");
        }
        assert_eq!(nice_below(f64::NAN), 1.0);
        assert_eq!(
            ticks(-30.0, 30.0, 6),
            [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]
        );
        assert!(ticks(f64::NAN, 1.0, 4).is_empty());
        let step = ticks(0.0, 350.0, 4);
        assert_eq!(step, [0.0, 100.0, 200.0, 300.0]);
    }

    /// What is drawn can be measured back, and up is up.
    #[test]
    fn a_plan_keeps_shape_and_direction() {
        let corners = [[0.0, 0.0], [300.0, 100.0], [f64::NAN, 1e9]];
        let plan = PlanView::fit(&corners, [10.0, 20.0], [200.0, 100.0], 10.0);
        assert!((plan.scale - 0.6).abs() < 1e-12);
        assert_eq!(plan.at(0.0, 0.0), [20.0, 100.0]);
        let back = plan.data_at(plan.at(12.0, 34.0));
        assert!((back[0] - 12.0).abs() < 1e-9 && (back[1] - 34.0).abs() < 1e-9);
    }

    /// The bar has the length that it states.
    #[test]
    fn a_scale_bar_is_as_long_as_it_says() {
        let magnified = Magnified::for_largest(0.0068, 28.0, 5.0);
        assert_eq!(magnified.times, 750.0);
        let bar_mm = magnified.bar_mm(60.0);
        assert_eq!(length_text(bar_mm), "10 \u{b5}m");
        let drawn = bar("bar", [0.0, 0.0], bar_mm, magnified.px_per_mm);
        assert!(drawn[0].to_string().contains("x2=\"37.5\""), "{}", drawn[0]);
    }
}
