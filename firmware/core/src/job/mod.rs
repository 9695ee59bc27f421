//! The job: hits become features, features a plate, a plate a verdict.
//!
//! [`check()`] says whether a job can be used, [`Run`] carries it out. Both are
//! pure: hits and time in, decisions out.

mod check;
mod collecting;
mod diagnose;
mod feature;
mod plate;
mod report;
mod run;
mod witness;

pub use check::{check, datums};
pub use report::{Fitted, fit, refusal};
pub use run::{Decision, Run};

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
