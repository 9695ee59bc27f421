//! The job: hits become features, features a setup, a setup a verdict.
//!
//! [`check()`] says whether a job can be used, [`Run`] carries it out. Both are
//! pure: hits and time in, decisions out.

mod check;
mod collecting;
mod diagnose;
mod feature;
mod reasons;
mod report;
mod run;
mod scatter;
mod setup;
mod witness;

use umi_protocol::job::Job;

use crate::units::Point;

pub use check::{
    begins_anew, check, closing, datums, fixed, judges_touches, looks_at_falls, moves_something,
    not_guarded, says_run, touch_begins_anew, touches_again,
};
pub use report::{Fitted, fit, refusal};
pub use run::{Decision, Run, Teaching, is_coarse};
pub use scatter::beta_ratio;
pub use witness::skip;

/// Whether the job's limits stand against a setup whose places are `measured`: judged as on the
/// board, with hits that are taken as exact. Both hold the datum places.
#[must_use]
pub fn against_places(job: &Job, reference: &[Point], measured: &[Point]) -> bool {
    let mut verdict = setup::blank(1);
    setup::judge(&mut verdict, job, reference, measured, None, None);
    !verdict.reasons.is_empty()
}

/// Whether a value breaks its limit. A value that is not a number does.
#[allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "`value > limit` would let NaN pass"
)]
fn exceeds(value: f64, limit: f64) -> bool {
    !(value <= limit)
}

#[cfg(test)]
mod tests;
