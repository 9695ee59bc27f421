//! A page of tables: figures beside others, without a picture.

use crate::draw::markup::el;
use crate::draw::number::typographic;
use crate::pages::scan::{FigureTable, facts, figure_table};
use crate::pages::session::document_head;

/// What the page shows.
#[derive(Clone, Debug, Default)]
pub struct TablesPage {
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
}

/// The page as one self-contained HTML file.
#[must_use]
pub fn html(shown: &TablesPage) -> String {
    let class = if shown.ok { "result" } else { "result ng" };
    let main = el("main")
        .child(el("h1").text(&shown.title))
        .child(el("p").class(class).text(typographic(&shown.result)))
        .child(facts(&shown.facts))
        .children(shown.tables.iter().map(figure_table));
    let page = el("html")
        .attr("lang", "en")
        .child(document_head(&shown.title))
        .child(el("body").child(main));
    format!("<!DOCTYPE html>\n{page}")
}
