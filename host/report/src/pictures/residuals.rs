//! The picture of any other geometry: the residual of every hit as a bar. Also
//! which hits the reasons accuse.

use umi_protocol::feature::FeatureResult;
use umi_protocol::reason::Reason;

use crate::draw::markup::Element;
use crate::draw::number::um_signed;
use crate::draw::scale::ticks;
use crate::draw::svg::{circle, line, picture, text};
use crate::figures::largest_residual;

const WIDTH: f64 = 300.0;
const HEIGHT: f64 = 220.0;
/// The drawing area: left, top, right, bottom.
const AREA: [f64; 4] = [46.0, 24.0, 290.0, 184.0];

/// Numbers (from 1) of the hits that the reasons name.
#[must_use]
pub fn accused(reasons: &[Reason]) -> Vec<usize> {
    let mut hits = Vec::new();
    for reason in reasons {
        match reason {
            Reason::DuplicatePoint { first, hit } => hits.extend([*first, *hit]),
            Reason::NullPoint { hit }
            | Reason::OverflowSuspect { hit }
            | Reason::OutsideTravel { hit }
            | Reason::NotTouched { hit }
            | Reason::NoApproach { hit }
            | Reason::ApproachMismatch { hit }
            | Reason::ApproachAngle { hit, .. }
            | Reason::LoneHitOffset { hit, .. }
            | Reason::SuspectSign { hit, .. }
            | Reason::SuspectHit { hit, .. } => hits.push(*hit),
            _ => {}
        }
    }
    hits.into_iter().map(usize::from).collect()
}

/// The residual of every hit.
pub fn drawing(feature: &FeatureResult) -> (Element, String) {
    let label = format!("{}: residual of every hit", feature.name);
    let mut svg = picture(WIDTH, HEIGHT, &label);
    let Some((fit, (worst, d))) = feature
        .fit
        .as_ref()
        .and_then(|f| Some((f, largest_residual(f)?)))
    else {
        return (
            svg.child(text("t ng mid", [WIDTH / 2.0, HEIGHT / 2.0], "not fitted")),
            "No fit.".into(),
        );
    };
    let [left, top, right, bottom] = AREA;
    let most = d.abs().max(1e-4) * 1.15;
    let (zero, half) = (f64::midpoint(top, bottom), (bottom - top) / 2.0);
    let y = |mm: f64| zero - mm / most * half;
    for tick in ticks(-most * 1e3, most * 1e3, 6) {
        let at = y(tick / 1e3);
        svg = svg.child(line("grid", [left, at], [right, at])).child(text(
            "t muted end",
            [left - 5.0, at + 4.0],
            &um_signed(tick / 1e3),
        ));
    }
    svg = svg
        .child(text("t b", [8.0, 14.0], "residual, \u{b5}m"))
        .child(line("axis", [left, zero], [right, zero]))
        .child(text("t muted end", [right, HEIGHT - 8.0], "hit"));
    let accused = accused(&feature.reasons);
    let count = u32::try_from(fit.residuals_mm.len()).unwrap_or(u32::MAX);
    let pitch = (right - left) / f64::from(count.max(1));
    let every = (count / 12).max(1);
    let mut x = left + pitch / 2.0;
    for (number, d) in (1u32..).zip(&fit.residuals_mm) {
        if d.is_finite() {
            let sign = if *d < 0.0 { "inside" } else { "outside" };
            svg = svg
                .child(line(&format!("residual {sign}"), [x, zero], [x, y(*d)]))
                .child(circle(&format!("hit {sign}"), [x, y(*d)], 3.0));
            if accused.contains(&usize::try_from(number).unwrap_or(0)) {
                svg = svg.child(circle("accused", [x, y(*d)], 8.0));
            }
        }
        if (number - 1) % every == 0 {
            svg = svg.child(text("t muted mid", [x, bottom + 14.0], &number.to_string()));
        }
        x += pitch;
    }
    let caption = format!("Largest residual {} \u{b5}m at hit {worst}.", um_signed(d));
    (svg, caption)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both hits of a repeated point are marked, and what names no hit marks none.
    #[test]
    fn accused_hits_are_those_that_the_reasons_name() {
        let reasons = [
            Reason::DuplicatePoint { first: 2, hit: 3 },
            Reason::SequenceGap,
            Reason::SuspectSign { hit: 5, axis: 0 },
        ];
        assert_eq!(accused(&reasons), [2, 3, 5]);
    }
}
