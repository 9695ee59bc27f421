//! What no pairing can tell: a train of which some frames were lost at one end and as many latches at the other
//! looks like one whose ends are whole, wherever another shift of the clocks pairs what is left as well.
//!
//! # Design
//! The search takes the shift that explains most, and a shift by `k` triggers explains `k` fewer for the ends alone. So
//! all shifts by some triggers are tried here with their ends excused: the line through the shifted pairs, by medians
//! and then by least squares among the drifts that the clocks may have, and what it brings within the jitter. An even
//! train is only the plainest case. One whose speed changes steadily is another, as the drift takes up a ramp, and one
//! whose rhythm repeats.

use super::search::widest_window;
use super::trains::Trains;

/// So few pairs may be chance, where profiles are left over.
const FEW: usize = 7;
/// The most shifts that are tried are half of the pairs, and these.
const MOST_SHIFTS: usize = 20_000;
/// What a look does not rule out is matched whole, in so many steps over times for all of them.
const MOST_STEPS: usize = 50_000_000;
/// Profiles that a look takes at each end and between.
const LOOKS: usize = 64;
/// What is matched before the line is drawn through it, in jitters.
const FIRST_WITHIN: f64 = 4.0;

/// The warning, where a shift by some triggers would pair about as many: it loses one at an end for each trigger, and two
/// at each run that both sides missed may be chance.
pub(super) fn even_train(trains: &Trains, found: &[Option<usize>], advice: &str) -> Option<String> {
    let paired: Vec<(usize, usize)> = trains
        .order
        .iter()
        .enumerate()
        .filter_map(|(place, &profile)| Some((place, (*found.get(profile)?)?)))
        .collect();
    let n = paired.len();
    // Two intervals in common may be chance, however many are beside them; so may some more, where not all profiles have
    // their latch: then some were lost, and a table that was cut off does not say how many.
    if n > 0 && (n <= 3 || n <= FEW && n < trains.profiles()) {
        return Some(few_pairs(trains, n, advice));
    }
    if n == 0 {
        return None;
    }
    let chance = 2 * gaps(trains, &paired);
    // What has lost its partner under one shift is another profile, or latch, under the next.
    let (first, last) = (paired[0], paired[n - 1]);
    let lost = (last.0 - first.0 + last.1 - first.1 + 2).saturating_sub(2 * n);
    let most = (n / 2).clamp(1, MOST_SHIFTS);
    let mut whole = (MOST_STEPS / (8 * n)).max(LOOKS);
    let mut hides = |shift: usize| {
        [true, false].into_iter().any(|is_later| {
            let (profiles, latches) = if is_later {
                (&paired[..n - shift], &paired[shift..])
            } else {
                (&paired[shift..], &paired[..n - shift])
            };
            let pair = |at: usize| (profiles[at].0, latches[at].1);
            if whole == 0 || is_ruled_out(trains, profiles.len(), &pair, chance + lost) {
                return false;
            }
            whole -= 1;
            let shifted: Vec<(usize, usize)> = (0..profiles.len()).map(pair).collect();
            // Of the losses, some lie in the ends that this shift excuses.
            let at_ends = lost.min((shift * lost).div_ceil(n) + usize::from(lost > 0));
            let enough = shifted.len().saturating_sub(chance + at_ends);
            pairs_as_well(trains, &shifted, enough)
        })
    };
    let shift = (1..=most).find(|shift| hides(*shift))?;
    let triggers = match shift {
        1 => "one trigger".to_owned(),
        n => format!("{n} triggers"),
    };
    Some(format!(
        "even_train: nothing tells the ends of this train: {triggers} farther, profiles and latches agree as well, within \
         the jitter and the drift. If as many of the first frames and of the last latches were lost (or the other way \
         round), all profiles are off by that, and nothing here shows it: {advice}"
    ))
}

/// The warning for pairs that are too few.
fn few_pairs(trains: &Trains, pairs: usize, advice: &str) -> String {
    let (profiles, latches) = (trains.sensor.len(), trains.board.len());
    let few = match (pairs, profiles.max(latches)) {
        (1, 1) => "a single profile and a single latch belong together: the clocks have no common beginning, and so few have no \
                   rhythm"
            .to_owned(),
        (1, _) => format!("one pair of {profiles} profiles and {latches} latches belongs together: one moment has no rhythm"),
        (_, 2) => "two profiles and two latches belong together: the clocks have no common beginning, and so few have no rhythm"
            .to_owned(),
        (2, _) => format!(
            "two pairs of {profiles} profiles and {latches} latches belong together: one interval that agrees may be chance"
        ),
        (3, _) => format!(
            "three pairs of {profiles} profiles and {latches} latches belong together: two intervals that agree may be chance"
        ),
        _ => format!(
            "{pairs} pairs of {profiles} profiles and {latches} latches belong together, and profiles are left over: so few \
             intervals that agree may be chance"
        ),
    };
    format!("even_train: nothing tells that {few}. Scan more profiles than that, and {advice}")
}

