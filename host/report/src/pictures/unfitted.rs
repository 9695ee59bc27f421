//! Hits without a fit, true to scale; those that a reason names are marked.

use umi_protocol::feature::FeatureResult;

use crate::draw::labels::Labels;
use crate::draw::markup::Element;
use crate::draw::scale::{Magnified, PlanView, bar, length_text};
use crate::draw::svg::{circle, cross, picture, rect, text};
use crate::figures::{Vector, length, minus};
use crate::pictures::residuals::accused;
use crate::pictures::views::{HEIGHT, RADIUS, VIEWS, WIDTH, axes_sign, near};

/// Hits that could not be fitted, or were not because they are known to be wrong.
pub fn drawing(feature: &FeatureResult) -> (Element, String) {
    let label = format!("{}: hits without a fit", feature.name);
    let mut svg = picture(WIDTH, HEIGHT, &label);
    let finite = |p: &&Vector| p.iter().all(|c| c.is_finite());
    let points: Vec<Vector> = feature.points_mm.iter().filter(finite).copied().collect();
    let accused = accused(&feature.reasons);
    for view in &VIEWS {
        let corner = [10.0, view.middle - 122.0];
        let size = [WIDTH - 20.0, 220.0];
        let far = [corner[0] + size[0], corner[1] + size[1]];
        let flat: Vec<[f64; 2]> = points
            .iter()
            .map(|p| [p[view.axes[0]], p[view.axes[1]]])
            .collect();
        let plan = PlanView::fit(&flat, corner, size, 34.0);
        svg = svg
            .child(text("t b", [8.0, view.middle - RADIUS - 70.0], view.title))
            .child(rect("refused-area", corner, far))
            .children(axes_sign([18.0, far[1] - 6.0], view.letters));
        if points.is_empty() {
            svg = svg.child(text(
                "t ng mid",
                [WIDTH / 2.0, view.middle],
                "no usable hits",
            ));
            continue;
        }
        let mut labels = Labels::new(corner, far);
        labels.keep_off([30.0, far[1] - 18.0], 22.0);
        let mut groups: Vec<(Vec<usize>, [f64; 2])> = Vec::new();
        for (number, p) in (1usize..)
            .zip(&feature.points_mm)
            .filter(|(_, p)| finite(p))
        {
            let at = plan.at(p[view.axes[0]], p[view.axes[1]]);
            labels.keep_off(at, 5.0);
            if accused.contains(&number) {
                svg = svg
                    .children(cross("wrong", at, 5.0))
                    .child(circle("accused", at, 8.0));
            } else {
                svg = svg.child(circle("hit plain", at, 3.0));
            }
            match groups.iter_mut().find(|(_, other)| near(*other, at)) {
                Some((numbers, _)) => numbers.push(number),
                None => groups.push((vec![number], at)),
            }
        }
        for (numbers, at) in groups {
            let wrong = numbers.iter().any(|n| accused.contains(n));
            let class = if wrong { "t ng b" } else { "t" };
            let numbers: Vec<String> = numbers.iter().map(usize::to_string).collect();
            svg = svg.child(labels.place(
                class,
                at,
                if wrong { 11.0 } else { 8.0 },
                &numbers.join(", "),
            ));
        }
        let true_size = Magnified {
            px_per_mm: plan.scale,
            times: 1.0,
        };
        let bar_mm = true_size.bar_mm(60.0);
        let left = far[0] - 62.0 - bar_mm * plan.scale;
        svg = svg.children(bar("bar", [left, far[1] - 10.0], bar_mm, plan.scale));
    }
    let span = length_text(largest_span(&points));
    (
        svg,
        format!("No fit: hits as they came, over {span}, true to scale."),
    )
}

fn largest_span(points: &[Vector]) -> f64 {
    let pairs = points
        .iter()
        .flat_map(|a| points.iter().map(move |b| minus(*a, *b)));
    pairs.map(length).fold(0.0, f64::max)
}
