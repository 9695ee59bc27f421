//! Times that stand apart from the scan: no shift that could be the right one gives them a partner.
//!
//! One damaged stamp, days off the others, makes the scan days long: every search over offsets and drifts then has
//! that room to look through, and the digits of all other times go. So it is left out before.
//!
//! # Design
//! A pairing that counts explains half of the shorter stream, `need` pairs. Take a window of each train that leaves out
//! fewer than `need` times of both together: then one pair at least joins the windows, and says within their lengths where
//! every other time must have its partner. A time with nothing there has none. Nothing that any such shift explains is
//! left out by that.
//!
//! What is left of both may agree by chance, days away. A scan is no longer than [`LONGEST_SCAN_US`].

use std::ops::RangeInclusive;

/// The longest that a scan takes, eleven days: beyond it the clocks' digits and drift tell nothing.
pub(super) const LONGEST_SCAN_US: f64 = 1e12;
/// Drifts of this are looked at, too, to say why nothing matches.
const DRIFT: f64 = 0.04;
/// So many times all are looked at: what one side loses helps the other.
const ROUNDS: usize = 8;
/// No clock shows more; differences of times stay numbers.
const MOST_US: f64 = 1e150;

/// The places of the times, in rising order, that may have a partner, of both trains.
pub(super) fn within_reach(
    sensor: &[f64],
    board: &[f64],
    jitter_us: f64,
    need: usize,
) -> (Vec<usize>, Vec<usize>) {
    let mut kept: (Vec<usize>, Vec<usize>) =
        ((0..sensor.len()).collect(), (0..board.len()).collect());
    let spare = need.saturating_sub(1);
    for _ in 0..ROUNDS {
        let before = (kept.0.len(), kept.1.len());
        for (of_sensor, of_board) in [(spare, 0), (0, spare), (spare / 2, spare / 2)] {
            let times = |all: &[f64], places: &[usize]| -> Vec<f64> {
                let at = places.iter().map(|&place| all[place]);
                at.map(|t| t.clamp(-MOST_US, MOST_US)).collect()
            };
            let (s, b) = (times(sensor, &kept.0), times(board, &kept.1));
            let (Some(of_s), Some(of_b)) = (densest(&s, of_sensor), densest(&b, of_board)) else {
                return kept;
            };
            let (core_s, core_b) = (
                s[*of_s.start()]..=s[*of_s.end()],
                b[*of_b.start()]..=b[*of_b.end()],
            );
            let has_partner = |i: usize,
                               times: &[f64],
                               own: &RangeInclusive<f64>,
                               others: &[f64],
                               other: &RangeInclusive<f64>| {
                partner(times[i], own, others, other, jitter_us)
            };
            let mut place = 0..s.len();
            kept.0.retain(|_| {
                let i = place.next().unwrap_or_default();
                of_s.contains(&i) || has_partner(i, &s, &core_s, &b, &core_b)
            });
            let mut place = 0..b.len();
            kept.1.retain(|_| {
                let i = place.next().unwrap_or_default();
                of_b.contains(&i) || has_partner(i, &b, &core_b, &s, &core_s)
            });
        }
        if before == (kept.0.len(), kept.1.len()) {
            break;
        }
    }
    for (times, places) in [(sensor, &mut kept.0), (board, &mut kept.1)] {
        let left: Vec<f64> = places.iter().map(|&place| times[place]).collect();
        if let Some(core) = densest(&left, spare / 2) {
            let (first, last) = (left[*core.start()], left[*core.end()]);
            places.retain(|&place| {
                times[place] >= first - LONGEST_SCAN_US && times[place] <= last + LONGEST_SCAN_US
            });
        }
    }
    kept
}

