//! A spindle that turns the line, planned as one that turns and as one that stands.
//!
//! Courses are laid for a line that can be turned wherever it is wanted. Where the spindle has little room for that, hardly a
//! course can be driven. Standing it has a line to which courses are laid; so is nothing lost by room that cannot be used.
//!
//! The line of a turning spindle lies across its course. A slope that is too steep for the beam is then seen by no course; a line that
//! stands slanted reaches over it from the flat beside it. So where the turning one sees too little, four that stand are tried.

use std::cell::Cell;
use std::time::Instant;

use super::super::drive::axes::rounded;
use super::super::drive::deadline::Deadline;
use super::super::machine::LineSpindle;
use super::super::spec::ScanSpec;
use super::super::verify::same_place;
use super::limits::{better, worth_another};
use super::result::{COVERAGE_UNREACHABLE, ScanPlan};
use crate::ScanError;

/// Standing angles, from the middle of the spindle's room: slanted ones first, as they reach over slopes along either axis. A line
/// is the same after half a turn.
const STANDING_DEG: [f64; 4] = [45.0, 135.0, 0.0, 90.0];

/// The best of the plans that `plan` makes with the spindle turning and, where that is not good enough, standing: at either end
/// of its room and in its middle where it has less than a whole turn; else, where too little is seen, at [`STANDING_DEG`] from its middle.
/// `skipped` becomes true where the deadline leaves no time for one of them.
///
/// # Errors
/// Those of the plan that sees the most, where none is one; `time_limit` where not all could be tried and none is one.
pub(super) fn best(
    spec: &ScanSpec,
    deadline: Deadline,
    skipped: &Cell<bool>,
    plan: impl Fn(&ScanSpec) -> Result<ScanPlan, ScanError>,
) -> Result<ScanPlan, ScanError> {
    let mut begun = Instant::now();
    let mut best = plan(spec);
    let Some(LineSpindle { limits_deg, narrow }) = spec.machine.line_spindle() else {
        return best;
    };
    let [low, high] = limits_deg;
    let middle = (low + high) / 2.0;
    let mut angles = match narrow {
        true => vec![middle, low, high],
        false if sees_enough(spec, &best) => return best,
        false => STANDING_DEG.map(|turn| middle + turn).to_vec(),
    };
    angles.dedup();
    for angle in angles.into_iter().map(rounded) {
        let enough = match narrow {
            true => !worth_another(spec, &best),
            false => sees_enough(spec, &best),
        };
        // Without a plan so far, an answer before all is tried would not be true; a spindle with a whole turn has one.
        let ends = best.is_ok() || !narrow;
        if enough {
            break;
        }
        if ends && !deadline.lasts(begun.elapsed() * 2) {
            skipped.set(true);
            break;
        }
        begun = Instant::now();
        deadline.check()?;
        let mut inner = spec.clone();
        inner.machine = spec.machine.with_spindle_at(angle);
        let found = plan(&inner).and_then(|standing| turning(spec, standing, angle));
        if better(spec, &found, &best) {
            best = found;
        }
    }
    best
}

/// Is there nothing that a slanted line could mend?
fn sees_enough(spec: &ScanSpec, found: &Result<ScanPlan, ScanError>) -> bool {
    match found {
        Ok(plan) => plan.figures.coverage >= spec.plan.min_coverage || plan.beyond_limits,
        Err(error) => error.code != COVERAGE_UNREACHABLE,
    }
}

/// The plan of a standing spindle as one of the machine that turns it.
fn turning(spec: &ScanSpec, mut plan: ScanPlan, angle: f64) -> Result<ScanPlan, ScanError> {
    for row in &mut plan.rows {
        row.axes.push(angle);
    }
    same_place(spec, &plan.rows)?;
    Ok(plan)
}
