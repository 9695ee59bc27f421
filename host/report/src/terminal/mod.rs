//! The compact table of one clamping for a terminal of 100 columns.

use std::fmt::Write as _;

use umi_protocol::feature::FeatureResult;
use umi_protocol::job::FeatureSpec;

use crate::draw::number::{fixed, mm, signed, um, um_signed};
use crate::draw::text::visible;
use crate::figures::{
    PointError, Vector, half_sigma, in_job_order, length, motion, point_errors, pose_error,
    radius_error, shift_mm, sphere_uncertainty, turn_and_tilt_deg,
};
use umi_client::session::{Session, Setup};

pub mod ink;
mod summary;

pub use summary::summary;

/// Columns that a line may take, where no reason is longer.
pub const WIDTH: usize = 100;

/// Colours of the terminal, or none.
#[derive(Clone, Copy)]
struct Paint(bool);

impl Paint {
    fn with(self, code: &str, text: &str) -> String {
        if self.0 {
            ink::coloured(code, text)
        } else {
            text.into()
        }
    }
    fn good(self, text: &str) -> String {
        self.with("1;32", text)
    }
    fn bad(self, text: &str) -> String {
        self.with("1;31", text)
    }
    fn strong(self, text: &str) -> String {
        self.with("1", text)
    }
    fn quiet(self, text: &str) -> String {
        self.with("2", text)
    }
}

/// All clampings, one after the other.
#[must_use]
pub fn session(session: &Session, colour: bool) -> String {
    (0..session.setups.len())
        .map(|place| setup(session, place, colour))
        .collect::<Vec<_>>()
        .join("\n")
}

/// One clamping: fits, distances, registration (against the true answer where
/// it is known), correction, verdict. Lines end with LF; `place` counts in
/// `session.setups`, and a place that is not there gives an empty text.
#[must_use]
pub fn setup(session: &Session, place: usize, colour: bool) -> String {
    let Some(setup) = session.setups.get(place) else {
        return String::new();
    };
    let paint = Paint(colour);
    let mut out = String::new();
    // Writing to a String cannot fail; so for every line below.
    let _ = writeln!(out, "{}", title(setup, paint));
    fits(&mut out, session, setup, paint);
    distances(&mut out, session, setup, paint);
    registration(&mut out, session, setup, place);
    truth(&mut out, session, setup);
    correction(&mut out, session, setup);
    verdict(&mut out, setup, paint);
    out
}

fn title(setup: &Setup, paint: Paint) -> String {
    let heading = visible(&setup.heading());
    let about = visible(&setup.about);
    let used = heading.chars().count() + about.chars().count() + 6;
    let rule = "\u{2500}".repeat(WIDTH.saturating_sub(used));
    if about.is_empty() {
        format!("{} {}", paint.strong(&heading), paint.quiet(&rule))
    } else {
        format!("{}  {about} {}", paint.strong(&heading), paint.quiet(&rule))
    }
}

fn line(out: &mut String, label: &str, text: &str) {
    let _ = writeln!(out, "  {label:<12}{text}");
}

fn fits(out: &mut String, session: &Session, setup: &Setup, paint: Paint) {
    let head = format!(
        "  {:<12}{:>10} {:>10} {:>10} {:>8} {:>6} {:>6} {:>5} {:>5} {:>5} {:>5} {:>5}",
        "feature",
        "x/mm",
        "y/mm",
        "z/mm",
        "r/mm",
        "dr/\u{b5}m",
        "rms/\u{b5}m",
        "s/\u{b5}m",
        "ux/\u{b5}m",
        "uy/\u{b5}m",
        "uz/\u{b5}m",
        "\u{bd}s/\u{b5}m"
    );
    let _ = writeln!(out, "{}", paint.quiet(&head));
    for (spec, feature) in in_job_order(session, setup) {
        // What is wrong with it stands below, in the verdict.
        let wrong = if feature.is_some_and(FeatureResult::is_ok) {
            ""
        } else {
            " \u{2717}"
        };
        let text = match feature {
            None => paint.bad("did not arrive"),
            Some(feature) => fit(session, spec, feature, paint),
        };
        line(out, &format!("{}{wrong}", visible(&spec.name)), &text);
    }
}

fn fit(session: &Session, spec: &FeatureSpec, feature: &FeatureResult, paint: Paint) -> String {
    let Some(fit) = &feature.fit else {
        let hits = feature.points_mm.len();
        return paint.bad(&format!(
            "refused, not fitted ({hits} of {} hits)",
            spec.hits
        ));
    };
    let Some([x, y, z]) = fit.shape.position_mm() else {
        return format!(
            "{:<10} {} hits, rms {} \u{b5}m, s {} \u{b5}m",
            format!("{:?}", feature.kind).to_lowercase(),
            feature.points_mm.len(),
            um(fit.rms_mm),
            dash(fit.sigma_mm.map(um))
        );
    };
    let error = radius_error(Some(spec), fit);
    let limits = &session.job.limits;
    let within = |ok: bool, text: String| {
        let text = format!("{text:>6}");
        if ok { text } else { paint.bad(&text) }
    };
    let mut text = format!(
        "{:>10} {:>10} {:>10} {:>8} {} {} {:>5}",
        mm(x),
        mm(y),
        mm(z),
        dash(fit.shape.radius_mm().map(mm)),
        within(
            error.is_none_or(|e| e.abs() <= limits.radius_error_mm),
            dash(error.map(um_signed))
        ),
        within(fit.rms_mm <= limits.rms_mm, um(fit.rms_mm)),
        dash(fit.sigma_mm.map(um)),
    );
    let u = sphere_uncertainty(fit);
    for axis in 0..3 {
        let _ = write!(text, " {:>5}", dash(u.map(|u| um(u[axis]))));
    }
    let _ = write!(text, " {:>5}", dash(half_sigma(fit).map(um)));
    text
}

