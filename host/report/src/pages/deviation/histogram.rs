//! How often each deviation comes.

use crate::draw::markup::Element;
use crate::draw::scale::ticks;
use crate::draw::svg::{line, picture, rect, text};

use super::DeviationPoint;
use super::bands::{Bands, COLOURS};

const SIZE: [f64; 2] = [900.0, 300.0];
const AREA: [f64; 4] = [70.0, 26.0, 880.0, 252.0];
/// Bars from one limit to the other. Ends of bands are ends of bars.
const WITHIN: usize = 40;
/// Bars beyond each limit.
const BEYOND: usize = 10;
const BARS: usize = WITHIN + 2 * BEYOND;

/// Counts of bars, and of what lies further off on either side.
fn counts<'a>(
    points: impl Iterator<Item = &'a DeviationPoint>,
    bands: &Bands,
) -> ([u64; BARS], [u64; 2]) {
    let (mut bars, mut off) = ([0; BARS], [0; 2]);
    let width = 2.0 * bands.half_mm() / WITHIN as f64;
    for p in points {
        let place = ((p.deviation_mm - bands.low_mm) / width).floor() + BEYOND as f64;
        if place < 0.0 {
            off[0] += 1;
        } else if place >= BARS as f64 {
            off[1] += 1;
        } else {
            bars[place as usize] += 1;
        }
    }
    (bars, off)
}

/// The drawing; `ends`: what the ends of the bands are, where they are to be drawn.
pub fn histogram<'a>(
    points: impl Iterator<Item = &'a DeviationPoint>,
    bands: &Bands,
    ends: [Option<&str>; 2],
) -> Element {
    let [left, top, right, bottom] = AREA;
    let (bars, off) = counts(points, bands);
    let most = bars.iter().copied().max().unwrap_or(0).max(1) as f64;
    let wide = (right - left) / BARS as f64;
    let height = |count: f64| bottom - count / most * (bottom - top);
    let half = bands.half_mm();
    let across = |mm: f64| {
        left + wide * (BEYOND as f64 + (mm - bands.low_mm) / (2.0 * half) * WITHIN as f64)
    };
    let mut out = picture(SIZE[0], SIZE[1], "Histogram of the deviations");
    for tick in ticks(0.0, most, 5).into_iter().filter(|t| t.fract() == 0.0) {
        let y = height(tick);
        out = out.child(line("grid", [left, y], [right, y])).child(text(
            "t end",
            [left - 6.0, y + 4.0],
            &format!("{tick:.0}"),
        ));
    }
    for (k, count) in bars.iter().enumerate().filter(|(_, count)| **count > 0) {
        let x = left + k as f64 * wide;
        let middle = bands.low_mm + (k as f64 - BEYOND as f64 + 0.5) * 2.0 * half / WITHIN as f64;
        // A bar of one point among millions is still seen.
        let y = height(*count as f64).min(bottom - 1.0);
        out = out.child(
            rect("", [x, y], [x + wide - 1.0, bottom])
                .attr("fill", COLOURS[bands.of(middle)])
                .attr("stroke", "var(--muted)")
                .attr("stroke-width", 0.4),
        );
    }
    out = out.child(line("axis", [left, bottom], [right, bottom]));
    for edge in [bands.low_mm, bands.middle_mm(), bands.high_mm] {
        let x = across(edge);
        let said = format!("{} {}", bands.said(edge), bands.unit().0);
        out = out
            .child(line("axis", [x, bottom], [x, bottom + 5.0]))
            .child(text("t mid", [x, bottom + 18.0], &said));
    }
    for (edge, name) in [bands.low_mm, bands.high_mm].into_iter().zip(ends) {
        if let Some(name) = name {
            let x = across(edge);
            out = out.child(line("limit", [x, top], [x, bottom])).child(text(
                "t mid",
                [x, top - 8.0],
                name,
            ));
        }
    }
    for (count, x, class, way) in [
        (off[0], left, "t", "\u{2190}"),
        (off[1], right, "t end", "\u{2192}"),
    ] {
        if count > 0 {
            let said = format!("{way} {count} further off");
            out = out.child(text(class, [x, bottom + 36.0], &said));
        }
    }
    out.child(text("t", [8.0, 14.0], "points"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_in_one_bar_or_further_off() {
        let bands = Bands {
            low_mm: -0.1,
            high_mm: 0.1,
        };
        let points: Vec<DeviationPoint> = (-200..200)
            .map(|k| DeviationPoint {
                at_mm: [0.0; 3],
                deviation_mm: (f64::from(k) + 0.5) * 1e-3,
                outward: [0.0, 0.0, 1.0],
            })
            .collect();
        let (bars, off) = counts(points.iter(), &bands);
        assert!(bars.iter().all(|n| *n == 5), "{bars:?}");
        assert_eq!(off, [50, 50]);
        let text = histogram(points.iter(), &bands, super::super::LIMITS).to_string();
        assert!(text.contains("50 further off") && text.contains("upper limit"));
    }
}
