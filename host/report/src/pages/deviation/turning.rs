//! The view that turns under the mouse: points for the graphics card, and the script that shows them.

use base64ct::{Base64, Encoding as _};
use sha2::{Digest as _, Sha256};

use crate::draw::markup::{Element, el};

use super::DeviationPoint;
use super::bands::{Bands, COLOURS, EDGES};

/// Points that a browser is given at most.
pub const CARRIED: usize = 60_000;
/// Of them, those beyond the limits at most.
const BEYOND: usize = 20_000;
/// The largest deviation of 16 bits, in halves of the way between the limits, from their middle.
const REACH: f64 = 4.0;

const SCRIPT: &str = include_str!("turn.js");

/// What a page with the view may do: run this one script, and nothing else.
#[must_use]
pub fn policy() -> String {
    let hash = Base64::encode_string(&Sha256::digest(SCRIPT.as_bytes()));
    format!(
        "{}; script-src 'sha256-{hash}'",
        crate::pages::session::CONTENT_SECURITY_POLICY
    )
}

/// The script, to stand at the end of the body.
pub fn script() -> Element {
    Element::script(SCRIPT)
}

/// Points for the browser.
pub struct Carried {
    /// The view.
    pub view: Element,
    /// How many points it has.
    pub n: usize,
    /// Each n-th of those within the limits.
    pub every_within: usize,
    /// Each n-th of those beyond the limits.
    pub every_beyond: usize,
}

/// The view of these points.
pub fn view(points: &[DeviationPoint], bands: &Bands) -> Carried {
    let beyond =
        |p: &&DeviationPoint| p.deviation_mm < bands.low_mm || p.deviation_mm > bands.high_mm;
    let off = points.iter().filter(beyond).count();
    let every_beyond = off.div_ceil(BEYOND).max(1);
    let kept = off.div_ceil(every_beyond);
    let every_within = (points.len() - off).div_ceil(CARRIED - kept).max(1);
    let shown: Vec<&DeviationPoint> = points
        .iter()
        .filter(|p| !beyond(p))
        .step_by(every_within)
        .chain(points.iter().filter(beyond).step_by(every_beyond))
        .collect();
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in &shown {
        for i in 0..3 {
            low[i] = low[i].min(p.at_mm[i]);
            high[i] = high[i].max(p.at_mm[i]);
        }
    }
    let middle: [f64; 3] = std::array::from_fn(|i| f64::midpoint(low[i], high[i]));
    // Half of the diagonal: whatever the turn, all of it stays in the picture.
    let extent = (0..3)
        .map(|i| (high[i] - low[i]).powi(2))
        .sum::<f64>()
        .sqrt()
        .max(1e-6)
        / 2.0;
    let mut bytes = Vec::with_capacity(shown.len() * 12);
    for p in &shown {
        for (at, middle) in p.at_mm.iter().zip(&middle) {
            bytes.extend(short((at - middle) / extent).to_le_bytes());
        }
        let deviation = (p.deviation_mm - bands.middle_mm()) / (REACH * bands.half_mm());
        // Rounding must not carry a point over an edge that a table counts it on the other side of.
        let band = bands.of(p.deviation_mm);
        let mut deviation = short(deviation);
        while band > 0 && f64::from(deviation) <= edge(band - 1) {
            deviation += 1;
        }
        while band < EDGES.len() && f64::from(deviation) > edge(band) {
            deviation -= 1;
        }
        bytes.extend(deviation.to_le_bytes());
        bytes.extend(
            p.outward
                .map(|o| (o.clamp(-1.0, 1.0) * 127.0).round() as i8 as u8),
        );
        bytes.push(0);
    }
    // As if the points lay on a square of the part's size.
    let spacing = 1.6 / (shown.len().max(1) as f64).sqrt();
    let edges: Vec<String> = (0..EDGES.len())
        .map(|k| format!("{:.8}", edge(k) / 32767.0))
        .collect();
    let canvas = el("canvas")
        .attr("id", "view")
        .attr("tabindex", 0)
        .attr("role", "img")
        .attr(
            "aria-label",
            "The points in three dimensions; the arrow keys turn them",
        )
        .attr("data-extent-mm", format!("{extent:.6}"))
        .attr("data-spacing", format!("{spacing:.6}"))
        .attr("data-edges", edges.join(","))
        .attr("data-colours", COLOURS.join(","))
        .attr("data-points", Base64::encode_string(&bytes));
    let bar = el("div")
        .class("view-scale")
        .child(el("span").attr("id", "view-bar"))
        .child(el("span").attr("id", "view-bar-says"));
    Carried {
        view: el("div").class("turning").child(canvas).child(bar),
        n: shown.len(),
        every_within,
        every_beyond,
    }
}

