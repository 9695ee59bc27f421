//! The page on a scan path: its maps with their distortion, passes, postures, what they see, and the axes.

mod axes;
mod flat;
mod view;

use crate::draw::markup::{Element, el};
use crate::draw::number::typographic;
use crate::pages::scan::{FigureTable, facts, figure_table};
use crate::pages::session::document_head;

/// A row of the path.
#[derive(Clone, Debug, Default)]
pub struct PlanRow {
    /// Number of the pass, -1 for a link.
    pub pass: i32,
    /// Whether the laser is on.
    pub laser: bool,
    /// Where the middle ray is at the reference distance, on the part, in mm.
    pub tip_mm: [f64; 3],
    /// The middle ray's direction on the part, a unit vector.
    pub beam: [f64; 3],
    /// The axes' values, mm and degrees.
    pub axes: Vec<f64>,
}

/// A point of the surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct SeenPoint {
    /// Where it is on the part, in mm.
    pub at_mm: [f64; 3],
    /// The surface's normal there.
    pub normal: [f64; 3],
    /// How many passes see it.
    pub passes: usize,
}

/// An axis of the machine.
#[derive(Clone, Debug, Default)]
pub struct PlannedAxis {
    /// Its word.
    pub name: String,
    /// "mm" or "°".
    pub unit: &'static str,
    /// Its limits.
    pub limits: [f64; 2],
}

