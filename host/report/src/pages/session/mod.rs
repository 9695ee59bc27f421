//! The page: one file, no scripts, nothing from elsewhere.

mod clamping;
mod head;
mod registration;
pub mod tables;

use crate::draw::markup::{Element, el};
use crate::draw::number::typographic;
use crate::pictures::{chart, sphere};
use umi_client::session::Session;

/// The report as one self-contained HTML file.
#[must_use]
pub fn html(session: &Session) -> String {
    html_with(session, &head::result(session), None, Vec::new())
}

/// The same, with another result and its pictures at the top, and sections before the
/// clampings.
#[must_use]
pub fn html_with(
    session: &Session,
    result: &str,
    pictures: Option<Element>,
    more: Vec<Element>,
) -> String {
    let common = sphere::common_scale(session);
    let (chart, chart_caption) = chart::drawing(session);
    let main = el("main")
        .child(head::header(session, result, pictures))
        .children(more)
        .child(
            el("section")
                .child(el("h2").text("All clampings"))
                .child(head::overview(session))
                .child(
                    el("figure")
                        .class("card")
                        .child(chart)
                        .child(el("figcaption").text(typographic(&chart_caption))),
                ),
        )
        .children((0..session.setups.len()).map(|place| clamping::section(session, place, common)))
        .child(head::faults(session))
        .child(definitions());
    let page = el("html")
        .attr("lang", "en")
        .child(document_head(&session.title))
        .child(el("body").child(main));
    format!("<!DOCTYPE html>\n{page}")
}

/// The head of every page: its style is in it, and nothing is loaded or run, whatever a name in
/// the page says.
pub(crate) fn document_head(title: &str) -> Element {
    document_head_with(title, CONTENT_SECURITY_POLICY)
}

/// The same, with another policy.
pub(crate) fn document_head_with(title: &str, policy: &str) -> Element {
    let viewport = el("meta")
        .attr("name", "viewport")
        .attr("content", "width=device-width, initial-scale=1");
    let policy = el("meta")
        .attr("http-equiv", "Content-Security-Policy")
        .attr("content", policy);
    el("head")
        .child(el("meta").attr("charset", "utf-8"))
        .child(viewport)
        .child(policy)
        .child(el("title").text(title))
        .child(Element::style_sheet(include_str!("../style.css")))
}

/// Nothing but the page's own style: no script, no picture, no address elsewhere, no form.
pub const CONTENT_SECURITY_POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// What the words and figures mean.
fn definitions() -> Element {
    let entries = [
        (
            "residual",
            "Distance of a hit from the fitted surface, d = |p \u{2212} c| \u{2212} r; positive outside. Orthogonal least squares.",
        ),
        ("rms", "sqrt(\u{3a3}d\u{b2} / n) over the n hits."),
        (
            "s, \u{3bd}",
            "sqrt(\u{3a3}d\u{b2} / \u{3bd}) with \u{3bd} = n \u{2212} 4 degrees of freedom for a sphere, 3n \u{2212} 6 for the registration: the standard deviation of the residuals.",
        ),
        (
            "u",
            "Standard uncertainty of a fitted parameter: s times the square root of the diagonal of inv(J\u{1d40}J). It knows only what residuals show: a common error of all hits, and an error of a single hit along an axis, are not in it.",
        ),
        (
            "thesis s/2",
            "What Sawula (2013), tables 4.1 and 5.2, prints as \u{201c}uncertainty of centre\u{201d}. It is half of s and not the uncertainty of the least-squares centre; given for comparison only.",
        ),
        (
            "registration",
            "Rigid motion q = R p + t from nominal (or reference) position p to measured position q, least squares; residuals are R p + t \u{2212} q.",
        ),
        (
            "turn, tilt",
            "Rotation about Z nearest to R, and angle between the Z axes. A rotation in the plane corrects the turn, not the tilt.",
        ),
        (
            "path error",
            "Distance from where a point of the tool path goes to where it would go with the true pose; only where the true pose is known.",
        ),
        (
            "OK, NG",
            "OK: every feature came and every limit holds. Anything else is NG, and no correction leaves the board.",
        ),
    ];
    el("section")
        .class("definitions")
        .child(el("h2").text("What the words mean"))
        .child(
            el("dl").children(
                entries
                    .iter()
                    .flat_map(|(word, meaning)| [el("dt").text(word), el("dd").text(meaning)]),
            ),
        )
}