/// The end of band `k` in 16 bits: half a step off, so that no point lies on it.
fn edge(k: usize) -> f64 {
    (EDGES[k] / REACH * 32767.0).floor() + 0.5
}

fn short(share: f64) -> i16 {
    (share.clamp(-1.0, 1.0) * 32767.0).round() as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attribute<'a>(html: &'a str, name: &str) -> &'a str {
        let from = html.split_once(&format!("{name}=\"")).unwrap().1;
        from.split_once('"').unwrap().0
    }

    /// What the graphics card reads is where the points are, and in the bands that the tables count.
    #[test]
    fn the_bytes_are_the_points() {
        let bands = Bands {
            low_mm: -0.05,
            high_mm: 0.05,
        };
        let points: Vec<DeviationPoint> = (0..2001)
            .map(|k| DeviationPoint {
                at_mm: [
                    f64::from(k) * 0.1 + 700.0,
                    f64::from(k % 7),
                    -f64::from(k % 11),
                ],
                deviation_mm: f64::from(k - 1000) * 1e-4,
                outward: [0.0, 0.6, 0.8],
            })
            .collect();
        let made = view(&points, &bands);
        assert_eq!((made.n, made.every_within, made.every_beyond), (2001, 1, 1));
        let html = made.view.to_string();
        let bytes = Base64::decode_vec(attribute(&html, "data-points")).unwrap();
        assert_eq!(bytes.len(), 2001 * 12);
        let edges: Vec<f64> = attribute(&html, "data-edges")
            .split(',')
            .map(|e| e.parse().unwrap())
            .collect();
        let extent: f64 = attribute(&html, "data-extent-mm").parse().unwrap();
        let word = |at: usize| {
            f64::from(i16::from_le_bytes([bytes[at], bytes[at + 1]]).max(-32767)) / 32767.0
        };
        let sorted = points
            .iter()
            .filter(|p| p.deviation_mm.abs() <= 0.05)
            .chain(points.iter().filter(|p| p.deviation_mm.abs() > 0.05));
        for (k, p) in sorted.enumerate() {
            let at = 12 * k;
            let band = edges.iter().filter(|e| word(at + 6) > **e).count();
            assert_eq!(band, bands.of(p.deviation_mm), "{}", p.deviation_mm);
            assert!((word(at) * extent - (p.at_mm[0] - 800.0)).abs() < extent / 30000.0);
            assert_eq!(&bytes[at + 8..at + 11], &[0, 76, 102]);
        }
    }

    /// Seven million points become what a browser carries, and none beyond the limits is dropped before 20 000.
    #[test]
    fn what_is_too_much_is_thinned() {
        let bands = Bands {
            low_mm: -0.05,
            high_mm: 0.05,
        };
        let points: Vec<DeviationPoint> = (0..300_000)
            .map(|k| DeviationPoint {
                at_mm: [f64::from(k), 0.0, 0.0],
                deviation_mm: if k % 100 == 0 { 0.06 } else { 0.01 },
                outward: [0.0, 0.0, 1.0],
            })
            .collect();
        let made = view(&points, &bands);
        assert!(made.n <= CARRIED && made.n > CARRIED / 2, "{}", made.n);
        assert_eq!(made.every_beyond, 1);
        assert_eq!(made.every_within, 6);
    }

    /// A page may run this script and no other: the hash is of what stands in the page.
    #[test]
    fn the_policy_names_the_script_that_stands_in_the_page() {
        let page = script().to_string();
        let body = page
            .trim_end()
            .strip_prefix("<script>")
            .and_then(|rest| rest.strip_suffix("</script>"))
            .unwrap();
        let hash = Base64::encode_string(&Sha256::digest(body.as_bytes()));
        assert!(policy().contains(&format!("script-src 'sha256-{hash}'")));
        assert!(!body.contains("</") && !body.contains("http") && !body.contains("eval"));
    }
}