/// Whether the other train has a time where the partner of `t` must be, if the windows share a pair.
fn partner(
    t: f64,
    own: &RangeInclusive<f64>,
    others: &[f64],
    other: &RangeInclusive<f64>,
    jitter_us: f64,
) -> bool {
    // From the window's far end and from its near end.
    let apart = [t - own.start(), t - own.end()];
    let reach = |us: f64, sign: f64| us + sign * (DRIFT * us.abs() + 4.0 * jitter_us);
    let least = other.start() + reach(apart[0].min(apart[1]), -1.0);
    let most = other.end() + reach(apart[0].max(apart[1]), 1.0);
    let place = others.partition_point(|&time| time < least);
    others.get(place).is_some_and(|&time| time <= most)
}

/// The shortest window that leaves out so many of the times: places of its first and its last.
fn densest(times: &[f64], spare: usize) -> Option<RangeInclusive<usize>> {
    let left = times.len().checked_sub(spare).filter(|left| *left > 0)?;
    let length = |begin: &usize| times[begin + left - 1] - times[*begin];
    let begin = (0..=spare).min_by(|a, b| length(a).total_cmp(&length(b)))?;
    Some(begin..=begin + left - 1)
}

/// Whether any shift could join `need` pairs: as many times of each train stand within the length of the other.
pub(super) fn could_pair(
    sensor: &[f64],
    board: &[f64],
    (jitter_us, drift): (f64, f64),
    need: usize,
) -> bool {
    let length = |times: &[f64]| match times {
        [first, .., last] => last - first,
        _ => 0.0,
    };
    let has = |times: &[f64], us: f64| {
        let within = us * (1.0 + 2.0 * drift) + 4.0 * jitter_us;
        need == 0 || times.windows(need).any(|some| length(some) <= within)
    };
    need <= sensor.len().min(board.len())
        && has(sensor, length(board))
        && has(board, length(sensor))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_shift_can_pair_is_left_out_and_nothing_else() {
        let train = |n: usize| -> Vec<f64> { (0..n).map(|i| 5000.0 * i as f64).collect() };
        let kept = |sensor: &[f64], board: &[f64]| {
            let need = sensor.len().min(board.len()).div_ceil(2);
            let (s, b) = within_reach(sensor, board, 20.0, need);
            (s.len(), b.len())
        };
        assert_eq!(kept(&train(40), &train(40)), (40, 40));
        // The board began later and ended later; a pause of a day that both saw.
        let later: Vec<f64> = train(40).iter().map(|t| t + 7e9).collect();
        assert_eq!(kept(&train(30), &later), (30, 40));
        let paused: Vec<f64> = train(40)
            .iter()
            .map(|t| if *t > 1.5e5 { t + 8.64e10 } else { *t })
            .collect();
        assert_eq!(kept(&paused, &paused), (40, 40));
        // Wild ones of either side, of both, and of both at one time.
        for wild in [1e9, 9e12, 9e15, 1.8e19, 1e308] {
            let with = |more: &[f64]| {
                let mut times = train(40);
                times.extend(more);
                times.sort_by(f64::total_cmp);
                times
            };
            let far = [wild, -wild, 0.7 * wild];
            assert_eq!(kept(&with(&far), &train(40)), (40, 40), "{wild}");
            assert_eq!(kept(&train(40), &with(&far)), (40, 40), "{wild}");
            assert_eq!(
                kept(&with(&[wild]), &with(&[0.6 * wild])),
                (40, 40),
                "{wild}"
            );
            if wild > LONGEST_SCAN_US {
                assert_eq!(kept(&with(&far), &with(&far)), (40, 40), "{wild}");
            }
        }
    }

    #[test]
    fn a_train_of_other_units_cannot_pair() {
        let train = |us: f64| -> Vec<f64> { (0..40).map(|i| us * f64::from(i)).collect() };
        let could = |us: f64| could_pair(&train(us), &train(5000.0), (20.0, 2e-4), 20);
        assert!(could(5000.0) && could(9000.0) && could(2600.0));
        assert!(!could(5.0) && !could(5e6));
    }
}