fn distances(out: &mut String, session: &Session, setup: &Setup, paint: Paint) {
    let limit = session.job.limits.distance_error_mm;
    let texts: Vec<String> = setup
        .verdict
        .distances
        .iter()
        .map(|d| {
            let pair = visible(&format!("{}-{}", short(&d.a), short(&d.b)));
            match d.reference_mm.map(|r| d.measured_mm - r) {
                None => format!("{pair} {}", mm(d.measured_mm)),
                Some(error) => {
                    let text = format!("({})", um_signed(error));
                    let text = if error.abs() <= limit {
                        text
                    } else {
                        paint.bad(&text)
                    };
                    format!("{pair} {} {text}", mm(d.measured_mm))
                }
            }
        })
        .collect();
    // Three pairs fit into a line; eight datums have 28.
    for (i, three) in texts.chunks(3).enumerate() {
        let label = if i == 0 { "distances" } else { "" };
        let unit = if i == 0 { "  mm (\u{b5}m)" } else { "" };
        line(out, label, &format!("{}{unit}", three.join("   ")));
    }
}

/// The number of "SPHERE1", or the name where it has none.
fn short(name: &str) -> &str {
    match name.find(|c: char| c.is_ascii_digit()) {
        Some(at) if name[at..].bytes().all(|b| b.is_ascii_digit()) => &name[at..],
        _ => name,
    }
}

fn registration(out: &mut String, session: &Session, setup: &Setup, place: usize) {
    let Some(registration) = &setup.verdict.registration else {
        return;
    };
    let (turn, tilt) = turn_and_tilt_deg(registration);
    let shift = shift_mm(session, place).map(|s| {
        let [x, y, z] = s.map(|c| signed(c, 4));
        format!(", shift {x} {y} {z} mm")
    });
    line(
        out,
        "registered",
        &format!(
            "turn {}\u{b0}, tilt {}\u{b0}{}, rms {} \u{b5}m",
            signed(turn, 5),
            fixed(tilt, 5),
            shift.unwrap_or_default(),
            um(registration.rms_mm)
        ),
    );
}

fn truth(out: &mut String, session: &Session, setup: &Setup) {
    let (Some(registration), Some(truth)) = (&setup.verdict.registration, &setup.truth) else {
        return;
    };
    let error = pose_error(registration, truth);
    let errors = point_errors(session, setup);
    let mut text = format!(
        "rotation error {} \u{b5}rad",
        fixed(error.angle_rad * 1e6, 1)
    );
    if let Some((point, mm)) = worst(&errors, |e| e.registration_mm) {
        let _ = write!(text, ", path {} \u{b5}m at {}", um(mm), place_text(point));
    }
    if let Some((point, mm)) = worst(&errors, |e| e.program_mm) {
        let _ = write!(
            text,
            ", corrected {} \u{b5}m at {}",
            um(mm),
            place_text(point)
        );
    }
    line(out, "true answer", &text);
}

/// The point with the largest error, and that error.
fn worst(
    errors: &[PointError],
    of: impl Fn(&PointError) -> Option<Vector>,
) -> Option<(Vector, f64)> {
    errors
        .iter()
        .filter_map(|e| Some((e.point_mm, length(of(e)?))))
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

fn place_text(point: Vector) -> String {
    let [x, y, z] = point.map(|c| fixed(c, 0));
    format!("({x} {y} {z})")
}

fn correction(out: &mut String, session: &Session, setup: &Setup) {
    let Some(correction) = &setup.verdict.correction else {
        return;
    };
    let mut text = format!("dialect {}", correction.dialect.name());
    if let (Some(motion), Some(spec)) = (motion(session, setup), &session.job.correction) {
        let [x, y, z] = motion.offset_mm.map(|c| signed(c, 3));
        text = format!(
            "{} = {} {x} {y} {z} mm, rotation {}\u{b0}",
            spec.write_to,
            spec.probed_in,
            signed(motion.angle_deg, 3)
        );
    }
    let _ = write!(
        text,
        "; leaves {} \u{b5}m at the part",
        um(correction.leftover_mm)
    );
    line(out, "correction", &text);
}

fn verdict(out: &mut String, setup: &Setup, paint: Paint) {
    let verdict = &setup.verdict;
    if verdict.ok {
        let says = if setup.is_taught() {
            "  this clamping is the reference"
        } else {
            ""
        };
        line(out, "verdict", &format!("{}{says}", paint.good("OK")));
    } else {
        line(
            out,
            "verdict",
            &format!("{}  no correction", paint.bad("NG")),
        );
    }
    for reason in &verdict.reasons {
        let _ = writeln!(
            out,
            "    {} {}",
            paint.bad("\u{2717}"),
            visible(&reason.to_string())
        );
    }
    if verdict.reasons_dropped > 0 {
        let _ = writeln!(out, "    and {} more reasons", verdict.reasons_dropped);
    }
    for remark in &verdict.remarks {
        if remark.reason != umi_protocol::reason::Reason::Taught {
            let text = visible(&remark.to_string());
            let mut lines = folded(&text, WIDTH - REMARK.len() - 5).into_iter();
            let first = lines.next().unwrap_or_default();
            let _ = writeln!(out, "    {} {first}", paint.quiet(REMARK));
            for line in lines {
                let _ = writeln!(out, "    {:width$} {line}", "", width = REMARK.len());
            }
        }
    }
}

/// Before a remark.
const REMARK: &str = "remark:";

/// The words of a text in lines of so many characters at most; a longer word stands alone.
fn folded(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

fn dash(text: Option<String>) -> String {
    text.unwrap_or_else(|| "-".into())
}

#[cfg(test)]
mod tests;