/// Whether more than `most` of some profiles have no latch near the line through these pairs: those at both ends, and
/// some between.
fn is_ruled_out(
    trains: &Trains,
    n: usize,
    pair: &dyn Fn(usize) -> (usize, usize),
    most: usize,
) -> bool {
    let stride = n.div_ceil(2 * LOOKS).max(1);
    let between: Vec<(usize, usize)> = (0..n).step_by(stride).map(pair).collect();
    let line = through_medians(trains, &between);
    let is_missing = |at: &usize| {
        let near = line.0 + (1.0 + line.1) * trains.sensor[pair(*at).0];
        let within = FIRST_WITHIN * trains.jitter_us;
        let next = trains.board.partition_point(|t| *t < near - within);
        trains.board.get(next).is_none_or(|t| *t > near + within)
    };
    let ends = (0..n.min(LOOKS)).chain(n.saturating_sub(LOOKS)..n);
    // Of a short train each is looked at three times.
    let looks = ends.chain((0..n).step_by(stride));
    looks.filter(is_missing).count() > 3 * most
}

/// Whether the line through these pairs explains `enough` profiles.
fn pairs_as_well(trains: &Trains, pairs: &[(usize, usize)], enough: usize) -> bool {
    let mut line = through_medians(trains, pairs);
    let mut pairing = vec![None; trains.profiles()];
    for within in [FIRST_WITHIN, 1.0, 1.0] {
        matched(trains, line, within * trains.jitter_us, &mut pairing);
        line = trains.line(&pairing, line);
    }
    matched(trains, line, trains.jitter_us, &mut pairing);
    // What the pairing itself has left over beyond these gains nothing by it.
    let (Some(&first), Some(&last)) = (pairs.first(), pairs.last()) else {
        return false;
    };
    let found = || {
        let all = (first.0..=last.0).map(|place| (place, pairing[place]));
        all.filter_map(|(place, latch)| Some((place, latch?)))
            .filter(|(_, latch)| (first.1..=last.1).contains(latch))
    };
    let mut count = found().count();
    if trains.counters.is_some() {
        // The counts of the next latch fit as well where the axis moves evenly.
        let mut apart: Vec<i64> = found()
            .filter_map(|(place, latch)| trains.difference(place, latch))
            .collect();
        apart.sort_unstable();
        let agree = |(least, most): (i64, i64)| {
            let begin = apart.partition_point(|d| *d < least);
            apart.partition_point(|d| *d <= most) - begin
        };
        count = widest_window(&apart, trains.spread).map_or(0, agree);
    }
    count >= 2 && count >= enough
}

