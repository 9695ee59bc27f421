//! SVG primitives. Colours and strokes are classes of the style sheet, so that
//! a picture follows light, dark and paper.

use std::fmt::Write as _;

use crate::draw::markup::{Element, el};
use crate::draw::number::typographic;

/// Height of ordinary text in a picture, px of its view box.
pub const TEXT: f64 = 11.0;

/// Width that a text may take. Wide on purpose: the reader's font is not known.
#[must_use]
pub fn text_width(class: &str, text: &str) -> f64 {
    let advance = |c: char| match c {
        'A'..='Z' => 0.7,
        'm' | 'w' => 0.95,
        ' ' | '.' | ',' | ':' | '(' | ')' | 'i' | 'l' | 'j' | 't' | 'f' => 0.4,
        _ => 0.63,
    };
    let bold = if class.split(' ').any(|c| c == "b") {
        1.1
    } else {
        1.0
    };
    text.chars().map(advance).sum::<f64>() * TEXT * bold
}

/// A picture of this size; `label` is read out instead of it.
pub fn picture(width: f64, height: f64, label: &str) -> Element {
    el("svg")
        .attr("viewBox", format!("0 0 {} {}", px(width), px(height)))
        .attr("role", "img")
        .attr("aria-label", label)
        .attr("xmlns", "http://www.w3.org/2000/svg")
}

/// A coordinate: two decimals, never NaN, never far outside any picture.
/// Callers leave out what is not finite; this is the last resort.
#[must_use]
pub fn px(value: f64) -> String {
    let value = if value.is_finite() {
        value.clamp(-1e4, 1e4)
    } else {
        0.0
    };
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

/// A line.
pub fn line(class: &str, from: [f64; 2], to: [f64; 2]) -> Element {
    el("line")
        .class(class)
        .attr("x1", px(from[0]))
        .attr("y1", px(from[1]))
        .attr("x2", px(to[0]))
        .attr("y2", px(to[1]))
}

/// A circle.
pub fn circle(class: &str, at: [f64; 2], radius: f64) -> Element {
    el("circle")
        .class(class)
        .attr("cx", px(at[0]))
        .attr("cy", px(at[1]))
        .attr("r", px(radius.max(0.0)))
}

/// A rectangle between two corners.
pub fn rect(class: &str, a: [f64; 2], b: [f64; 2]) -> Element {
    el("rect")
        .class(class)
        .attr("x", px(a[0].min(b[0])))
        .attr("y", px(a[1].min(b[1])))
        .attr("width", px((a[0] - b[0]).abs()))
        .attr("height", px((a[1] - b[1]).abs()))
}

/// A closed polygon.
pub fn polygon(class: &str, corners: &[[f64; 2]]) -> Element {
    let mut points = String::new();
    for [x, y] in corners {
        // Writing to a String cannot fail.
        let _ = write!(points, "{},{} ", px(*x), px(*y));
    }
    el("polygon").class(class).attr("points", points.trim_end())
}

/// Text. The class says its anchor (`mid`, `end`) and kind.
pub fn text(class: &str, at: [f64; 2], content: &str) -> Element {
    el("text")
        .class(class)
        .attr("x", px(at[0]))
        .attr("y", px(at[1]))
        .text(typographic(content))
}

/// An arrow with a filled head. Short ones get a smaller head; one that is
/// shorter than a stroke is a dot, so that zero is seen as zero.
pub fn arrow(class: &str, from: [f64; 2], to: [f64; 2]) -> Vec<Element> {
    let d = [to[0] - from[0], to[1] - from[1]];
    let length = d[0].hypot(d[1]);
    if !length.is_finite() {
        return Vec::new();
    }
    if length < 1.5 {
        return vec![circle(&format!("{class} tip"), from, 1.8)];
    }
    let u = [d[0] / length, d[1] / length];
    let head = (length * 0.5).min(7.0);
    let half = head * 0.42;
    let neck = [to[0] - u[0] * head, to[1] - u[1] * head];
    vec![
        line(class, from, neck),
        polygon(
            &format!("{class} tip"),
            &[
                to,
                [neck[0] - u[1] * half, neck[1] + u[0] * half],
                [neck[0] + u[1] * half, neck[1] - u[0] * half],
            ],
        ),
    ]
}

/// A cross (a missing or wrong thing).
pub fn cross(class: &str, at: [f64; 2], half: f64) -> [Element; 2] {
    let [x, y] = at;
    [
        line(class, [x - half, y - half], [x + half, y + half]),
        line(class, [x - half, y + half], [x + half, y - half]),
    ]
}

/// The mark of a series: four colours, each with four shapes, and neighbours
/// differ in both, so also without colour.
pub fn mark(more_classes: &str, series: usize, at: [f64; 2], half: f64) -> Element {
    let [x, y] = at;
    let class = &format!("mark s{}{more_classes}", series % 4);
    match (series + series / 4) % 4 {
        0 => circle(class, at, half),
        1 => rect(
            class,
            [x - half * 0.9, y - half * 0.9],
            [x + half * 0.9, y + half * 0.9],
        ),
        2 => polygon(
            class,
            &[
                [x, y - half * 1.2],
                [x + half * 1.1, y + half * 0.8],
                [x - half * 1.1, y + half * 0.8],
            ],
        ),
        _ => polygon(
            class,
            &[
                [x, y - half * 1.3],
                [x + half * 1.3, y],
                [x, y + half * 1.3],
                [x - half * 1.3, y],
            ],
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is not a number never reaches an attribute.
    #[test]
    fn coordinates_are_always_numbers() {
        assert_eq!(px(f64::NAN), "0");
        assert_eq!(px(f64::INFINITY), "0");
        assert_eq!(px(1e300), "10000");
        assert_eq!(px(-0.001), "0");
        assert_eq!(px(1.5), "1.5");
        assert!(arrow("a", [0.0, 0.0], [f64::NAN, 1.0]).is_empty());
    }
}
