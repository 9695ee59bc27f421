//! The picture of a sphere: plan above front view, as on a drawing, with the
//! hits, the directions from which they were approached, and the residuals
//! magnified along the surface normal.

use umi_protocol::feature::{FeatureResult, FitReport, Shape};
use umi_protocol::job::FeatureSpec;

use crate::draw::labels::Labels;
use crate::draw::markup::Element;
use crate::draw::number::{um, um_signed};
use crate::draw::scale::{Magnified, bar};
use crate::draw::svg::{arrow, circle, line, picture, text};
use crate::figures::{self, Vector, largest_residual, length, minus, sphere_uncertainty};
use crate::pictures::residuals::accused;
use crate::pictures::unfitted;
use crate::pictures::views::{HEIGHT, RADIUS, VIEWS, View, WIDTH, axes_sign, near};
use umi_client::session::Session;

/// Room for the largest residual.
const ROOM: f64 = 28.0;
/// Room for half the cross that shows the centre's uncertainty.
const CROSS: f64 = 44.0;
/// An approach arrow, from tail to tip, away from the surface.
const ARROW: [f64; 2] = [60.0, 36.0];
/// A sphere whose residuals are this many times smaller gets its own scale.
const MUCH_FINER: f64 = 4.0;
/// Half a centre's cross without an uncertainty.
const SMALL_CROSS: f64 = 3.0;
/// A normal that is turned from the view's plane more than this is seen end-on.
const END_ON: f64 = 0.35;
/// More hits than this are not numbered.
const NUMBERED: usize = 16;

/// The magnification for all good spheres of a session: one for all, so that
/// pictures can be compared.
#[must_use]
pub fn common_scale(session: &Session) -> Magnified {
    let (mut residual, mut uncertainty, mut radius) = (0.0f64, 0.0f64, 0.0f64);
    for feature in session.setups.iter().flat_map(|p| &p.features) {
        if let (true, Some(fit)) = (feature.is_ok(), &feature.fit)
            && let (Some((_, d)), Shape::Sphere { radius_mm: r, .. }) =
                (largest_residual(fit), fit.shape)
        {
            residual = residual.max(d.abs());
            radius = radius.max(r);
            uncertainty = uncertainty.max(largest_uncertainty(fit).unwrap_or(0.0));
        }
    }
    let radius = if radius > 0.0 { radius } else { 10.0 };
    let by_residual = magnified(residual, radius);
    let by_uncertainty = Magnified::for_largest(uncertainty, CROSS, RADIUS / radius);
    // The cross of the centre shall be seen whole, unless the residuals would
    // hardly be seen then.
    if by_uncertainty.times < by_residual.times && by_uncertainty.times * 2.0 >= by_residual.times {
        by_uncertainty
    } else {
        by_residual
    }
}

fn magnified(largest_mm: f64, radius_mm: f64) -> Magnified {
    Magnified::for_largest(largest_mm, ROOM, RADIUS / radius_mm)
}

/// The largest standard uncertainty of the centre, mm.
fn largest_uncertainty(fit: &FitReport) -> Option<f64> {
    let [x, y, z, _] = sphere_uncertainty(fit)?;
    let largest = x.max(y).max(z);
    (x + y + z).is_finite().then_some(largest)
}

/// A sphere's picture, and what its caption says. `approach_deg` is the job's
/// limit on the angle between surface normal and approach.
pub fn drawing(
    spec: Option<&FeatureSpec>,
    feature: &FeatureResult,
    common: Magnified,
    approach_deg: Option<f64>,
) -> (Element, String) {
    match feature.fit.as_ref().map(|fit| (fit, fit.shape)) {
        Some((
            fit,
            Shape::Sphere {
                center_mm,
                radius_mm,
                ..
            },
        )) if radius_mm.is_finite() && radius_mm > 0.0 && length(center_mm).is_finite() => {
            let largest = largest_residual(fit).map_or(0.0, |(_, d)| d.abs());
            let drawn = Fitted {
                spec,
                feature,
                fit,
                center: center_mm,
                radius: radius_mm,
                // A refused sphere may have residuals that would leave the picture.
                errors: scale_for(common, largest, radius_mm),
                approach_deg,
            };
            (drawn.picture(), drawn.caption())
        }
        _ => unfitted::drawing(feature),
    }
}

