//! All clampings of a session in one line each.

use std::fmt::Write as _;

use super::{Paint, dash};
use crate::draw::number::um;
use crate::draw::text::visible;
use crate::figures::{distance_errors, extreme, in_job_order, largest, point_errors, radius_error};
use umi_client::session::{Session, Setup};
use umi_protocol::feature::FitReport;
use umi_protocol::job::FeatureSpec;

/// All clampings in one line each, for the end of a run.
#[must_use]
pub fn summary(session: &Session, colour: bool) -> String {
    let paint = Paint(colour);
    let mut out = String::new();
    if session.setups.is_empty() {
        return out;
    }
    type Column = (&'static str, usize, fn(&Session, &Setup) -> Option<f64>);
    let columns: [Column; 6] = [
        ("max |dr|", 9, |session, setup| {
            extreme(fits(session, setup).filter_map(|(spec, fit)| radius_error(Some(spec), fit)))
        }),
        ("max rms", 8, |session, setup| {
            extreme(fits(session, setup).map(|(_, fit)| fit.rms_mm))
        }),
        ("max |ddist|", 12, |_, setup| {
            extreme(distance_errors(setup))
        }),
        ("reg. rms", 10, |_, setup| {
            setup.verdict.registration.as_ref().map(|r| r.rms_mm)
        }),
        ("path error", 12, |session, setup| {
            let errors = point_errors(session, setup);
            largest(errors.iter().map(|e| e.registration_mm))
        }),
        ("corrected", 10, |session, setup| {
            setup.truth?;
            let errors = point_errors(session, setup);
            largest(errors.iter().map(|e| e.program_mm))
        }),
    ];
    let rows: Vec<[Option<f64>; 6]> = session
        .setups
        .iter()
        .map(|setup| columns.map(|(_, _, of)| of(session, setup)))
        .collect();
    // A column in which nothing is known is left out.
    let known = |column: usize| rows.iter().any(|row| row[column].is_some());
    let mut head = format!("  {:<13}{:<8}", "clamping", "verdict");
    for (number, (title, width, _)) in columns.iter().enumerate() {
        if known(number) {
            let _ = write!(head, "{title:>width$} ");
        }
    }
    let _ = writeln!(out, "{}", paint.quiet(&format!("{head} \u{b5}m")));
    for (setup, row) in session.setups.iter().zip(&rows) {
        let word = if setup.verdict.ok {
            paint.good("OK")
        } else {
            paint.bad("NG")
        };
        let _ = write!(out, "  {:<13}{word}      ", visible(&setup.heading()));
        for (number, (_, width, _)) in columns.iter().enumerate() {
            if known(number) {
                let text = dash(row[number].map(|mm| um(mm.abs())));
                let _ = write!(out, "{text:>width$} ");
            }
        }
        out.truncate(out.trim_end().len());
        out.push('\n');
    }
    out
}

/// The features that were fitted, with what the job says of them.
fn fits<'a>(
    session: &'a Session,
    setup: &'a Setup,
) -> impl Iterator<Item = (&'a FeatureSpec, &'a FitReport)> {
    in_job_order(session, setup).filter_map(|(spec, feature)| Some((spec, feature?.fit.as_ref()?)))
}
