//! A spindle that turns the line, planned as one that turns and as one that stands.
//!
//! Courses are laid for a line that can be turned wherever it is wanted. Where the spindle has little room for that, hardly a
//! course can be driven. Standing it has a line to which courses are laid; so is nothing lost by room that cannot be used.
//!
//! The line of a turning spindle lies across its course. A slope that is too steep for the beam is then seen by no course; a line that
//! stands slanted reaches over it from the flat beside it. So where the turning one sees too little, four that stand are tried.

use std::time::Instant;

use super::super::drive::axes::rounded;
use super::super::machine::LineSpindle;
use super::super::spec::ScanSpec;
use super::super::verify::same_place;
use super::limits::{Tries, better, closes, coverage, worth_another};
use super::result::{COVERAGE_UNREACHABLE, ScanPlan};
use crate::ScanError;

/// Standing angles, from the middle of the spindle's room: slanted ones first, as they reach over slopes along either axis. A line
/// is the same after half a turn.
const STANDING_DEG: [f64; 4] = [45.0, 135.0, 0.0, 90.0];

/// Where so many of them gain little, the others gain nothing.
const SLANTED: usize = 2;

/// The best of the plans that `plan` makes with the spindle turning and, where that is not good enough, standing: at either end
/// of its room and in its middle where it has less than a whole turn; else, where too little is seen, at [`STANDING_DEG`] from its middle.
/// What is planned `again` has the spindle turning or standing as it was.
///
/// # Errors
/// Those of the plan that sees the most, where none is one; `time_limit` where not all could be tried and none is one.
pub(super) fn best(
    spec: &ScanSpec,
    tries: Tries<'_>,
    again: Option<&ScanPlan>,
    plan: impl Fn(&ScanSpec) -> Result<ScanPlan, ScanError>,
) -> Result<ScanPlan, ScanError> {
    let at = |angle: f64| {
        let mut inner = spec.clone();
        inner.machine = spec.machine.with_spindle_at(angle);
        plan(&inner).and_then(|standing| turning(spec, standing, angle))
    };
    match again.map(|plan| plan.stands_at_deg) {
        Some(Some(angle)) => return at(angle),
        Some(None) => return plan(spec),
        None => {}
    }
    let mut begun = Instant::now();
    let mut best = plan(spec);
    let turning_sees = coverage(&best);
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
    for (tried, angle) in angles.into_iter().map(rounded).enumerate() {
        let enough = match narrow {
            true => !worth_another(spec, &best, tries),
            false => {
                let slanted = tried >= SLANTED && !closes(spec, &best, turning_sees);
                slanted || sees_enough(spec, &best)
            }
        };
        // Without a plan so far, an answer before all is tried would not be true; a spindle with a whole turn has one.
        let ends = best.is_ok() || !narrow;
        if enough {
            break;
        }
        if ends && !tries.lasts(begun.elapsed() * 2) {
            break;
        }
        begun = Instant::now();
        tries.deadline.check()?;
        let found = at(angle);
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
    plan.stands_at_deg = Some(angle);
    Ok(plan)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::super::super::drive::deadline::Deadline;
    use super::super::super::tests::{SPEC, spec};
    use super::{COVERAGE_UNREACHABLE, ScanError, Tries, best};

    /// Where two slanted lines close little of the gap, the other standing angles are not planned; where one closes more, they are.
    #[test]
    fn standing_angles_end_where_slanted_ones_gain_little() {
        let spec = spec(SPEC).unwrap();
        let wanted = spec.plan.min_coverage;
        for (slanted, plans) in [(wanted - 0.48, 3), (wanted - 0.4, 5)] {
            let (skipped, count) = (Cell::new(false), Cell::new(0));
            let tries = Tries {
                deadline: Deadline::never(),
                skipped: &skipped,
                partial: true,
            };
            let found = best(&spec, tries, None, |_| {
                let coverage = match count.replace(count.get() + 1) {
                    1 => slanted,
                    _ => wanted - 0.5,
                };
                Err(ScanError::refused(COVERAGE_UNREACHABLE, "Little is seen.")
                    .with("coverage", coverage))
            });
            assert!(found.is_err());
            assert_eq!(count.get(), plans, "{slanted}");
        }
    }
}
