//! A page that shows two tool paths, one over the other, and how far they are apart.

use std::fmt::Write as _;

use umi_core::registration::RigidTransform;
use umi_core::units::Point;

use crate::draw::markup::{Element, el};
use crate::draw::number::fixed;
use crate::draw::scale::{PlanView, bar, length_text, nice_below, ticks};
use crate::draw::svg::{circle, line, picture, px, text};
use crate::pages::session::document_head;
use umi_client::files::tool_path::diff::{Move, PathDifference};

const SIZE: [f64; 2] = [560.0, 420.0];
const MARGIN: f64 = 32.0;
/// The chart: left, top, right, bottom of its area.
const AREA: [f64; 4] = [64.0, 14.0, 550.0, 190.0];

type V = nalgebra::Vector3<f64>;

/// The page as one self-contained HTML file; `result` stands first and large, `facts` are
/// shown as they are.
#[must_use]
pub fn html(
    title: &str,
    result: &str,
    facts: &[(String, String)],
    first: &[Move],
    second: &[Move],
    transform: &RigidTransform,
    difference: &PathDifference,
) -> String {
    let image = |p: V| transform.apply(Point { mm: p }).mm;
    let wanted = cuts(first, image);
    let made = cuts(second, |p| p);
    let verdict = if difference.is_complete() {
        "result"
    } else {
        "result ng"
    };
    let main = el("main")
        .child(el("h1").text(title))
        .child(el("p").class(verdict).text(result));
    let mut main = main.child(
        el("dl").children(
            facts
                .iter()
                .flat_map(|(name, value)| [el("dt").text(name), el("dd").text(value)]),
        ),
    );
    let figure = |drawn, caption: String| {
        el("figure")
            .class("card")
            .child(drawn)
            .child(el("figcaption").text(caption))
    };
    main = main.child(figure(
        deviations(difference),
        "How far each motion is from its image, over the motions of the first program. Dots: \
         ends; bars: the whole way of a cut, chords included."
            .to_owned(),
    ));
    for (name, axes) in [
        ("From above: X to the right, Y up", [0, 1]),
        ("From the front: X to the right, Z up", [0, 2]),
    ] {
        main = main.child(figure(
            view(name, axes, &wanted, &made, difference),
            format!(
                "{name}. Wide: the first program, carried by the transform; narrow: the second; \
                 rapids are left out; the ring is where a cut deviates most."
            ),
        ));
    }
    let page = el("html")
        .attr("lang", "en")
        .child(document_head(title))
        .child(el("body").child(main));
    format!("<!DOCTYPE html>\n{page}")
}

/// The ways of all cuts, drawn in straight pieces.
fn cuts(moves: &[Move], carried: impl Fn(V) -> V) -> Vec<Vec<V>> {
    let cuts = moves.iter().filter(|made| made.is_feed && !made.is_away());
    cuts.map(|cut| {
        let pieces = cut.pieces();
        let part = |piece| f64::from(piece) / f64::from(pieces);
        let places = (0..=pieces).map(|piece| carried(cut.at(part(piece))));
        places.collect()
    })
    .collect()
}

