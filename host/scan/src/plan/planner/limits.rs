//! Steps and turns with which a path is planned, within those that are allowed.
//!
//! Courses are followed and joined at their points. Points far apart miss what shorter steps find, so that a looser limit
//! alone could end worse than a tight one. Beyond a share of the laser line, steps are therefore never longer, whatever is
//! allowed; and what is not good enough is planned again with shorter ones, the better plan is kept.

use std::cell::Cell;
use std::time::Duration;

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

/// A try that closes less than this share of the gap to the wanted coverage says that what is left is not for its like to mend:
/// a wall that touches, a slope that no beam meets.
const CLOSES: f64 = 0.05;

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

/// How long plans are tried, and what for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tries<'a> {
    /// When to end.
    pub deadline: Deadline,
    /// Becomes true where the deadline leaves no time for a try.
    pub skipped: &'a Cell<bool>,
    /// What sees more is wanted, though it may not see enough.
    pub partial: bool,
}

impl Tries<'_> {
    /// Is there so much time for another? If not, that is noted.
    pub(super) fn lasts(self, time: Duration) -> bool {
        let lasts = self.deadline.lasts(time);
        if !lasts {
            self.skipped.set(true);
        }
        lasts
    }
}

/// The best of the plans that `plan` makes of a specification with its own and with tighter limits, and with care for the
/// overlap where it is too little. What is planned again with tighter limits is given to `plan`: its spindle stands or turns as
/// before.
///
/// # Errors
/// Those of the plan that sees the most, where none is one.
pub(super) fn best(
    spec: &ScanSpec,
    size: PartSize,
    tries: Tries<'_>,
    plan: impl Fn(&ScanSpec, Option<f64>, Option<&ScanPlan>) -> Result<ScanPlan, ScanError>,
) -> Result<ScanPlan, ScanError> {
    let part = if size.across_mm < spec.sensor.line_mm {
        size.across_mm / SMALL_STEPS
    } else {
        f64::INFINITY
    };
    let line = STEP_SHARE * spec.sensor.line_mm;
    let step = spec.plan.max_step_mm.min(line).min(part.max(0.01));
    let turn = spec.plan.max_turn_deg.min(TURN_DEG);
    let with = |[steps, turns]: [f64; 2], care: Option<f64>, again: Option<&ScanPlan>| {
        let mut inner = spec.clone();
        // No finer than a specification may say.
        inner.plan.max_step_mm = (step * steps).max(0.01_f64.min(step));
        inner.plan.max_turn_deg = (turn * turns).max(0.01_f64.min(turn));
        plan(&inner, care, again)
    };
    let mut begun = std::time::Instant::now();
    let mut best = with([1.0, 1.0], None, None);
    let mut care = None;
    for spare in CARES {
        if overlaps(spec, &best) {
            break;
        }
        // Judging takes its time.
        if !tries.lasts(begun.elapsed() * 4) {
            break;
        }
        begun = std::time::Instant::now();
        let found = with([1.0, 1.0], Some(spare), None);
        if better(spec, &found, &best) {
            (best, care) = (found, Some(spare));
        }
    }
    let refused = best.as_ref().map_or(true, |plan| plan.refusal.is_some());
    if !worth_another(spec, &best, tries) || (!refused && size.triangles > MOST_TRIANGLES) {
        return best;
    }
    let took = begun.elapsed();
    for finer in FINER {
        // Shorter steps take longer: twice, about.
        if !tries.lasts(took * 4) {
            break;
        }
        let found = with(finer, care, best.as_ref().ok());
        let gained = better(spec, &found, &best);
        let closing = closes(spec, &found, coverage(&best));
        if gained {
            best = found;
        }
        if !gained || !closing || !worth_another(spec, &best, tries) {
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

/// Is a plan refused for what finer steps may mend, or long? Where it may be partial, what lies beyond the axes is no reason
/// against another that sees more.
pub(super) fn worth_another(
    spec: &ScanSpec,
    found: &Result<ScanPlan, ScanError>,
    tries: Tries<'_>,
) -> bool {
    match found {
        Ok(plan) => {
            let figures = &plan.figures;
            let area = plan.area_mm2 * figures.coverage;
            let bound = area / (spec.sensor.line_mm * (1.0 - spec.plan.overlap));
            // A part narrower than the line has no bound by its area.
            let narrow = figures.passes < 3;
            let long = figures.scan_length_mm > GOOD_RATIO * bound && !narrow;
            (tries.partial || !plan.beyond_limits) && (long || plan.refusal.is_some())
        }
        Err(error) => matches!(
            error.code,
            COVERAGE_UNREACHABLE | "axis_limit" | "plan_unproved"
        ),
    }
}

/// What is seen, also by what is refused.
pub(super) fn coverage(found: &Result<ScanPlan, ScanError>) -> f64 {
    match found {
        Ok(plan) => plan.figures.coverage,
        Err(error) => error
            .details
            .get("coverage")
            .and_then(|v| v.as_f64())
            .unwrap_or(0.0),
    }
}

/// Does a plan close enough of the gap that is left from `before` to the wanted coverage, if there is one?
pub(super) fn closes(spec: &ScanSpec, found: &Result<ScanPlan, ScanError>, before: f64) -> bool {
    let gap = spec.plan.min_coverage - before;
    gap <= 0.0 || coverage(found) - before >= CLOSES * gap
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
        (Err(_), Err(_)) => coverage(one) > coverage(other) + GAIN,
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::time::{Duration, Instant};

    use super::super::super::tests::{SPEC, spec};
    use super::{COVERAGE_UNREACHABLE, Deadline, PartSize, ScanError, Tries, best};

    /// How many plans are made where each sees so much more than the one before, and whether one was left out for want of time.
    fn tries(deadline: Deadline, gain: f64) -> (usize, bool) {
        let spec = spec(SPEC).unwrap();
        let size = PartSize {
            triangles: 2,
            across_mm: 50.0,
        };
        let (skipped, count) = (Cell::new(false), Cell::new(0));
        let tries = Tries {
            deadline,
            skipped: &skipped,
            partial: true,
        };
        let first = spec.plan.min_coverage - 0.5;
        let found = best(&spec, size, tries, |_, _, _| {
            let coverage = first + gain * count.replace(count.get() + 1) as f64;
            Err(ScanError::refused(COVERAGE_UNREACHABLE, "Little is seen.")
                .with("coverage", coverage))
        });
        assert!(found.is_err());
        (count.get(), skipped.get())
    }

    #[test]
    fn a_try_that_the_time_leaves_out_is_told() {
        let after = |limit| Deadline::after(Instant::now(), limit);
        assert_eq!(tries(after(Duration::ZERO), 0.0), (1, true));
        assert_eq!(tries(after(Duration::from_secs(60)), 0.0), (2, false));
    }

    /// A finer try that closes a twenty-fifth of the gap is the last one; one that closes more is followed by others.
    #[test]
    fn a_gap_that_a_finer_try_hardly_closes_ends_the_tries() {
        assert_eq!(tries(Deadline::never(), 0.02).0, 2);
        assert_eq!(tries(Deadline::never(), 0.03).0, 4);
    }
}
