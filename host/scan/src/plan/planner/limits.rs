//! Steps and turns with which a path is planned, within those that are allowed.
//!
//! Courses are followed and joined at their points. Points far apart miss what shorter steps find, so that a looser limit
//! alone could end worse than a tight one. Beyond a share of the laser line, steps are therefore never longer, whatever is
//! allowed; and what is not good enough is planned again with shorter ones, the better plan is kept.

use std::cell::Cell;

use super::super::drive::deadline::Deadline;
use super::super::spec::ScanSpec;
use super::result::{COVERAGE_UNREACHABLE, ScanPlan};
use crate::ScanError;

/// The longest step, of the line's length.
const STEP_SHARE: f64 = 0.125;

/// A part shorter than the line is gone over in so many steps at least: it may bend as much as a large one.
const SMALL_STEPS: f64 = 24.0;

/// The largest turn in a step.
const TURN_DEG: f64 = 12.0;

/// Way over the bound (area over the line without its overlap) that is good enough.
const GOOD_RATIO: f64 = 1.25;

/// Parts of more triangles are planned again only where they are refused: a long way there is not worth the time.
const MOST_TRIANGLES: usize = 20_000;

/// A plan that is worth another one is better by this share.
const GAIN: f64 = 0.005;

/// Steps and turns, as shares of those that are begun with.
const FINER: [[f64; 2]; 3] = [[0.5, 1.0], [0.5, 0.5], [0.25, 0.5]];

/// Where strips overlap too little, every direction is judged by its overlap; passes lie closer by these shares of the line.
const CARES: [f64; 3] = [0.0, 0.03, 0.1];

/// How large a part is.
#[derive(Debug, Clone, Copy)]
pub(super) struct PartSize {
    /// Triangles of its mesh.
    pub triangles: usize,
    /// How far it reaches.
    pub across_mm: f64,
}

/// The best of the plans that `plan` makes of a specification with its own and with tighter limits, and with care for the
/// overlap where it is too little. `skipped` becomes true where the deadline leaves no time for one of them.
///
/// # Errors
/// Those of the plan that sees the most, where none is one.
pub(super) fn best(
    spec: &ScanSpec,
    size: PartSize,
    deadline: Deadline,
    skipped: &Cell<bool>,
    plan: impl Fn(&ScanSpec, Option<f64>) -> Result<ScanPlan, ScanError>,
) -> Result<ScanPlan, ScanError> {
    let part = if size.across_mm < spec.sensor.line_mm {
        size.across_mm / SMALL_STEPS
    } else {
        f64::INFINITY
    };
    let line = STEP_SHARE * spec.sensor.line_mm;
    let step = spec.plan.max_step_mm.min(line).min(part.max(0.01));
    let turn = spec.plan.max_turn_deg.min(TURN_DEG);
    let with = |[steps, turns]: [f64; 2], care: Option<f64>| {
        let mut inner = spec.clone();
        // No finer than a specification may say.
        inner.plan.max_step_mm = (step * steps).max(0.01_f64.min(step));
        inner.plan.max_turn_deg = (turn * turns).max(0.01_f64.min(turn));
        plan(&inner, care)
    };
    let mut begun = std::time::Instant::now();
    let mut best = with([1.0, 1.0], None);
    let mut care = None;
    for spare in CARES {
        if overlaps(spec, &best) {
            break;
        }
        // Judging takes its time.
        if !deadline.lasts(begun.elapsed() * 4) {
            skipped.set(true);
            break;
        }
        begun = std::time::Instant::now();
        let found = with([1.0, 1.0], Some(spare));
        if better(spec, &found, &best) {
            (best, care) = (found, Some(spare));
        }
    }
    let refused = best.as_ref().map_or(true, |plan| plan.refusal.is_some());
    if !worth_another(spec, &best) || (!refused && size.triangles > MOST_TRIANGLES) {
        return best;
    }
    let took = begun.elapsed();
    for finer in FINER {
        // Shorter steps take longer: twice, about.
        if !deadline.lasts(took * 4) {
            skipped.set(true);
            break;
        }
        let found = with(finer, care);
        let gained = better(spec, &found, &best);
        if gained {
            best = found;
        }
        if !gained || !worth_another(spec, &best) {
            break;
        }
    }
    best
}