fn view(
    name: &str,
    [right, up]: [usize; 2],
    wanted: &[Vec<V>],
    made: &[Vec<V>],
    difference: &PathDifference,
) -> Element {
    let flat = |p: &V| [p[right], p[up]];
    let places: Vec<[f64; 2]> = wanted.iter().chain(made).flatten().map(flat).collect();
    let mut out = picture(SIZE[0], SIZE[1], name);
    if places.is_empty() {
        return out.child(text("t", [MARGIN, MARGIN], "nothing is cut"));
    }
    let plan = PlanView::fit(&places, [0.0, 0.0], SIZE, MARGIN);
    for (class, ways, width) in [("var(--blue)", wanted, 3.5), ("var(--ng)", made, 0.8)] {
        let mut drawn = String::new();
        for way in ways {
            for (number, place) in way.iter().enumerate() {
                let [x, y] = flat(place);
                let [x, y] = plan.at(x, y);
                let code = if number == 0 { 'M' } else { 'L' };
                // Writing to a String cannot fail.
                let _ = write!(drawn, "{code}{} {}", px(x), px(y));
            }
        }
        out = out.child(
            el("path")
                .attr("d", drawn)
                .attr("fill", "none")
                .attr("stroke", class)
                .attr("stroke-opacity", if width > 1.0 { "0.45" } else { "1" })
                .attr("stroke-width", px(width)),
        );
    }
    if let Some(largest) = &difference.largest_way {
        let at = plan.at(largest.at_mm[right], largest.at_mm[up]);
        out = out.child(
            circle("", at, 7.0)
                .attr("fill", "none")
                .attr("stroke", "var(--orange)")
                .attr("stroke-width", 2),
        );
    }
    for (axis, letter) in [(right, "X"), (up, if up == 1 { "Y" } else { "Z" })] {
        let along = places.iter().map(|place| place[usize::from(axis != right)]);
        let low = along.clone().fold(f64::INFINITY, f64::min);
        let high = along.fold(f64::NEG_INFINITY, f64::max);
        for tick in ticks(low, high, 5) {
            let said = fixed(tick, if high - low < 5.0 { 2 } else { 0 });
            out = if axis == right {
                let [x, _] = plan.at(tick, 0.0);
                out.child(line("axis", [x, 0.0], [x, 5.0]))
                    .child(text("t mid", [x, 16.0], &said))
            } else {
                let [_, y] = plan.at(0.0, tick);
                out.child(line("axis", [0.0, y], [5.0, y]))
                    .child(text("t", [8.0, y + 4.0], &said))
            };
        }
        let at = if axis == right {
            [SIZE[0] - 36.0, 16.0]
        } else {
            [8.0, 30.0]
        };
        out = out.child(text("t muted", at, &format!("{letter} mm")));
    }
    let length = nice_below(90.0 / plan.scale);
    out.children(bar("bar", [12.0, SIZE[1] - 14.0], length, plan.scale))
}

/// Deviations over the motions.
fn deviations(difference: &PathDifference) -> Element {
    let [left, top, right, bottom] = AREA;
    let all = &difference.deviations;
    let mut out = picture(
        SIZE[0],
        bottom + 24.0,
        "Deviation of each motion from its image",
    );
    let most = all
        .iter()
        .map(|d| d.end_mm.max(d.way_mm))
        .fold(1e-4, f64::max);
    let height = |mm: f64| bottom - mm / most * (bottom - top);
    for tick in ticks(0.0, most, 6) {
        let y = height(tick);
        out = out
            .child(line("grid", [left, y], [right, y]).attr("stroke", "var(--rule)"))
            .child(text("t", [8.0, y + 4.0], &length_text(tick)));
    }
    let place =
        |number: usize| left + (number as f64 + 0.5) / all.len().max(1) as f64 * (right - left);
    let mut way = String::new();
    for (number, deviation) in all.iter().enumerate() {
        let (x, y) = (px(place(number)), px(height(deviation.way_mm)));
        // Writing to a String cannot fail.
        let _ = write!(way, "M{x} {}V{y}", px(bottom));
    }
    out = out.child(
        el("path")
            .attr("d", way)
            .attr("fill", "none")
            .attr("stroke", "var(--orange)")
            .attr("stroke-width", 1),
    );
    // As many dots as can be told apart: of neighbours the largest.
    let together = all.len().div_ceil(1000).max(1);
    for (number, some) in all.chunks(together).enumerate() {
        let end_mm = some.iter().map(|d| d.end_mm).fold(0.0, f64::max);
        let at = [place(number * together), height(end_mm)];
        out = out.child(circle("", at, 1.8).attr("fill", "var(--blue)"));
    }
    out.child(text(
        "t",
        [left, bottom + 18.0],
        &format!(
            "{} motions, in the order of the first program; mm up",
            all.len()
        ),
    ))
}
