//! Where an axis was at a moment beside a latch.

use crate::format::triggers::TriggerLatch;

/// The counts of an axis `latency_us` after the latch at a place: on the straight line between
/// the latches on either side of that moment, at the ends through the last two.
///
/// A latch without counts of the axis counts as 0; the caller has made sure there is none.
pub(super) fn counts_at(
    latches: &[TriggerLatch],
    place: usize,
    axis: usize,
    latency_us: f64,
) -> f64 {
    let counts = |place: usize| latches[place].counts[axis].unwrap_or(0);
    if latency_us == 0.0 || latches.len() < 2 {
        return counts(place) as f64;
    }
    let origin_ns = latches[place].t_ns;
    let since_ns = |place: usize| latches[place].t_ns.saturating_sub(origin_ns) as f64;
    let moment_ns = latency_us * 1e3;
    // The last latch at or before the moment, but never the last of all.
    let behind =
        latches.partition_point(|latch| latch.t_ns.saturating_sub(origin_ns) as f64 <= moment_ns);
    let left = behind.saturating_sub(1).min(latches.len() - 2);
    let right = left + 1;
    let share = (moment_ns - since_ns(left)) / (since_ns(right) - since_ns(left));
    counts(left) as f64 + share * counts(right).saturating_sub(counts(left)) as f64
}

/// The latches on either side of a moment, and the share of the way between them; none where
/// the moment is before the first or behind the last.
pub(super) fn between(latches: &[TriggerLatch], t_ns: f64) -> Option<(usize, f64)> {
    // Differences from the first keep their nanoseconds, however late the clock is.
    let origin_ns = latches.first()?.t_ns;
    let since_ns = |latch: &TriggerLatch| latch.t_ns.saturating_sub(origin_ns) as f64;
    let moment_ns = t_ns - origin_ns as f64;
    let behind = latches.partition_point(|latch| since_ns(latch) <= moment_ns);
    let left = behind.checked_sub(1)?;
    let (a, b) = (since_ns(&latches[left]), since_ns(latches.get(behind)?));
    Some((left, (moment_ns - a) / (b - a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn latches(rows: &[(i64, i64)]) -> Vec<TriggerLatch> {
        let latch = |&(t_ns, x): &(i64, i64)| TriggerLatch {
            number: 0,
            t_ns,
            counts: [Some(x), None, None, None, None, None],
        };
        rows.iter().map(latch).collect()
    }

    #[test]
    fn a_moment_is_between_two_latches_or_nowhere() {
        let latches = latches(&[(1_000_000, 0), (2_000_000, 100), (4_000_000, 900)]);
        assert_eq!(between(&latches, 2_500_000.0), Some((1, 0.25)));
        assert_eq!(between(&latches, 1_000_000.0), Some((0, 0.0)));
        assert_eq!(between(&latches, 999_999.0), None);
        assert_eq!(between(&latches, 4_000_000.0), None);
        assert_eq!(between(&[], 0.0), None);
    }

    #[test]
    fn a_moment_lies_on_the_line_between_its_neighbours_on_either_side() {
        let latches = latches(&[(1_000_000, 0), (2_000_000, 100), (4_000_000, 900)]);
        let at = |place, latency_us| counts_at(&latches, place, 0, latency_us);
        assert_eq!(at(1, 0.0), 100.0);
        assert_eq!(at(1, 500.0), 300.0);
        assert_eq!(at(1, -500.0), 50.0);
        // Across a whole interval, and beyond both ends.
        assert_eq!(at(0, 1500.0), 300.0);
        assert_eq!(at(2, 1000.0), 1300.0);
        assert_eq!(at(0, -1000.0), -100.0);
    }
}
