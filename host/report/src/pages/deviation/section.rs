//! A section: the nominal where a plane cuts it, and the points beside that plane.

use crate::draw::markup::{Element, el};
use crate::draw::number::fixed;
use crate::draw::scale::{Magnified, PlanView, bar, length_text, nice_below};
use crate::draw::svg::{circle, picture, px, text};

use super::DeviationPoint;
use super::bands::{Bands, COLOURS};

const SIZE: [f64; 2] = [640.0, 420.0];
const MAP: [f64; 2] = [540.0, 380.0];
const MARGIN: f64 = 46.0;
/// Points that a section shows at most.
const SHOWN: usize = 2500;
/// A surface that looks out of the plane more than this has no deviation within it.
const WITHIN: f64 = 0.5;

/// Where a plane across an axis cuts.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// Across which axis: 0 X, 1 Y, 2 Z.
    pub axis: usize,
    /// Where on it, in mm.
    pub at_mm: f64,
    /// The nominal in it.
    pub lines: Vec<[[f64; 3]; 2]>,
}

/// A drawing with its words; none where no point is near.
pub fn section(
    of: &Section,
    points: &[DeviationPoint],
    bands: &Bands,
    diagonal_mm: f64,
) -> Option<(Element, String)> {
    // The thinnest slice with enough points to see a line.
    let mut half_mm = diagonal_mm * 5e-4;
    let near = |half: f64| {
        points
            .iter()
            .filter(move |p| (p.at_mm[of.axis] - of.at_mm).abs() <= half)
            .filter(|p| f64::from(p.outward[of.axis]).abs() < WITHIN)
    };
    while near(half_mm).take(800).count() < 800 && half_mm < diagonal_mm * 0.01 {
        half_mm *= 2.0;
    }
    let count = near(half_mm).count();
    if count == 0 {
        return None;
    }
    let (right, up) = [(1, 2), (0, 2), (0, 1)][of.axis];
    let flat = |p: &[f64; 3]| [p[right], p[up]];
    let foot = |p: &DeviationPoint| -> [f64; 3] {
        std::array::from_fn(|i| p.at_mm[i] - f64::from(p.outward[i]) * p.deviation_mm)
    };
    let mut all: Vec<[f64; 2]> = near(half_mm).map(|p| flat(&foot(p))).collect();
    all.extend(of.lines.iter().flatten().map(flat));
    let plan = PlanView::fit(&all, [0.0, 0.0], MAP, MARGIN);
    let within = near(half_mm).fold(0.0_f64, |most, p| most.max(p.deviation_mm.abs()));
    let largest = within.min(3.0 * bands.low_mm.abs().max(bands.high_mm.abs()));
    let magnified = Magnified::for_largest(largest, MARGIN - 10.0, plan.scale);
    let name = format!(
        "Section {} = {} mm",
        ["X", "Y", "Z"][of.axis],
        fixed(of.at_mm, 3)
    );
    let mut out = picture(SIZE[0], SIZE[1], &name);
    let mut nominal = String::new();
    for [a, b] in &of.lines {
        let ([xa, ya], [xb, yb]) = (flat(a), flat(b));
        let ([xa, ya], [xb, yb]) = (plan.at(xa, ya), plan.at(xb, yb));
        nominal += &format!("M{} {}L{} {}", px(xa), px(ya), px(xb), px(yb));
    }
    if !nominal.is_empty() {
        out = out.child(
            el("path")
                .attr("d", nominal)
                .attr("fill", "none")
                .attr("stroke", "var(--ink)")
                .attr("stroke-width", 1),
        );
    }
    let mut spokes = String::new();
    let mut dots = Vec::new();
    for p in near(half_mm).step_by(count.div_ceil(SHOWN)) {
        let [x, y] = flat(&foot(p));
        let [x, y] = plan.at(x, y);
        let length = p.deviation_mm.clamp(-largest, largest) * magnified.px_per_mm;
        let (u, v) = (f64::from(p.outward[right]), f64::from(p.outward[up]));
        let end = [x + u * length, y - v * length];
        spokes += &format!("M{} {}L{} {}", px(x), px(y), px(end[0]), px(end[1]));
        dots.push(
            circle("", end, 1.5)
                .attr("fill", COLOURS[bands.of(p.deviation_mm)])
                .attr("stroke", "var(--ink)")
                .attr("stroke-width", 0.3),
        );
    }
    out = out
        .child(
            el("path")
                .attr("d", spokes)
                .attr("fill", "none")
                .attr("stroke", "var(--muted)")
                .attr("stroke-width", 0.5),
        )
        .children(dots);
    let base = SIZE[1] - 14.0;
    let length = nice_below(MAP[0] / 4.0 / plan.scale);
    out = out
        .children(bar("bar", [12.0, base], length, plan.scale))
        .child(text(
            "t muted",
            [210.0, base + 4.0],
            [
                "Y to the right, Z up",
                "X to the right, Z up",
                "X to the right, Y up",
            ][of.axis],
        ))
        .children(bands.legend([MAP[0] + 16.0, 24.0]));
    let bar_mm = magnified.bar_mm(36.0);
    out = out
        .child(text("t", [MAP[0] + 16.0, 210.0], "deviations"))
        .children(bar(
            "bar",
            [MAP[0] + 16.0, 226.0],
            bar_mm,
            magnified.px_per_mm,
        ));
    let mut words = format!(
        "{name}: {count} points within {} of the plane. From the nominal outward, deviations are {}.",
        length_text(half_mm),
        magnified.stated()
    );
    if within > largest {
        words += &format!(
            " Those beyond {} are drawn at that length.",
            length_text(largest)
        );
    }
    Some((out, words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_shows_the_points_beside_its_plane() {
        let bands = Bands {
            low_mm: -0.1,
            high_mm: 0.1,
        };
        let point = |k: u32, z: f64| DeviationPoint {
            at_mm: [f64::from(k), 0.0, z],
            deviation_mm: 0.05,
            outward: [0.0, -1.0, 0.0],
        };
        let points: Vec<_> = (0..100)
            .map(|k| point(k, if k % 2 == 0 { 5.0 } else { 90.0 }))
            .collect();
        let at = |at_mm: f64| Section {
            axis: 2,
            at_mm,
            lines: vec![[[0.0, 0.0, at_mm], [100.0, 0.0, at_mm]]],
        };
        let (drawing, words) = section(&at(5.0), &points, &bands, 130.0).unwrap();
        assert_eq!(drawing.to_string().matches("<circle").count(), 50);
        assert!(
            words.contains("50 points") && words.contains("Z = 5.000 mm"),
            "{words}"
        );
        assert!(section(&at(40.0), &points, &bands, 130.0).is_none());
    }
}
