//! The page on a scan beside its nominal: maps, sections, a histogram, figures, and a view that turns.

mod bands;
mod histogram;
mod map;
mod section;
mod turning;

use crate::draw::markup::el;
use crate::draw::number::typographic;
use crate::draw::scale::length_text;
use crate::pages::scan::{FigureTable, facts, figure_table};
use crate::pages::session::document_head_with;

pub use bands::Bands;
pub use section::Section;

/// A point of a scan and what it misses by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviationPoint {
    /// Where it is, in mm.
    pub at_mm: [f64; 3],
    /// Its signed distance from the nominal in mm, positive outside.
    pub deviation_mm: f64,
    /// The direction in which that grows, of length 1; zero for what is seen from all sides, as a whole ball.
    pub outward: [f32; 3],
}

/// A point that each map marks on whose side its surface is.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkedSpot {
    /// The point.
    pub of: DeviationPoint,
    /// What stands beside the mark.
    pub says: String,
}

/// Some of the points, with a histogram of their own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointGroup {
    /// What they are called.
    pub name: String,
    /// Their numbers.
    pub points: Vec<usize>,
}

/// Ends of bands that are limits which somebody has set.
pub const LIMITS: [Option<&str>; 2] = [Some("lower limit"), Some("upper limit")];

/// What the page shows.
#[derive(Clone, Debug, Default)]
pub struct DeviationPage {
    /// The title.
    pub title: String,
    /// The result, first and large.
    pub result: String,
    /// Whether it is a good one.
    pub ok: bool,
    /// Names and values.
    pub facts: Vec<(&'static str, String)>,
    /// Tables.
    pub tables: Vec<FigureTable>,
    /// What must be known of the scan, a line each.
    pub remarks: Vec<String>,
    /// The points. All must be finite.
    pub points: Vec<DeviationPoint>,
    /// Where the colours change.
    pub bands: Bands,
    /// What the ends of the bands are, the lower first, where they are to be drawn.
    pub ends: [Option<&'static str>; 2],
    /// Points that have a histogram of their own beside that of all.
    pub groups: Vec<PointGroup>,
    /// Points that are marked on the maps.
    pub spots: Vec<MarkedSpot>,
    /// Sections; without any the page has no place for them.
    pub sections: Vec<Section>,
}

/// The page as one self-contained HTML file.
#[must_use]
pub fn html(shown: &DeviationPage) -> String {
    let class = if shown.ok { "result" } else { "result ng" };
    let mut counts = [0_u64; bands::BANDS];
    for p in &shown.points {
        counts[shown.bands.of(p.deviation_mm)] += 1;
    }
    let unit = shown.bands.unit().0;
    let by_band = FigureTable {
        caption: format!("Points in each band; from and to in {unit}"),
        heads: vec!["band (mark)", "from", "to", "points", "share, %"],
        rows: shown.bands.rows(&counts),
    };
    let card = |drawing, words: &str| {
        el("figure")
            .class("card")
            .child(drawing)
            .child(el("figcaption").text(typographic(words)))
    };
    let made = turning::view(&shown.points, &shown.bands);
    let thinned = match (made.every_within, made.every_beyond) {
        (1, 1) => format!("All {} points.", made.n),
        (within, beyond) => format!(
            "{} points of {}: {} within the limits, {} beyond them.",
            made.n,
            shown.points.len(),
            each(within),
            each(beyond)
        ),
    };
    let turning = el("section").child(el("h2").text("All around")).child(
        el("figure")
            .class("card")
            .child(made.view)
            .child(el("figcaption").attr("id", "view-says").text(format!(
                "{thinned} Drag to turn, drag with Shift to shift, wheel or + and - to zoom, double click to begin again; the arrow keys turn, too. \
                 Points whose surface looks away are not drawn. The marks show when points are large enough."
            ))),
    );
    let mut maps = el("div").class("row2");
    let mut unseen = Vec::new();
    for side in &map::SIDES {
        match map::map(side, &shown.points, &shown.bands, &shown.spots) {
            Some(made) => {
                let words = format!(
                    "{}: {}. A cell of {} shows the mean deviation of the points that face this side and lie in front: {} points.",
                    side.name,
                    side.axes,
                    length_text(made.cell_mm),
                    made.shown
                );
                maps = maps.child(card(made.drawing, &words));
            }
            None => unseen.push(side.name.to_lowercase()),
        }
    }
    let mut maps = el("section").child(el("h2").text("Maps")).child(maps);
    if !unseen.is_empty() {
        let note = format!(
            "No point's surface faces the side seen {}.",
            unseen.join(", ")
        );
        maps = maps.child(el("p").class("note").text(note));
    }
    let diagonal = diagonal_mm(&shown.points);
    let mut cuts = el("div").class("row2");
    let mut empty = Vec::new();
    for of in &shown.sections {
        match section::section(of, &shown.points, &shown.bands, diagonal) {
            Some((drawing, words)) => cuts = cuts.child(card(drawing, &words)),
            None => empty.push(format!("{} = {:.3} mm", ["X", "Y", "Z"][of.axis], of.at_mm)),
        }
    }
    let mut cuts = el("section").child(el("h2").text("Sections")).child(cuts);
    if !empty.is_empty() {
        let note = format!(
            "No point whose surface stands across the plane lies at {}.",
            empty.join(", ")
        );
        cuts = cuts.child(el("p").class("note").text(typographic(&note)));
    }
    let remarks = shown.remarks.iter().map(|r| el("li").text(typographic(r)));
    let mut main = el("main")
        .child(el("h1").text(&shown.title))
        .child(el("p").class(class).text(typographic(&shown.result)));
    if !shown.remarks.is_empty() {
        main = main.child(el("ul").class("remarks").children(remarks));
    }
    let mut groups = el("div").class("row2");
    for group in &shown.groups {
        let of = || group.points.iter().filter_map(|k| shown.points.get(*k));
        groups = groups.child(card(
            histogram::histogram(of(), &shown.bands, shown.ends),
            &format!("{}: {} points.", group.name, of().count()),
        ));
    }
    let tables = shown.tables.iter().chain([&by_band]).map(figure_table);
    main = main
        .child(facts(&shown.facts))
        .child(turning)
        .child(maps)
        .child(
            el("section")
                .child(el("h2").text("Figures"))
                .child(card(
                    histogram::histogram(shown.points.iter(), &shown.bands, shown.ends),
                    "How many points have which deviation; positive is outside of the nominal.",
                ))
                .child(groups)
                .child(el("div").class("tables").children(tables)),
        );
    if !shown.sections.is_empty() {
        main = main.child(cuts);
    }
    let page = el("html")
        .attr("lang", "en")
        .child(document_head_with(&shown.title, &turning::policy()))
        .child(el("body").child(main).child(turning::script()));
    format!("<!DOCTYPE html>\n{page}")
}

/// All of them, or one of so many.
fn each(n: usize) -> String {
    match n {
        1 => "all".into(),
        n => format!("one in {n}"),
    }
}

fn diagonal_mm(points: &[DeviationPoint]) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in points {
        for i in 0..3 {
            low[i] = low[i].min(p.at_mm[i]);
            high[i] = high[i].max(p.at_mm[i]);
        }
    }
    let squares: f64 = (0..3).map(|i| (high[i] - low[i]).powi(2)).sum();
    squares.sqrt().max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_closes_what_it_opens_and_loads_nothing() {
        let points = (0..3000)
            .map(|k| {
                let angle = f64::from(k) * 0.01;
                DeviationPoint {
                    at_mm: [20.0 * angle.cos(), 20.0 * angle.sin(), f64::from(k) * 0.01],
                    deviation_mm: 0.08 * (3.0 * angle).sin(),
                    outward: [angle.cos() as f32, angle.sin() as f32, 0.0],
                }
            })
            .collect();
        let page = html(&DeviationPage {
            title: "A <scan>".into(),
            result: "3000 points".into(),
            ok: true,
            points,
            bands: Bands {
                low_mm: -0.05,
                high_mm: 0.05,
            },
            ends: LIMITS,
            sections: vec![Section {
                axis: 2,
                at_mm: 15.0,
                lines: Vec::new(),
            }],
            ..DeviationPage::default()
        });
        assert!(page.contains("A &lt;scan&gt;") && page.contains("Section Z = 15.000 mm"));
        assert!(page.contains("seen from above, from below"), "{page}");
        for name in [
            "svg", "table", "figure", "main", "html", "canvas", "script", "section",
        ] {
            let opened = page.matches(&format!("<{name}")).count();
            assert!(opened > 0, "{name}");
            assert_eq!(
                opened,
                page.matches(&format!("</{name}>")).count(),
                "{name}"
            );
        }
        assert!(!page.contains("NaN") && !page.contains("src="));
    }
}
