//! What no pairing can tell: a train as even as a clock, of which as many frames were lost at one end as
//! latches at the other, looks like one of which nothing was lost.

use super::trains::Trains;

/// The warning, where all profiles and latches are paired, and a shift by one interval would pair all but
/// one as well.
pub(super) fn even_train(trains: &Trains, found: &[Option<usize>]) -> Option<String> {
    let n = found.len();
    if n < 2 || n != trains.latches() || found.contains(&None) {
        return None;
    }
    let is_even = |times: &[f64]| {
        let apart = times.windows(2).map(|pair| pair[1] - pair[0]);
        let (least, most) = apart.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), us| {
            (a.min(us), b.max(us))
        });
        most - least <= 2.0 * trains.jitter_us
    };
    // The counts of the next latch fit as well where the axis moves evenly.
    let counts_shift = trains.counters.as_ref().is_none_or(|(encoders, counts)| {
        let apart = encoders
            .iter()
            .zip(&counts[1..])
            .map(|(encoder, count)| encoder - count);
        let (least, most) = apart.fold((i64::MAX, i64::MIN), |(a, b), d| (a.min(d), b.max(d)));
        most.saturating_sub(least) <= trains.spread
    });
    (is_even(&trains.sensor) && is_even(&trains.board) && counts_shift).then(|| {
        let encoder = match trains.counters {
            Some(_) => "change speed in the scan",
            None => "wire the sensor's encoder (--encoder) and change speed in the scan",
        };
        format!(
            "even_train: the triggers are as even as a clock. If the first frames and as many of the last latches were lost \
             (or the other way round), all profiles are as many triggers off, and nothing here shows it: begin with uneven \
             trigger pulses (the signature of umi scan record), or {encoder}"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten pulses, the moments in ms, and the axis' counts at each.
    fn said(at_ms: impl Fn(i64) -> i64, counts: Option<fn(i64) -> i64>) -> Option<String> {
        let trains = |frames: std::ops::Range<i64>| {
            // The first frames and the last latches are lost.
            let sensor: Vec<f64> = frames.map(|i| at_ms(i + 2) as f64 * 1e3).collect();
            let board: Vec<i64> = (0..10).map(|i| at_ms(i) * 1_000_000).collect();
            let counters = counts.map(|counts| {
                let of = |from: i64| (from..from + 10).map(counts).collect();
                (of(2), of(0))
            });
            Trains::new(&sensor, &board, counters, 20.0, 200.0, 8, (0, Vec::new()))
        };
        let found: Vec<Option<usize>> = (0..10).map(Some).collect();
        let whole = even_train(&trains(0..10), &found);
        // One side has more than the other: that is looked at, and refused, by the search.
        assert_eq!(even_train(&trains(0..9), &found[..9]), None);
        whole
    }

    #[test]
    fn only_a_train_that_tells_nothing_of_its_ends_is_told() {
        let even = said(|i| 10 * i, None).unwrap();
        assert!(
            even.starts_with("even_train: ") && even.contains("--encoder"),
            "{even}"
        );
        // A signature tells.
        assert_eq!(said(|i| 10 * i + i64::from(i > 3), None), None);
        // An axis at constant speed tells nothing, one that changes speed does.
        let constant = said(|i| 10 * i, Some(|i| 1000 * i)).unwrap();
        assert!(constant.contains("change speed in the scan"), "{constant}");
        assert_eq!(said(|i| 10 * i, Some(|i| 1000 * i + 7 * i * i)), None);
    }
}
