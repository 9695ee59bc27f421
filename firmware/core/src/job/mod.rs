//! The job: hits become features, features a plate, a plate a verdict.
//!
//! [`check()`] says whether a job can be used, [`Run`] carries it out. Both are
//! pure: hits and time in, decisions out.

mod check;
mod diagnose;
mod feature;
mod plate;
mod report;
mod run;

pub use check::{check, datums};
pub use report::{Fitted, fit, refusal};
pub use run::{Decision, Run};

#[cfg(test)]
mod tests;