/// The line whose drift joins the medians of the first and the last third, within the drift that is allowed.
fn through_medians(trains: &Trains, pairs: &[(usize, usize)]) -> (f64, f64) {
    let sensor = |pair: &(usize, usize)| trains.sensor[pair.0];
    let median = |pairs: &[(usize, usize)], drift: f64| {
        let mut apart: Vec<f64> = pairs
            .iter()
            .map(|pair| trains.board[pair.1] - (1.0 + drift) * sensor(pair))
            .collect();
        let middle = apart.len() / 2;
        *apart.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let third = pairs.len().div_ceil(3);
    let (first, last) = (&pairs[..third], &pairs[pairs.len() - third..]);
    let apart_us = sensor(&last[third / 2]) - sensor(&first[third / 2]);
    let drift = if apart_us > 0.0 {
        (median(last, 0.0) - median(first, 0.0)) / apart_us
    } else {
        0.0
    };
    let drift = drift.clamp(-trains.drift, trains.drift);
    (median(pairs, drift), drift)
}

/// The latch of each profile on a line: the nearest that is free.
fn matched(trains: &Trains, line: (f64, f64), within_us: f64, pairing: &mut [Option<usize>]) {
    let board = &trains.board;
    let mut free = 0;
    for (latch, sensor) in pairing.iter_mut().zip(&trains.sensor) {
        let at = line.0 + (1.0 + line.1) * sensor;
        while board.get(free).is_some_and(|t| *t < at - within_us) {
            free += 1;
        }
        let off = |latch: usize| board.get(latch).map(|t| (t - at).abs());
        let mut nearest = free;
        while let (Some(this), Some(next)) = (off(nearest), off(nearest + 1))
            && next < this
        {
            nearest += 1;
        }
        *latch = off(nearest).filter(|us| *us <= within_us).map(|_| nearest);
        if latch.is_some() {
            free = nearest + 1;
        }
    }
}

/// Triggers that both missed: intervals between two pairs that follow each other, several times as long as one beside
/// them. A shift moves such a gap, and misses a profile and a latch there. What one side lost alone costs it nothing.
fn gaps(trains: &Trains, paired: &[(usize, usize)]) -> usize {
    let apart = |latch: usize| {
        let pair = trains.board.get(latch..=latch + 1)?;
        Some(pair[1] - pair[0])
    };
    let is_gap = |pair: &&[(usize, usize)]| {
        let [(place, latch), (next_place, next_latch)] = [pair[0], pair[1]];
        let beside = [latch.checked_sub(1).and_then(apart), apart(next_latch)];
        let shorter = beside.into_iter().flatten().reduce(f64::min);
        let (Some(one), Some(us)) = (shorter.filter(|one| *one > 0.0), apart(latch)) else {
            return false;
        };
        let times = (us / one).round();
        let is_whole = (us - times * one).abs() <= 2.0 * trains.jitter_us + 0.02 * us;
        next_place == place + 1 && next_latch == latch + 1 && times >= 2.0 && is_whole
    };
    paired.windows(2).filter(is_gap).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten pulses, the moments in ms, and the axis' counts at each. So many of the first frames and of the last
    /// latches are lost.
    fn said(
        lost: i64,
        at_ms: impl Fn(i64) -> i64,
        counts: Option<fn(i64) -> i64>,
    ) -> Option<String> {
        let trains = |frames: std::ops::Range<i64>| {
            let sensor: Vec<f64> = frames.map(|i| at_ms(i + lost) as f64 * 1e3).collect();
            let board: Vec<i64> = (0..10).map(|i| at_ms(i) * 1_000_000).collect();
            let counters = counts.map(|counts| {
                let of = |from: i64| (from..from + 10).map(counts).collect();
                (of(lost), of(0))
            });
            Trains::new(&sensor, &board, counters, 20.0, 200.0, 8, (0, Vec::new()))
        };
        let found: Vec<Option<usize>> = (0..10).map(Some).collect();
        let whole = even_train(&trains(0..10), &found, "ADVICE");
        // One frame is lost in the middle: the ends tell no more for that.
        let without = |trains: &mut Trains| {
            trains.sensor.remove(6);
            trains.order.pop();
            let encoders = trains.counters.as_mut().map(|(encoders, _)| encoders);
            encoders.map(|encoders| encoders.remove(6));
        };
        let mut one_less = trains(0..10);
        without(&mut one_less);
        let found: Vec<Option<usize>> = (0..10).filter(|i| *i != 6).map(Some).collect();
        assert_eq!(
            even_train(&one_less, &found, "ADVICE").is_some(),
            whole.is_some(),
            "{:?}",
            even_train(&one_less, &found, "ADVICE")
        );
        whole
    }

    #[test]
    fn only_a_train_that_tells_nothing_of_its_ends_is_told() {
        let even = said(2, |i| 10 * i, None).unwrap();
        assert!(
            even.starts_with("even_train: ") && even.contains("ADVICE"),
            "{even}"
        );
        // A signature tells.
        assert_eq!(said(0, |i| 10 * i + i * i / 3, None), None);
        // An axis at constant speed tells nothing, one that changes speed does.
        assert!(said(2, |i| 10 * i, Some(|i| 1000 * i)).is_some());
        assert_eq!(said(0, |i| 10 * i, Some(|i| 1000 * i + 7 * i * i)), None);
    }

    /// Few pairs are told, whatever is beside them: of the intervals of uneven latches some other may be as long.
    #[test]
    fn few_pairs_tell_nothing() {
        let told = |sensor_us: &[f64], board_us: &[i64], found: &[Option<usize>]| {
            let board: Vec<i64> = board_us.iter().map(|us| us * 1000).collect();
            let trains = Trains::new(sensor_us, &board, None, 20.0, 200.0, 8, (0, Vec::new()));
            even_train(&trains, found, "ADVICE")
        };
        let one = told(&[500.0], &[700], &[Some(0)]).unwrap();
        assert!(
            one.starts_with("even_train: ") && one.contains("a single profile"),
            "{one}"
        );
        let two = told(&[500.0, 900.0], &[700, 1100], &[Some(0), Some(1)]).unwrap();
        assert!(
            two.contains("two profiles") && two.contains("ADVICE"),
            "{two}"
        );
        let uneven = [700, 1100, 2000];
        let of_three = told(&[500.0, 900.0], &uneven, &[Some(0), Some(1)]).unwrap();
        assert!(
            of_three.contains("two pairs of 2 profiles and 3 latches"),
            "{of_three}"
        );
        let more = [500.0, 900.0, 7000.0, 9400.0];
        let of_four = told(&more, &uneven, &[Some(0), Some(1), None, None]);
        assert!(of_four.is_some_and(|text| text.contains("may be chance")));
        // Two intervals are told, too.
        let all = [Some(0), Some(1), Some(2)];
        let three = told(&[500.0, 900.0, 1800.0], &uneven, &all);
        assert!(three.is_some_and(|text| text.contains("two intervals")));
        // Four that are uneven have a rhythm, unless a profile is left over.
        let uneven = [700, 1100, 2000, 3700];
        let all = [Some(0), Some(1), Some(2), Some(3), None];
        let sensor = [500.0, 900.0, 1800.0, 3500.0, 9000.0];
        assert_eq!(told(&sensor[..4], &uneven, &all[..4]), None);
        let over = told(&sensor, &uneven, &all);
        assert!(over.is_some_and(|text| text.contains("left over")));
    }

    /// Some of the first frames and as many of the last latches are lost of a train whose intervals (µs) are not quite
    /// even: what is paired is off by that, and it is told, from either side. With a rhythm of its own nothing is told.
    #[test]
    fn a_train_that_is_not_quite_even_is_told() {
        let at = |intervals: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let mut t = 0.0;
            let next = |i: usize| {
                t += intervals(i);
                t
            };
            (0..600).map(next).collect()
        };
        let ramp = |part: f64| move |i: usize| 5000.0 * (1.0 + part * i as f64 / 600.0);
        let screw = |i: usize| 5000.0 + 60.0 * (std::f64::consts::TAU * i as f64 / 10.0).sin();
        let wave =
            |i: usize| 5000.0 * (1.0 + 0.001 * (std::f64::consts::TAU * i as f64 / 600.0).sin());
        let beat = |every: usize| {
            move |i: usize| {
                if i.is_multiple_of(every) {
                    5200.0
                } else {
                    5000.0
                }
            }
        };
        // A hash: no two of its stretches are alike.
        let own = |i: usize| 5000.0 + ((i * 2_654_435_761) >> 16 & 4095) as f64 / 4.0;
        type Intervals<'a> = &'a dyn Fn(usize) -> f64;
        let cases: [(Intervals<'_>, usize, bool); 9] = [
            (&ramp(0.02), 1, true),
            (&ramp(0.1), 1, true),
            (&ramp(0.005), 20, true),
            (&beat(2), 2, true),
            (&beat(3), 3, true),
            (&screw, 10, true),
            (&wave, 120, true),
            (&own, 1, false),
            (&own, 40, false),
        ];
        for (case, (intervals, lost, is_told)) in cases.into_iter().enumerate() {
            let pulses = at(intervals);
            let ns: Vec<i64> = pulses.iter().map(|us| (us * 1e3) as i64).collect();
            // With an encoder of an axis that the pulses follow, by distance, nothing more is told.
            for with_encoder in [false, true] {
                let trains = |frames: std::ops::Range<usize>, latches: std::ops::Range<usize>| {
                    let counts = |of: &std::ops::Range<usize>| of.clone().map(|i| 10 * i as i64);
                    let counters = (counts(&frames).collect(), counts(&latches).collect());
                    let counters = with_encoder.then_some(counters);
                    Trains::new(
                        &pulses[frames],
                        &ns[latches],
                        counters,
                        20.0,
                        200.0,
                        8,
                        (0, Vec::new()),
                    )
                };
                let n = 600 - lost;
                let found: Vec<Option<usize>> = (0..n).map(Some).collect();
                let told = |trains: &Trains| even_train(trains, &found, "").is_some();
                let whole = told(&trains(0..n, 0..n));
                assert_eq!(whole, is_told, "{case} {with_encoder}");
                if is_told {
                    assert!(told(&trains(lost..600, 0..n)), "{case} {with_encoder}");
                    assert!(told(&trains(0..n, lost..600)), "{case} {with_encoder}");
                }
                // One latch more is lost in the middle: under the true shift another frame has none.
                let begin = if is_told { lost } else { 0 };
                let mut trains = trains(begin..begin + n, 0..n);
                trains.board.remove(300);
                if let Some((_, counts)) = &mut trains.counters {
                    counts.remove(300);
                }
                let before = (0..300).map(Some).chain([None]);
                let found: Vec<Option<usize>> = before.chain((300..n - 1).map(Some)).collect();
                let told = even_train(&trains, &found, "").is_some();
                assert_eq!(told, is_told, "{case} {with_encoder}");
            }
        }
    }
}
