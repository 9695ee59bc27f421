//! What no pairing can tell: a train as even as a clock, of which some frames were lost at one end and some
//! latches at the other, looks like one whose ends are whole.

use super::trains::{Trains, median_interval};

/// Shifts that are looked at, in intervals.
const SHIFTS: [i64; 6] = [1, -1, 2, -2, 3, -3];

/// The warning, where everything that is paired lies on an even train, and a shift by a few intervals would pair about as
/// many: it loses one at an end for each interval, and one at each run of losses may be chance.
pub(super) fn even_train(trains: &Trains, found: &[Option<usize>], advice: &str) -> Option<String> {
    let interval = median_interval(&trains.board)?;
    let paired: Vec<(usize, usize)> = trains
        .order
        .iter()
        .enumerate()
        .filter_map(|(place, &profile)| Some((place, (*found.get(profile)?)?)))
        .collect();
    if paired.len() < 2 {
        return None;
    }
    // So many intervals from one time to another; none: off the train.
    let steps = |us: f64| {
        let n = (us / interval).round();
        let off = (us - n * interval).abs();
        (off <= 2.0 * trains.jitter_us + trains.drift * us.abs()).then_some(n as i64)
    };
    // Where each pair stands on the train. One that is off it is a signature, and tells.
    let mut at = vec![0];
    for pair in paired.windows(2) {
        let [(s0, b0), (s1, b1)] = [pair[0], pair[1]];
        let n = steps(trains.board[b1] - trains.board[b0])?;
        if steps(trains.sensor[s1] - trains.sensor[s0]) != Some(n) {
            return None;
        }
        at.push(at[at.len() - 1] + n);
    }
    // All times of a side, by the pair before them: their steps in rising order, and which they are.
    let on_train = |times: &[f64], of_pair: &dyn Fn(usize) -> usize| {
        let mut pair = 0;
        let mut on: Vec<(i64, usize)> = Vec::with_capacity(times.len());
        for (index, time) in times.iter().enumerate() {
            while pair + 1 < paired.len() && of_pair(pair + 1) <= index {
                pair += 1;
            }
            let step = steps(time - times[of_pair(pair)]).map(|n| at[pair] + n);
            on.extend(
                step.filter(|step| on.last().is_none_or(|(last, _)| step > last))
                    .map(|step| (step, index)),
            );
        }
        on
    };
    let sensor = on_train(&trains.sensor, &|pair| paired[pair].0);
    let board = on_train(&trains.board, &|pair| paired[pair].1);
    let runs = |on: &[(i64, usize)]| on.windows(2).filter(|t| t[1].0 - t[0].0 > 1).count();
    let chance = runs(&sensor) + runs(&board);
    let hides = |shift: i64| {
        let shifted = sensor.iter().filter_map(|(step, place)| {
            let latch = board.binary_search_by_key(&(step + shift), |(step, _)| *step);
            Some((*place, board[latch.ok()?].1))
        });
        let pairs: Vec<(usize, usize)> = shifted.collect();
        // The counts of the next latch fit as well where the axis moves evenly.
        let counts_shift = trains.counters.as_ref().is_none_or(|(encoders, counts)| {
            let apart = pairs.iter().map(|&(s, b)| encoders[s] - counts[b]);
            let (least, most) = apart.fold((i64::MAX, i64::MIN), |(a, b), d| (a.min(d), b.max(d)));
            most.saturating_sub(least) <= trains.spread
        });
        let ends = usize::try_from(shift.unsigned_abs()).unwrap_or(usize::MAX);
        pairs.len() >= 2
            && pairs.len().saturating_add(ends + chance) >= paired.len()
            && counts_shift
    };
    SHIFTS.into_iter().any(hides).then(|| {
        format!(
            "even_train: the triggers are as even as a clock. If the first frames and as many of the last latches were lost \
             (or the other way round), all profiles are as many triggers off, and nothing here shows it: {advice}"
        )
    })
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
            trains.sensor.remove(4);
            trains.order.pop();
            let encoders = trains.counters.as_mut().map(|(encoders, _)| encoders);
            encoders.map(|encoders| encoders.remove(4));
        };
        let mut one_less = trains(0..10);
        without(&mut one_less);
        let found: Vec<Option<usize>> = (0..10).filter(|i| *i != 4).map(Some).collect();
        assert_eq!(
            even_train(&one_less, &found, "ADVICE").is_some(),
            whole.is_some()
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
        assert_eq!(said(0, |i| 10 * i + i64::from(i > 3), None), None);
        // An axis at constant speed tells nothing, one that changes speed does.
        assert!(said(2, |i| 10 * i, Some(|i| 1000 * i)).is_some());
        assert_eq!(said(0, |i| 10 * i, Some(|i| 1000 * i + 7 * i * i)), None);
    }
}
