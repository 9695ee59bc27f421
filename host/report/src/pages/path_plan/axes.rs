//! What each axis does along the path.

use crate::draw::markup::{Element, el};
use crate::draw::number::fixed;
use crate::draw::scale::ticks;
use crate::draw::svg::{line, picture, px, text};

use super::{PlanRow, PlannedAxis};

const WIDTH: f64 = 900.0;
const PANEL: f64 = 120.0;
const AREA: [f64; 2] = [86.0, 884.0];
/// Rows that a diagram shows at most.
const SHOWN: usize = 3000;

/// All diagrams, one above the other.
pub fn drawing(axes: &[PlannedAxis], rows: &[PlanRow]) -> Element {
    let mut way = Vec::with_capacity(rows.len());
    let mut sum = 0.0;
    for (k, row) in rows.iter().enumerate() {
        if k > 0 {
            let squares: f64 = (0..3)
                .map(|i| (row.tip_mm[i] - rows[k - 1].tip_mm[i]).powi(2))
                .sum();
            sum += squares.sqrt();
        }
        way.push(sum);
    }
    let height = PANEL * axes.len() as f64 + 30.0;
    let mut out = picture(WIDTH, height, "The axes along the path");
    let total = sum.max(1e-9);
    let across = |mm: f64| AREA[0] + mm / total * (AREA[1] - AREA[0]);
    for (number, axis) in axes.iter().enumerate() {
        let top = PANEL * number as f64 + 14.0;
        let bottom = top + PANEL - 26.0;
        let values = rows.iter().filter_map(|row| row.axes.get(number).copied());
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        if !low.is_finite() {
            continue;
        }
        let room = ((high - low) * 0.08).max(0.5);
        let (low, high) = (low - room, high + room);
        let up = |v: f64| bottom - (v - low) / (high - low) * (bottom - top);
        for tick in ticks(low, high, 4) {
            let y = up(tick);
            out = out
                .child(line("grid", [AREA[0], y], [AREA[1], y]))
                .child(text(
                    "t end",
                    [AREA[0] - 5.0, y + 4.0],
                    &fixed(tick, if high - low < 4.0 { 1 } else { 0 }),
                ));
        }
        for limit in axis.limits.into_iter().filter(|l| (low..=high).contains(l)) {
            out = out.child(line("limit", [AREA[0], up(limit)], [AREA[1], up(limit)]));
        }
        let (mut on, mut off) = (String::new(), String::new());
        let every = rows.len().div_ceil(SHOWN).max(1);
        let shown: Vec<usize> = (0..rows.len())
            .filter(|k| k % every == 0 || k + 1 == rows.len() || !rows[*k].laser)
            .collect();
        for pair in shown.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let (Some(u), Some(v)) = (rows[a].axes.get(number), rows[b].axes.get(number)) else {
                continue;
            };
            let scans = rows[a].laser && rows[b].laser && rows[a].pass == rows[b].pass;
            let path = if scans { &mut on } else { &mut off };
            *path += &format!(
                "M{} {}L{} {}",
                px(across(way[a])),
                px(up(*u)),
                px(across(way[b])),
                px(up(*v))
            );
        }
        for (d, width, stroke) in [(off, 0.8, "var(--muted)"), (on, 2.0, "var(--blue)")] {
            out = out.child(
                el("path")
                    .attr("d", d)
                    .attr("fill", "none")
                    .attr("stroke", stroke)
                    .attr("stroke-width", width),
            );
        }
        out = out.child(text(
            "t b",
            [4.0, top + 6.0],
            &format!("{}, {}", axis.name, axis.unit),
        ));
    }
    let base = height - 22.0;
    out = out.child(line("axis", [AREA[0], base], [AREA[1], base]));
    for tick in ticks(0.0, total, 8) {
        let x = across(tick);
        out = out
            .child(line("axis", [x, base], [x, base + 4.0]))
            .child(text("t mid", [x, base + 16.0], &fixed(tick, 0)));
    }
    out.child(text("t", [4.0, base + 16.0], "way, mm"))
}
