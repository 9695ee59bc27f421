//! The two views in which a sphere, and what could not be fitted, is seen.

use crate::draw::markup::Element;
use crate::draw::svg::{arrow, text};

pub const WIDTH: f64 = 300.0;
/// The sphere's radius on the page.
pub const RADIUS: f64 = 64.0;
/// One of the two views.
pub struct View {
    pub title: &'static str,
    /// Axes to the right and up: 0 X, 1 Y, 2 Z.
    pub axes: [usize; 2],
    pub letters: [&'static str; 2],
    /// Height of the sphere's centre in the picture.
    pub middle: f64,
}

pub const VIEWS: [View; 2] = [
    View {
        title: "plan (XY), seen from above",
        axes: [0, 1],
        letters: ["X", "Y"],
        middle: 148.0,
    },
    View {
        title: "front (XZ), seen against Y",
        axes: [0, 2],
        letters: ["X", "Z"],
        middle: 420.0,
    },
];
pub const HEIGHT: f64 = 548.0;

/// Whether two marks would lie on each other.
pub fn near(a: [f64; 2], b: [f64; 2]) -> bool {
    (a[0] - b[0]).hypot(a[1] - b[1]) < 5.0
}

/// Two small arrows with the letters of the axes.
pub fn axes_sign(corner: [f64; 2], letters: [&str; 2]) -> Vec<Element> {
    let [x, y] = corner;
    let mut out = arrow("axis", corner, [x + 24.0, y]);
    out.extend(arrow("axis", corner, [x, y - 24.0]));
    out.push(text("t muted", [x + 27.0, y + 4.0], letters[0]));
    out.push(text("t muted mid", [x, y - 28.0], letters[1]));
    out
}
