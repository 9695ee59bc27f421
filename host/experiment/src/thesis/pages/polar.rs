//! Pretravel over direction, as figure 3.5 of the thesis draws it.

use umi_report::draw::markup::Element;
use umi_report::draw::number::fixed;
use umi_report::draw::scale::ticks;
use umi_report::draw::svg::{self, circle, line, picture, polygon, text};

/// The plot of amounts (direction in radians, millimetres). A circle is one amount; the
/// middle is not zero, so that lobes are seen.
pub fn drawing(amounts: &[(f64, f64)], compensation_mm: f64) -> Element {
    const SIZE: f64 = 340.0;
    const REACH: f64 = 138.0;
    let middle = [SIZE / 2.0, SIZE / 2.0];
    let largest = amounts
        .iter()
        .map(|(_, mm)| *mm)
        .chain([compensation_mm])
        .fold(0.0, f64::max);
    let least = amounts
        .iter()
        .map(|(_, mm)| *mm)
        .fold(compensation_mm, f64::min);
    // Twice the lobes' height of room inside.
    let inner = (least - 2.0 * (largest - least)).max(0.0);
    let px_per_mm = REACH / (largest - inner).max(1e-6);
    let radius = |mm: f64| (mm - inner).max(0.0) * px_per_mm;
    let at = |angle: f64, mm: f64| {
        let (sin, cos) = angle.sin_cos();
        let r = radius(mm);
        [middle[0] + r * cos, middle[1] - r * sin]
    };
    let mut out = picture(
        SIZE,
        SIZE,
        "Pretravel of the probe in the directions of the XY plane",
    );
    for mm in ticks(inner, largest, 4) {
        out = out
            .child(circle("grid", middle, radius(mm)).attr("fill", "none"))
            .child(text(
                "muted",
                [middle[0] + 3.0, middle[1] - radius(mm) - 2.0],
                &format!("{} \u{b5}m", fixed(mm * 1e3, 0)),
            ));
    }
    for (direction, name) in [(0.0, "+X"), (90.0, "+Y"), (180.0, "-X"), (270.0, "-Y")] {
        let angle = f64::to_radians(direction);
        let (sin, cos) = angle.sin_cos();
        let end = [
            middle[0] + (REACH + 6.0) * cos,
            middle[1] - (REACH + 6.0) * sin,
        ];
        let place = [
            middle[0] + (REACH + 18.0) * cos,
            middle[1] - (REACH + 18.0) * sin + 4.0,
        ];
        out = out
            .child(line("grid", middle, end))
            .child(text("mid b", place, name));
    }
    let corners: Vec<[f64; 2]> = amounts.iter().map(|(angle, mm)| at(*angle, *mm)).collect();
    out = out.child(polygon("measured", &corners)).child(circle(
        "nominal",
        middle,
        radius(compensation_mm),
    ));
    out.children(
        corners
            .iter()
            .map(|corner| svg::circle("hit plain", *corner, 2.0)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every hit is a dot, and no coordinate leaves the picture.
    #[test]
    fn every_direction_is_drawn() {
        let amounts: Vec<(f64, f64)> = (0..36)
            .map(|k| {
                let angle = f64::from(k * 10).to_radians();
                (angle, 0.05 + 0.01 * (3.0 * angle).cos())
            })
            .collect();
        let drawn = drawing(&amounts, 0.062).to_string();
        assert_eq!(drawn.matches("class=\"hit plain\"").count(), 36);
        for part in drawn.split("cx=\"").skip(1) {
            let x: f64 = part.split('"').next().unwrap().parse().unwrap();
            assert!((0.0..=340.0).contains(&x), "{x}");
        }
    }
}