/// Is nothing known of strips that overlap too little?
fn overlaps(spec: &ScanSpec, found: &Result<ScanPlan, ScanError>) -> bool {
    match found {
        // What sees too little is not mended by care.
        Ok(plan) => holds(plan) || plan.figures.coverage < spec.plan.min_coverage,
        Err(_) => true,
    }
}

/// Is a plan refused for what finer steps may mend, or long?
pub(super) fn worth_another(spec: &ScanSpec, found: &Result<ScanPlan, ScanError>) -> bool {
    match found {
        Ok(plan) => {
            let figures = &plan.figures;
            let area = plan.area_mm2 * figures.coverage;
            let bound = area / (spec.sensor.line_mm * (1.0 - spec.plan.overlap));
            // A part narrower than the line has no bound by its area.
            let narrow = figures.passes < 3;
            let long = figures.scan_length_mm > GOOD_RATIO * bound && !narrow;
            !plan.beyond_limits && (long || plan.refusal.is_some())
        }
        Err(error) => matches!(
            error.code,
            COVERAGE_UNREACHABLE | "axis_limit" | "plan_unproved"
        ),
    }
}

fn holds(plan: &ScanPlan) -> bool {
    plan.figures.overlap.is_none_or(|o| o.holds())
}

/// Does one plan see enough where the other does not, or see more, or as much in less way?
pub(super) fn better(
    spec: &ScanSpec,
    one: &Result<ScanPlan, ScanError>,
    other: &Result<ScanPlan, ScanError>,
) -> bool {
    let seen = |found: &Result<ScanPlan, ScanError>| match found {
        Ok(plan) => plan.figures.coverage,
        Err(error) => error
            .details
            .get("coverage")
            .and_then(|v| v.as_f64())
            .unwrap_or(0.0),
    };
    let wanted = spec.plan.min_coverage;
    match (one, other) {
        (Ok(one), Ok(other)) => {
            let (a, b) = (&one.figures, &other.figures);
            let [kept, before] = [one, other].map(|plan| plan.refusal.is_none());
            if kept != before {
                return kept;
            }
            let [overlapping, before] = [one, other].map(holds);
            if overlapping != before
                && (a.coverage.min(b.coverage) >= wanted || (a.coverage - b.coverage).abs() <= GAIN)
            {
                return overlapping;
            }
            if a.coverage.min(b.coverage) < wanted {
                return a.coverage.min(wanted) > b.coverage.min(wanted) + GAIN
                    || (a.coverage >= b.coverage
                        && a.scan_length_mm < b.scan_length_mm * (1.0 - GAIN));
            }
            a.scan_length_mm < b.scan_length_mm * (1.0 - GAIN)
        }
        (Ok(_), Err(_)) => true,
        (Err(_), Ok(_)) => false,
        (Err(_), Err(_)) => seen(one) > seen(other) + GAIN,
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::time::{Duration, Instant};

    use super::{COVERAGE_UNREACHABLE, Deadline, PartSize, ScanError, best};

    #[test]
    fn a_try_that_the_time_leaves_out_is_told() {
        let text = include_str!("../../../../../tests/reference/plan/kinematics_ac.toml");
        let spec = super::super::super::tests::spec(text).unwrap();
        let size = PartSize {
            triangles: 2,
            across_mm: 50.0,
        };
        for (limit, left_out) in [(Duration::ZERO, true), (Duration::from_secs(60), false)] {
            let skipped = Cell::new(false);
            let deadline = Deadline::after(Instant::now(), limit);
            let found = best(&spec, size, deadline, &skipped, |_, _| {
                Err(ScanError::refused(COVERAGE_UNREACHABLE, "Nothing is seen."))
            });
            assert!(found.is_err());
            assert_eq!(skipped.get(), left_out);
        }
    }
}