/// The common magnification where it suits this sphere: where the residuals
/// neither leave the picture nor vanish in it.
fn scale_for(common: Magnified, largest_mm: f64, radius_mm: f64) -> Magnified {
    let same_size = Magnified {
        times: common.times,
        px_per_mm: common.times * RADIUS / radius_mm,
    };
    let own = magnified(largest_mm, radius_mm);
    let fits = largest_mm * same_size.px_per_mm <= ROOM * 1.2;
    if fits && own.times <= MUCH_FINER * same_size.times {
        same_size
    } else {
        own
    }
}

struct Fitted<'a> {
    spec: Option<&'a FeatureSpec>,
    feature: &'a FeatureResult,
    fit: &'a FitReport,
    center: Vector,
    radius: f64,
    errors: Magnified,
    approach_deg: Option<f64>,
}

impl Fitted<'_> {
    fn picture(&self) -> Element {
        let label = format!(
            "{}: hits and residuals in plan and front view, {}",
            self.feature.name,
            self.errors.stated()
        );
        let mut svg = picture(WIDTH, HEIGHT, &label);
        for view in &VIEWS {
            svg = svg.children(self.view(view));
        }
        let bar_mm = self.errors.bar_mm(60.0);
        svg.children(bar(
            "bar",
            [14.0, HEIGHT - 12.0],
            bar_mm,
            self.errors.px_per_mm,
        ))
        .child(text(
            "t end",
            [WIDTH - 8.0, HEIGHT - 8.0],
            &format!("residuals {}", self.errors.stated()),
        ))
    }

    fn view(&self, view: &View) -> Vec<Element> {
        let middle = [WIDTH / 2.0, view.middle];
        let project = |v: Vector| [v[view.axes[0]], v[view.axes[1]]];
        let mut out = vec![
            text("t b", [8.0, view.middle - RADIUS - 70.0], view.title),
            circle("nominal-ball", middle, RADIUS),
        ];
        out.extend(axes_sign([14.0, view.middle + RADIUS + 26.0], view.letters));
        let mut labels = Labels::new(
            [2.0, view.middle - RADIUS - 66.0],
            [WIDTH - 2.0, view.middle + RADIUS + 60.0],
        );
        labels.keep_off([28.0, view.middle + RADIUS + 12.0], 24.0);
        labels.keep_off_circle(middle, RADIUS);
        out.extend(self.centre_cross(view, middle, &mut labels));

        let accused = accused(&self.feature.reasons);
        let mut end_on: Vec<(Vec<usize>, [f64; 2])> = Vec::new();
        let mut to_label = Vec::new();
        let hits = self.feature.points_mm.iter().zip(&self.fit.residuals_mm);
        for (number, (p, d)) in (1usize..).zip(hits) {
            let arm = minus(*p, self.center);
            let distance = length(arm);
            if !(distance.is_finite() && distance > 0.0 && d.is_finite()) {
                continue;
            }
            let normal = project(arm.map(|c| c / distance));
            let along = |px: f64| [middle[0] + normal[0] * px, middle[1] - normal[1] * px];
            let base = along(RADIUS);
            let tip = along(RADIUS + d * self.errors.px_per_mm);
            if accused.contains(&number) {
                out.push(circle("accused", tip, 8.0));
                labels.keep_off(tip, 9.0);
            }
            if normal[0].hypot(normal[1]) < END_ON {
                match end_on.iter_mut().find(|(_, at)| near(*at, base)) {
                    Some((numbers, _)) => numbers.push(number),
                    None => end_on.push((vec![number], base)),
                }
                out.push(circle("hit-end-on", base, 3.2));
                continue;
            }
            let sign = if *d < 0.0 { "inside" } else { "outside" };
            out.push(line(&format!("residual {sign}"), base, tip));
            out.push(circle(&format!("hit {sign}"), tip, 3.0));
            labels.keep_off_line(base, tip);
            labels.keep_off(tip, 5.0);
            if let Some(approach) = self.spec.and_then(|s| s.approach.get(number - 1)) {
                let (axis, sense) = approach.axis_and_sign();
                let mut direction = [0.0; 3];
                direction[axis] = sense;
                let motion = project(direction);
                if motion != [0.0; 2] {
                    let off = |px: f64| [base[0] - motion[0] * px, base[1] + motion[1] * px];
                    out.extend(arrow("approach", off(ARROW[0]), off(ARROW[1])));
                    labels.keep_off_line(off(ARROW[0]), off(ARROW[1]));
                }
            }
            to_label.push((number, tip, *d));
        }
        if self.fit.residuals_mm.len() <= NUMBERED {
            for (number, tip, d) in to_label {
                out.push(labels.place("t", tip, 7.0, &format!("{number}: {}", um_signed(d))));
            }
            for (numbers, at) in end_on {
                let numbers: Vec<String> = numbers.iter().map(usize::to_string).collect();
                out.push(labels.place("t muted", at, 6.0, &numbers.join(", ")));
            }
        }
        out
    }

    /// The centre, with one standard uncertainty each way where it is known
    /// and does not leave the sphere.
    fn centre_cross(&self, view: &View, middle: [f64; 2], labels: &mut Labels) -> Vec<Element> {
        let [x, y] = middle;
        let mut out = Vec::new();
        for (i, axis) in view.axes.into_iter().enumerate() {
            let u = self.uncertainty_px(axis).unwrap_or(SMALL_CROSS);
            let step = |along: f64, across: f64| {
                if i == 0 {
                    [x + along, y + across]
                } else {
                    [x + across, y + along]
                }
            };
            out.push(line("centre", step(-u, 0.0), step(u, 0.0)));
            for end in [-u, u] {
                out.push(line("centre", step(end, -3.0), step(end, 3.0)));
            }
            labels.keep_off_line(step(-u, 0.0), step(u, 0.0));
        }
        out
    }

    /// Drawn for all axes or for none.
    fn uncertainty_px(&self, axis: usize) -> Option<f64> {
        let fits = largest_uncertainty(self.fit)? * self.errors.px_per_mm <= CROSS * 1.2;
        let u = *sphere_uncertainty(self.fit)?.get(axis)?;
        fits.then_some(u * self.errors.px_per_mm)
    }

    /// How far the side hits may lie off the centre by the approach limit.
    fn side_limit_mm(&self) -> Option<f64> {
        self.approach_deg
            .map(|deg| self.radius * deg.to_radians().sin())
    }

    fn caption(&self) -> String {
        let mut caption = String::new();
        if let Some((number, d)) = largest_residual(self.fit) {
            caption = format!("Largest residual {} \u{b5}m at hit {number}.", um_signed(d));
        }
        if self.uncertainty_px(0).is_none() {
            caption.push_str(" Centre without its uncertainty (unknown, or too large to show).");
        }
        if let Some(above) = figures::side_hits_above_centre(self.spec, self.feature) {
            let side = if above < 0.0 { "below" } else { "above" };
            caption.push_str(&format!(
                " Side hits lie {} \u{b5}m {side} the fitted centre{}.",
                um(above.abs()),
                self.side_limit_mm()
                    .map_or(String::new(), |l| format!(" (limit {})", um(l)))
            ));
        }
        caption
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    /// A residual of 10 µm has a bar of 10 µm by the picture's own scale bar,
    /// outwards where the hit lies outside.
    #[test]
    fn a_residual_has_the_length_of_its_scale() {
        let session = sample::good();
        let mut feature = session.setups[0].features[0].clone();
        let fit = feature.fit.as_mut().unwrap();
        fit.residuals_mm[1] = 0.010;
        fit.residuals_mm[2] = -0.005;
        let errors = Magnified::for_largest(0.010, ROOM, RADIUS / 12.7);
        let (svg, _) = drawing(session.spec("SPHERE1"), &feature, errors, None);
        let svg = svg.to_string();
        let bar = sample::line_length(&svg, "class=\"bar\"", 0);
        let bar_um: f64 = sample::between(&svg, "class=\"t\" x=\"", " \u{b5}m</text>")
            .rsplit('>')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        let px_per_um = bar / bar_um;
        let outside = sample::line_length(&svg, "class=\"residual outside\"", 0);
        let inside = sample::line_length(&svg, "class=\"residual inside\"", 0);
        assert!(
            (outside / px_per_um - 10.0).abs() < 0.02,
            "{outside} {px_per_um}"
        );
        assert!(
            (inside / px_per_um - 5.0).abs() < 0.02,
            "{inside} {px_per_um}"
        );
        // Hit 2 is the one towards +X: outwards is to the right.
        let [x1, x2] = sample::line_ends(&svg, "class=\"residual outside\"", 0).map(|p| p[0]);
        assert!(x2 > x1);
    }
}