/// What the page shows.
#[derive(Clone, Debug, Default)]
pub struct PlanPage {
    /// The title.
    pub title: String,
    /// The result, first and large.
    pub result: String,
    /// Names and values.
    pub facts: Vec<(&'static str, String)>,
    /// Tables.
    pub tables: Vec<FigureTable>,
    /// What must be known, a line each.
    pub remarks: Vec<String>,
    /// The path, in the order driven.
    pub rows: Vec<PlanRow>,
    /// Points that stand for the surface.
    pub seen: Vec<SeenPoint>,
    /// Triangles of each map, with the length there of a millimetre on the surface.
    pub flat: Vec<Vec<([[f64; 2]; 3], f64)>>,
    /// The axes, in the order of the rows' values.
    pub axes: Vec<PlannedAxis>,
}

/// Maps that a page shows at most, the largest first.
const MAPS: usize = 8;

/// The page as one self-contained HTML file.
#[must_use]
pub fn html(shown: &PlanPage) -> String {
    let card = |drawing: Element, words: &str| {
        el("figure")
            .class("card")
            .child(drawing)
            .child(el("figcaption").text(typographic(words)))
    };
    let mut main = el("main")
        .child(el("h1").text(&shown.title))
        .child(el("p").class("result").text(typographic(&shown.result)));
    if !shown.remarks.is_empty() {
        let remarks = shown.remarks.iter().map(|r| el("li").text(typographic(r)));
        main = main.child(el("ul").class("remarks").children(remarks));
    }
    main = main.child(facts(&shown.facts));
    let views = view::SIDES.iter().map(|side| {
        let words = format!(
            "{}: {}. {}",
            side.name,
            side.axes,
            "Lines: passes with their numbers; broken: links with the laser off; spokes: the beam, towards the sensor. \
             Dots: seen once; rings: seen more than once; crosses: not seen."
        );
        card(view::drawing(side, &shown.rows, &shown.seen), &words)
    });
    main = main.child(
        el("section")
            .child(el("h2").text("Passes, postures and coverage"))
            .children(views),
    );
    let mut largest: Vec<&Vec<_>> = shown.flat.iter().collect();
    largest.sort_by_key(|map| std::cmp::Reverse(map.len()));
    let left_out = largest.len().saturating_sub(MAPS);
    let maps = largest.iter().take(MAPS).enumerate().map(|(k, map)| {
        let words = format!(
            "Map {} of {}, {} triangles. The scale is the length in the plane of a millimetre on the part.",
            k + 1,
            shown.flat.len(),
            map.len()
        );
        card(flat::drawing(map), &words)
    });
    let mut section = el("section")
        .child(el("h2").text("The surface laid flat"))
        .child(el("div").class("row2").children(maps));
    if left_out > 0 {
        section = section.child(el("p").class("note").text(format!(
            "{left_out} maps with fewer triangles are not shown."
        )));
    }
    main = main.child(section).child(
        el("section").child(el("h2").text("Axes")).child(card(
            axes::drawing(&shown.axes, &shown.rows),
            "Each axis over the way of the middle ray's point on the part, links with it. Thick: the laser is on. Red and broken: a limit, where it is near.",
        )),
    );
    let tables = shown
        .tables
        .iter()
        .filter(|t| !t.rows.is_empty())
        .map(figure_table);
    main = main.child(el("div").class("tables").children(tables));
    let page = el("html")
        .attr("lang", "en")
        .child(document_head(&shown.title))
        .child(el("body").child(main));
    format!("<!DOCTYPE html>\n{page}")
}

/// The picture of the path from above, as an SVG file of its own.
#[must_use]
pub fn picture(shown: &PlanPage) -> String {
    let style = Element::style_sheet(include_str!("../style.css"));
    let drawing = view::drawing(&view::SIDES[0], &shown.rows, &shown.seen);
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}",
        drawing.child(style)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> PlanPage {
        let row = |k: i32, pass: i32| PlanRow {
            pass,
            laser: pass >= 0,
            tip_mm: [f64::from(k), f64::from(pass.max(0)) * 14.0, 0.0],
            beam: [0.0, 0.0, -1.0],
            axes: vec![f64::from(k), 0.0, 100.0, f64::from(k) - 8.0],
        };
        let axis = |name: &str, unit, limits| PlannedAxis {
            name: name.into(),
            unit,
            limits,
        };
        PlanPage {
            title: "A <plan>".into(),
            result: "2 passes".into(),
            rows: (0..20)
                .map(|k| row(k, 0))
                .chain([row(20, -1)])
                .chain((0..20).map(|k| row(19 - k, 1)))
                .collect(),
            seen: vec![
                SeenPoint {
                    at_mm: [1.0, 1.0, 0.0],
                    normal: [0.0, 0.0, 1.0],
                    passes: 0,
                },
                SeenPoint {
                    at_mm: [5.0, 1.0, 0.0],
                    normal: [0.0, 0.0, 1.0],
                    passes: 1,
                },
                SeenPoint {
                    at_mm: [9.0, 1.0, 0.0],
                    normal: [0.0, 0.0, 1.0],
                    passes: 2,
                },
            ],
            flat: vec![vec![
                ([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]], 0.9),
                ([[10.0, 0.0], [10.0, 10.0], [0.0, 10.0]], 1.2),
            ]],
            axes: vec![
                axis("X", "mm", [-900.0, 900.0]),
                axis("Y", "mm", [-900.0, 900.0]),
                axis("Z", "mm", [-900.0, 900.0]),
                axis("A", "\u{b0}", [-10.0, 10.0]),
            ],
            ..PlanPage::default()
        }
    }

    #[test]
    fn a_page_shows_passes_maps_and_axes_and_closes_what_it_opens() {
        let text = html(&page());
        for what in [
            "A &lt;plan&gt;",
            "From above",
            "Map 1 of 1",
            "A, \u{b0}",
            "1.13",
        ] {
            assert!(text.contains(what), "{what}");
        }
        for name in ["svg", "figure", "main", "html", "section"] {
            let opened = text.matches(&format!("<{name}")).count();
            assert!(opened > 0, "{name}");
            assert_eq!(
                opened,
                text.matches(&format!("</{name}>")).count(),
                "{name}"
            );
        }
        assert!(!text.contains("NaN") && !text.contains("<script"));
        let file = picture(&page());
        assert!(
            file.starts_with("<?xml")
                && file.contains("<style>")
                && file.trim_end().ends_with("</svg>")
        );
    }
}
