//! A spindle with less than a whole turn, planned as one that turns and as one that stands.
//!
//! Courses are laid for a line that can be turned wherever it is wanted. Where the spindle has little room for that, hardly a
//! course can be driven. Standing it has a line to which courses are laid; so is nothing lost by room that cannot be used.

use std::time::Instant;

use super::super::drive::axes::rounded;
use super::super::drive::deadline::Deadline;
use super::super::spec::ScanSpec;
use super::super::verify::same_place;
use super::PlanOptions;
use super::limits::{better, worth_another};
use super::result::ScanPlan;
use crate::ScanError;

/// The best of the plans that `plan` makes with the spindle turning and, where that is not good enough and it has less than
/// a whole turn, standing at either end of its room and in its middle.
///
/// # Errors
/// Those of the plan that sees the most, where none is one; `time_limit` where not all could be tried and none is one.
pub(super) fn best(
    spec: &ScanSpec,
    options: PlanOptions,
    deadline: Deadline,
    plan: impl Fn(&ScanSpec) -> Result<ScanPlan, ScanError>,
) -> Result<ScanPlan, ScanError> {
    let mut begun = Instant::now();
    let mut best = plan(spec);
    let Some([low, high]) = spec.machine.narrow_spindle() else {
        return best;
    };
    let mut angles = vec![(low + high) / 2.0, low, high];
    angles.dedup();
    for angle in angles.into_iter().map(rounded) {
        let enough = !worth_another(spec, options, &best);
        // Without a plan so far, an answer before all is tried would not be true.
        if enough || (best.is_ok() && !deadline.lasts(begun.elapsed() * 2)) {
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

/// The plan of a standing spindle as one of the machine that turns it.
fn turning(spec: &ScanSpec, mut plan: ScanPlan, angle: f64) -> Result<ScanPlan, ScanError> {
    for row in &mut plan.rows {
        row.axes.push(angle);
    }
    same_place(spec, &plan.rows)?;
    Ok(plan)
}
