//! Where the clocks agree and the encoder does not: that it is the reason, and how it differs from the board's counts.

use crate::pair::search::{SearchOutcome, search_in};
use crate::pair::streams::Streams;

/// Steps of a search that only says why: a part of a second.
const STEPS: u64 = 200_000_000;
/// So many more profiles than with the encoder are explained without it; fewer are single faults.
const FEWEST: usize = 8;
/// A factor between encoder and counts is told from another one by this share.
const SAME: f64 = 0.01;
/// The same where only speeds tell it, of trains that need not cover the same part of the scan.
const ABOUT: f64 = 0.5;

/// That the encoder is why no more than `explained` profiles have a latch, where without it one shift explains more.
pub(in crate::pair) fn is_why(streams: &Streams<'_>, explained: usize) -> Option<String> {
    let shorter = (streams.frames.stamps.len()).min(streams.triggers.latches.len());
    if shorter < explained + FEWEST {
        return None;
    }
    let clocks = streams.without_encoder()?;
    let reach = clocks.within_reach(1.0);
    let (all, counts) = match search_in(&reach.trains, STEPS) {
        SearchOutcome::Only(found) => {
            let pairs = found.iter().enumerate().filter_map(|(profile, latch)| {
                streams.encoder_and_counts(reach.profiles[profile], reach.latches[(*latch)?])
            });
            (found.iter().flatten().count(), pairs.collect())
        }
        // An even train: more than one shift, and the encoder fits none of them.
        SearchOutcome::Tie { explained, .. } => (explained, Vec::new()),
        _ => return None,
    };
    if all < explained + FEWEST || all < reach.trains.need() {
        return None;
    }
    let profiles = streams.frames.stamps.len();
    let how = differs(streams, &counts)?;
    Some(format!(
        "encoder: the encoder is the reason: without it a shift of the clocks explains {all} of {profiles} profiles. {how}. \
         Mend that, or leave --encoder out"
    ))
}

/// How the encoder differs from the counts, by the pairs where there are any; none where nothing tells that it does.
fn differs(streams: &Streams<'_>, counts: &[(i64, i64)]) -> Option<String> {
    if let Some((profile, by)) = jump(streams) {
        return Some(format!(
            "With profile {profile} it jumps by about {by:+} counts against the axis"
        ));
    }
    let is_known = !counts.is_empty();
    let (ratio, same) = if is_known {
        (ratio_of_pairs(counts)?, SAME)
    } else {
        (ratio_of_rates(streams)?, ABOUT)
    };
    if (ratio + 1.0).abs() <= same {
        return Some("It counts down where the axis counts up: turn its direction over".into());
    }
    if ratio.abs() <= SAME {
        return Some("It stands still while the axis moves".into());
    }
    if (ratio - 1.0).abs() <= same {
        return (is_known && !steps_once(counts)).then(|| {
            "It and the axis do not keep together: encoder less counts is not the same for all pairs".into()
        });
    }
    Some(match is_known {
        true => format!("It counts {ratio:.4} for each count of the axis"),
        false => format!("It counts about {ratio:.1} for each count of the axis"),
    })
}

/// Counts of the encoder for one of the axis, over half of the scan each.
fn ratio_of_pairs(counts: &[(i64, i64)]) -> Option<f64> {
    let half = counts.len() / 2;
    let ratios = (counts.iter().zip(&counts[half..]))
        .filter(|(first, second)| first.1 != second.1)
        .map(|(first, second)| {
            (second.0 as f64 - first.0 as f64) / (second.1 as f64 - first.1 as f64)
        });
    median(ratios.collect())
}

/// About the same without pairs, where both move one way all the time, or stand: by their usual speeds.
fn ratio_of_rates(streams: &Streams<'_>) -> Option<f64> {
    let usual = |moved: Vec<(f64, f64)>| {
        let rates: Vec<f64> = (moved.windows(2))
            .filter(|pair| pair[1].0 > pair[0].0)
            .map(|pair| (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0))
            .collect();
        let rate = median(rates.clone())?;
        let is_alike = |one: &&f64| {
            if rate == 0.0 {
                **one == 0.0
            } else {
                **one * rate > 0.0
            }
        };
        let alike = rates.iter().filter(is_alike).count();
        (10 * alike >= 9 * rates.len()).then_some(rate)
    };
    let encoders = streams.sensor_us().zip(streams.encoders());
    let counts = streams.board_us().into_iter().zip(streams.counts());
    let of_encoder = usual(encoders.collect())?;
    let of_axis = usual(counts.collect())?;
    (of_axis != 0.0).then_some(of_encoder / of_axis)
}

/// Whether encoder less counts is the same but for one step, as it is where the sensor's clock jumps.
fn steps_once(counts: &[(i64, i64)]) -> bool {
    let apart: Vec<i64> = (counts.iter())
        .map(|(encoder, counts)| encoder.wrapping_sub(*counts))
        .collect();
    let step = |place: usize| apart[place].abs_diff(apart[place - 1]);
    let Some(place) = (1..apart.len()).max_by_key(|&place| step(place)) else {
        return false;
    };
    let within = |part: &[i64]| {
        let ends = part.iter().min().zip(part.iter().max());
        ends.map_or(0, |(least, most)| most.abs_diff(*least))
    };
    let (before, behind) = apart.split_at(place);
    2 * within(before).max(within(behind)) < step(place)
}

