//! All clampings of a session in one line each.

use std::fmt::Write as _;

use super::{Paint, dash};
use crate::report::figures::{
    distance_errors, extreme, in_job_order, largest, point_errors, radius_error,
};
use crate::report::model::Session;
use crate::report::number::um;
use crate::report::text::visible;

/// All clampings in one line each, for the end of a run.
#[must_use]
pub fn summary(session: &Session, colour: bool) -> String {
    let paint = Paint(colour);
    let mut out = String::new();
    let head = format!(
        "  {:<13}{:<8}{:>9} {:>8} {:>12} {:>10} {:>12} {:>10}",
        "clamping",
        "verdict",
        "max |dr|",
        "max rms",
        "max |ddist|",
        "reg. rms",
        "path error",
        "corrected"
    );
    let _ = writeln!(out, "{}", paint.quiet(&format!("{head}  \u{b5}m")));
    for plate in &session.plates {
        let fits = || in_job_order(session, plate).filter_map(|(s, f)| Some((s, f?.fit.as_ref()?)));
        let radius = extreme(fits().filter_map(|(s, f)| radius_error(Some(s), f)));
        let rms = extreme(fits().map(|(_, f)| f.rms_mm));
        let distance = extreme(distance_errors(plate));
        let errors = point_errors(session, plate);
        let known = plate.truth.is_some();
        let path = largest(errors.iter().map(|e| e.registration_mm));
        let program = largest(errors.iter().map(|e| e.program_mm)).filter(|_| known);
        let word = if plate.verdict.ok {
            paint.good("OK")
        } else {
            paint.bad("NG")
        };
        let _ = writeln!(
            out,
            "  {:<13}{word}      {:>9} {:>8} {:>12} {:>10} {:>12} {:>10}",
            visible(&plate.heading()),
            dash(radius.map(|v| um(v.abs()))),
            dash(rms.map(um)),
            dash(distance.map(|v| um(v.abs()))),
            dash(plate.verdict.registration.as_ref().map(|r| um(r.rms_mm))),
            dash(path.map(um)),
            dash(program.map(um)),
        );
    }
    out
}
