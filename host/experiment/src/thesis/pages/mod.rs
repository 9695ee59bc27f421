//! The pages on an experiment: the thesis' tables and the surface that was cut.

mod experiment;
mod map;
mod polar;
mod thesis_tables;

use crate::thesis::outcome::{ExperimentOutcome, ExperimentSummary};

/// The report of an experiment: that of its session, with the finished surface and the
/// thesis' tables before the clampings.
#[must_use]
pub fn html(outcome: &ExperimentOutcome, seeds: &[ExperimentSummary]) -> String {
    umi_report::pages::session::html_with(
        &outcome.session,
        &experiment::result(outcome),
        Some(experiment::first_pictures(outcome)),
        experiment::sections(outcome, seeds),
    )
}