/// Where the encoder alone steps much farther than the sensor's clock, and by about how many counts, as fast as it moves elsewhere.
fn jump(streams: &Streams<'_>) -> Option<(u64, i64)> {
    let stamps = &streams.frames.stamps;
    let encoders: Vec<f64> = streams.encoders().collect();
    let steps: Vec<(f64, f64)> = (stamps.windows(2).zip(encoders.windows(2)))
        .map(|(time, count)| (time[1].t_us - time[0].t_us, count[1] - count[0]))
        .collect();
    let usual_us = median(steps.iter().map(|step| step.0).collect())?;
    // As fast as about there, for an axis that does not move evenly.
    let off = |place: usize| {
        let about = (place.saturating_sub(2)..(place + 3).min(steps.len()))
            .filter(|other| *other != place && steps[*other].0 > 0.0)
            .map(|other| steps[other].1 / steps[other].0);
        let rate = median(about.collect()).unwrap_or(0.0);
        steps[place].1 - rate * steps[place].0
    };
    let mut places: Vec<usize> = (0..steps.len()).collect();
    places.sort_by(|&a, &b| off(b).abs().total_cmp(&off(a).abs()));
    let (first, second) = (*places.first()?, *places.get(1)?);
    // The clock goes on there as elsewhere, and nowhere else the encoder goes so far.
    let is_alone = off(first).abs() > 5.0 * off(second).abs() + 16.0;
    let is_in_time = (steps[first].0 - usual_us).abs() <= 0.5 * usual_us;
    (is_alone && is_in_time).then(|| (stamps[first + 1].profile, off(first).round() as i64))
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use crate::format::triggers::{LatchSignal, TriggerLatch, Triggers};
    use crate::pair::{PairOptions, pair};
    use crate::profile::Stamp;

    /// What pairing a hundred profiles of uneven rhythm says, the encoder as `of` makes it from place and count.
    fn said(of: impl Fn(i64, i64) -> i64) -> (usize, String) {
        said_of(&|i| 5000 * i + (i * i * 37) % 1900, &of, 0..100)
    }

    fn said_of(
        at_us: &dyn Fn(i64) -> i64,
        of: &dyn Fn(i64, i64) -> i64,
        seen: std::ops::Range<i64>,
    ) -> (usize, String) {
        let latches = (0..100_i64).map(|i| TriggerLatch {
            number: i as u64,
            t_ns: at_us(i) * 1000,
            counts: [Some(40 * i), None, None, None, None, None],
        });
        let triggers = Triggers {
            latches: latches.collect(),
            missed: 0,
            lost_runs: Vec::new(),
            right_until_ns: None,
            cause: LatchSignal::Output,
        };
        let stamps: Vec<Stamp> = seen
            .map(|i| Stamp {
                profile: i as u64,
                frame: i as u64,
                t_us: at_us(i) as f64 + 7e5,
                encoder: Some(of(i, 40 * i)),
            })
            .collect();
        let options = PairOptions {
            encoder: Some(0),
            ..PairOptions::default()
        };
        match pair(&stamps, &triggers, &options) {
            Ok(pairing) => (pairing.pairs.len(), pairing.warnings.join("\n")),
            Err(error) => (0, error.message),
        }
    }

    #[test]
    fn an_encoder_that_differs_from_the_axis_is_named_as_the_reason() {
        assert_eq!(said(|_, count| count + 77), (100, String::new()));
        for (of, how) in [
            (
                &(|_, count: i64| -count) as &dyn Fn(i64, i64) -> i64,
                "turn its direction over",
            ),
            (&|_, count| 2 * count, "It counts 2.0000 for each count"),
            (&|_, _| 5, "It stands still while the axis moves"),
            (&|i, count| count + 1000 * (i % 2), "do not keep together"),
        ] {
            let (pairs, text) = said(of);
            assert!(
                pairs <= 50 && text.contains("the encoder is the reason") && text.contains(how),
                "{how}: {text}"
            );
        }
        // Of a train as even as a clock, its ends not seen, the clocks fit in more than one way, and yet the encoder is the
        // reason.
        let even = |of: &dyn Fn(i64, i64) -> i64| said_of(&|i| 5000 * i, of, 2..97).1;
        for (of, how) in [
            (
                &(|_, count: i64| -count) as &dyn Fn(i64, i64) -> i64,
                "turn its direction over",
            ),
            (&|_, count| 2 * count, "It counts about 2.0 for each count"),
            (&|_, _| 5, "It stands still while the axis moves"),
        ] {
            let text = even(of);
            assert!(
                text.contains("the encoder is the reason") && text.contains(how),
                "{how}: {text}"
            );
        }
        let text = even(&|i, count| count + if i >= 30 { 1000 } else { 0 });
        assert!(
            text.contains("With profile 30 it jumps by about +"),
            "{text}"
        );
        // From profile 30 on by 1000 counts: what is before it is left out, and the clock is not to blame.
        let (pairs, text) = said(|i, count| count + if i >= 30 { 1000 } else { 0 });
        assert!((60..=70).contains(&pairs), "{pairs}");
        assert!(
            text.contains("With profile 30 it jumps by about +"),
            "{text}"
        );
        assert!(!text.contains("sensor's clock jumps"), "{text}");
    }
}
