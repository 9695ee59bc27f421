//! A surface laid flat, with its scale.

use crate::draw::markup::{Element, el};
use crate::draw::number::fixed;
use crate::draw::scale::{PlanView, bar, nice_below};
use crate::draw::svg::{picture, px, rect, text};

const SIZE: [f64; 2] = [640.0, 420.0];
const MAP: [f64; 2] = [540.0, 384.0];
const MARGIN: f64 = 12.0;
/// From short to long, from light to dark: also without colour.
const SHADES: [&str; 5] = ["#f1eef6", "#bdc9e1", "#74a9cf", "#2b8cbe", "#045a8d"];
/// More triangles than these are drawn by their middles, in cells.
const DRAWN: usize = 5000;
const CELL: f64 = 4.0;

/// The map.
pub fn drawing(triangles: &[([[f64; 2]; 3], f64)]) -> Element {
    let corners: Vec<[f64; 2]> = triangles.iter().flat_map(|(t, _)| *t).collect();
    let plan = PlanView::fit(&corners, [0.0, 0.0], MAP, MARGIN);
    let (low, high) = triangles
        .iter()
        .map(|(_, scale)| *scale)
        .filter(|scale| scale.is_finite() && *scale > 0.0)
        .fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s), h.max(s)));
    let steps = SHADES.len() as f64;
    let ratio = (high / low).max(1.0 + 1e-9);
    let shade = |scale: f64| {
        let share = (scale / low).ln() / ratio.ln() * steps;
        (share.max(0.0) as usize).min(SHADES.len() - 1)
    };
    let mut paths: [String; SHADES.len()] = Default::default();
    if triangles.len() <= DRAWN {
        for (t, scale) in triangles {
            let [a, b, c] = t.map(|p| plan.at(p[0], p[1]));
            paths[shade(*scale)] += &format!(
                "M{} {}L{} {}L{} {}z",
                px(a[0]),
                px(a[1]),
                px(b[0]),
                px(b[1]),
                px(c[0]),
                px(c[1])
            );
        }
    } else {
        let mut cells = std::collections::BTreeMap::new();
        for (t, scale) in triangles {
            let middle: [f64; 2] = [0, 1].map(|i| t.iter().map(|p| p[i]).sum::<f64>() / 3.0);
            let [x, y] = plan.at(middle[0], middle[1]);
            let cell = cells
                .entry(((y / CELL) as i32, (x / CELL) as i32))
                .or_insert((0.0, 0.0));
            *cell = (cell.0 + scale, cell.1 + 1.0);
        }
        for ((row, column), (sum, n)) in cells {
            let (x, y) = (f64::from(column) * CELL, f64::from(row) * CELL);
            paths[shade(sum / n)] += &format!("M{} {}h{CELL}v{CELL}h-{CELL}z", px(x), px(y));
        }
    }
    let mut out = picture(SIZE[0], SIZE[1], "The surface laid flat, with its scale");
    for (d, shade) in paths.iter().zip(SHADES).filter(|(d, _)| !d.is_empty()) {
        out = out.child(
            el("path")
                .attr("d", d)
                .attr("fill", shade)
                .attr("stroke", shade)
                .attr("stroke-width", 0.4),
        );
    }
    let x = MAP[0] + 16.0;
    out = out.child(text("t b", [x, 24.0], "scale"));
    for (k, shade) in SHADES.iter().enumerate().rev() {
        let top = 32.0 + (SHADES.len() - 1 - k) as f64 * 18.0;
        let from = low * ratio.powf(k as f64 / steps);
        let swatch =
            rect("frame", [x, top], [x + 18.0, top + 18.0]).attr("style", format!("fill:{shade}"));
        out = out
            .child(swatch)
            .child(text("t", [x + 24.0, top + 22.0], &fixed(from, 3)));
        if k == SHADES.len() - 1 {
            out = out.child(text("t", [x + 24.0, top + 4.0], &fixed(high, 3)));
        }
    }
    let length = nice_below(MAP[0] / 4.0 / plan.scale);
    out.children(bar("bar", [12.0, SIZE[1] - 14.0], length, plan.scale))
}
