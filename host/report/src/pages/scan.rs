//! The page on a scan that was placed: what its points miss by, and how sure its place is.

use crate::draw::markup::{Element, el};
use crate::draw::number::typographic;
use crate::draw::scale::{PlanView, bar, length_text, nice_below};
use crate::draw::svg::{circle, picture, polygon, text};
use crate::pages::session::document_head;

const SIZE: [f64; 2] = [560.0, 420.0];
const MARGIN: f64 = 34.0;
/// Points that a picture shows at most.
const SHOWN: usize = 4000;

/// A table of figures; the first column is a name.
#[derive(Clone, Debug, Default)]
pub struct FigureTable {
    /// What stands above it.
    pub caption: String,
    /// The heads of its columns.
    pub heads: Vec<&'static str>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

/// What the page shows.
#[derive(Clone, Debug, Default)]
pub struct PlacedPage {
    /// The title.
    pub title: String,
    /// The result, first and large.
    pub result: String,
    /// Whether it is a good one.
    pub ok: bool,
    /// Why it is not.
    pub reasons: Vec<String>,
    /// Names and values.
    pub facts: Vec<(&'static str, String)>,
    /// Tables.
    pub tables: Vec<FigureTable>,
    /// Points that count with their deviations in mm.
    pub points: Vec<([f64; 3], f64)>,
    /// The noise in mm: the unit of the marks.
    pub noise_mm: f64,
}

/// The page as one self-contained HTML file.
#[must_use]
pub fn html(shown: &PlacedPage) -> String {
    let class = if shown.ok { "result" } else { "result ng" };
    let mut main = el("main")
        .child(el("h1").text(&shown.title))
        .child(el("p").class(class).text(typographic(&shown.result)));
    if !shown.reasons.is_empty() {
        let all = shown.reasons.iter().map(|reason| el("li").text(reason));
        main = main.child(el("ul").class("reasons").children(all));
    }
    main = main.child(facts(&shown.facts)).children(
        shown
            .tables
            .iter()
            .filter(|t| !t.rows.is_empty())
            .map(figure_table),
    );
    let step = nice_below(shown.noise_mm.max(1e-6));
    for (name, axes) in [
        ("From above: X to the right, Y up", [0, 1]),
        ("From the front: X to the right, Z up", [0, 2]),
        ("From the right: Y to the right, Z up", [1, 2]),
    ] {
        let caption = format!(
            "{name}. Deviations along the normals: a dot is within {0}; a circle lies outside of the surface by up to {1}, \
             a square within it; triangles, up and down, lie further off.",
            length_text(step),
            length_text(3.0 * step)
        );
        main = main.child(
            el("figure")
                .class("card")
                .child(view(name, axes, shown, step))
                .child(el("figcaption").text(caption)),
        );
    }
    let page = el("html")
        .attr("lang", "en")
        .child(document_head(&shown.title))
        .child(el("body").child(main));
    format!("<!DOCTYPE html>\n{page}")
}

/// Names and values.
pub(crate) fn facts(of: &[(&'static str, String)]) -> Element {
    el("dl").children(
        of.iter()
            .flat_map(|(name, value)| [el("dt").text(name), el("dd").text(typographic(value))]),
    )
}

/// A table of figures.
pub(crate) fn figure_table(of: &FigureTable) -> Element {
    let cell = |name: &'static str, i: usize| el(name).class(if i == 0 { "w" } else { "n" });
    let heads = of.heads.iter().enumerate();
    let rows = of.rows.iter().map(|row| {
        let cells = row.iter().enumerate();
        el("tr").children(cells.map(|(i, value)| cell("td", i).text(typographic(value))))
    });
    el("div").class("scroll").child(
        el("table")
            .child(el("caption").text(&of.caption))
            .child(
                el("thead")
                    .child(el("tr").children(heads.map(|(i, head)| cell("th", i).text(head)))),
            )
            .child(el("tbody").children(rows)),
    )
}

fn view(name: &str, [right, up]: [usize; 2], shown: &PlacedPage, step: f64) -> Element {
    let flat = |p: &[f64; 3]| [p[right], p[up]];
    let every = shown.points.len().div_ceil(SHOWN).max(1);
    let places: Vec<[f64; 2]> = shown.points.iter().map(|(p, _)| flat(p)).collect();
    let mut out = picture(SIZE[0], SIZE[1], name);
    if places.is_empty() {
        return out.child(text("t", [MARGIN, MARGIN], "no point counts"));
    }
    let plan = PlanView::fit(&places, [0.0, 0.0], SIZE, MARGIN);
    // The worst last: on top.
    let mut order: Vec<usize> = (0..places.len()).step_by(every).collect();
    order.sort_by(|&a, &b| {
        let size = |i: usize| shown.points[i].1.abs();
        size(a).total_cmp(&size(b))
    });
    for i in order {
        let [x, y] = plan.at(places[i][0], places[i][1]);
        let deviation = shown.points[i].1;
        let (colour, way) = if deviation > 0.0 {
            ("var(--orange)", -1.0)
        } else {
            ("var(--blue)", 1.0)
        };
        let mark = if deviation.abs() < step {
            circle("", [x, y], 0.8).attr("fill", "var(--muted)")
        } else if deviation.abs() >= 3.0 * step {
            let corners = [
                [x, y + way * 3.0],
                [x - 2.6, y - way * 1.6],
                [x + 2.6, y - way * 1.6],
            ];
            polygon("", &corners).attr("fill", colour)
        } else if deviation > 0.0 {
            circle("", [x, y], 1.7).attr("fill", colour)
        } else {
            let square = [
                [x - 1.5, y - 1.5],
                [x + 1.5, y - 1.5],
                [x + 1.5, y + 1.5],
                [x - 1.5, y + 1.5],
            ];
            polygon("", &square).attr("fill", colour)
        };
        out = out.child(mark);
    }
    let length = nice_below(SIZE[0] / 4.0 / plan.scale);
    out.children(bar("bar", [12.0, SIZE[1] - 14.0], length, plan.scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_shows_its_figures_and_closes_what_it_opens() {
        let page = html(&PlacedPage {
            title: "A <scan>".into(),
            result: "OK".into(),
            ok: true,
            facts: vec![("noise", "0.0300 mm".into())],
            tables: vec![FigureTable {
                caption: "Fiducials".into(),
                heads: vec!["name", "points"],
                rows: vec![vec!["B1".into(), "120".into()]],
            }],
            points: vec![
                ([0.0, 0.0, 0.0], 0.01),
                ([9.0, 5.0, 2.0], -0.05),
                ([f64::NAN, 5.0, 2.0], 0.2),
            ],
            noise_mm: 0.03,
            ..PlacedPage::default()
        });
        assert!(page.contains("A &lt;scan&gt;") && page.contains("B1"));
        for name in ["svg", "table", "figure", "main", "html"] {
            let opened = page.matches(&format!("<{name}")).count();
            assert_eq!(
                opened,
                page.matches(&format!("</{name}>")).count(),
                "{name}"
            );
        }
        assert!(!page.contains("NaN"));
    }
}
