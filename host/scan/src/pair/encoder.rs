//! Where the clocks agree and the encoder does not: that it is the reason, and how it differs from the board's counts.

use super::search::{SearchOutcome, search_in};
use super::streams::Streams;

/// Steps of a search that only says why: a part of a second.
const STEPS: u64 = 200_000_000;
/// So many more profiles than with the encoder are explained without it; fewer are single faults.
const FEWEST: usize = 8;
/// A factor between encoder and counts is told from another one by this share.
const SAME: f64 = 0.01;

/// That the encoder is why no more than `explained` profiles have a latch, where without it one shift explains more.
pub(super) fn is_why(streams: &Streams<'_>, explained: usize) -> Option<String> {
    let shorter = (streams.frames.stamps.len()).min(streams.triggers.latches.len());
    if shorter < explained + FEWEST {
        return None;
    }
    let clocks = streams.without_encoder()?;
    let reach = clocks.within_reach(1.0);
    let SearchOutcome::Only(found) = search_in(&reach.trains, STEPS) else {
        return None;
    };
    let all = found.iter().flatten().count();
    if all < explained + FEWEST || all < reach.trains.need() {
        return None;
    }
    let pairs: Vec<(usize, usize)> = (found.iter().enumerate())
        .filter_map(|(profile, latch)| Some((reach.profiles[profile], reach.latches[(*latch)?])))
        .collect();
    let counts: Vec<(i64, i64)> = (pairs.iter())
        .filter_map(|&(profile, latch)| streams.encoder_and_counts(profile, latch))
        .collect();
    let profiles = streams.frames.stamps.len();
    let how = differs(&counts, |place| {
        (pairs.get(place)).map_or(0, |(profile, _)| streams.frames.stamps[*profile].profile)
    });
    Some(format!(
        "encoder: the encoder is the reason: without it one shift of the clocks explains {all} of {profiles} profiles. {how}. \
         Mend that, or leave --encoder out"
    ))
}

/// How the encoder differs from the counts, of pairs in their order.
fn differs(counts: &[(i64, i64)], profile: impl Fn(usize) -> u64) -> String {
    let half = counts.len() / 2;
    let mut ratios: Vec<f64> = (counts.iter().zip(&counts[half..]))
        .filter(|(first, second)| first.1 != second.1)
        .map(|(first, second)| {
            (second.0 as f64 - first.0 as f64) / (second.1 as f64 - first.1 as f64)
        })
        .collect();
    if ratios.is_empty() {
        return "The axis that --encoder names stands still on the board".into();
    }
    let middle = ratios.len() / 2;
    let ratio = *ratios.select_nth_unstable_by(middle, f64::total_cmp).1;
    let apart: Vec<i64> = (counts.iter())
        .map(|(encoder, counts)| encoder.wrapping_sub(*counts))
        .collect();
    let step = |place: usize| apart[place].wrapping_sub(apart[place - 1]);
    let widest = (1..apart.len()).max_by_key(|&place| step(place).unsigned_abs());
    let jump = widest.filter(|&place| {
        let within = |part: &[i64]| {
            let ends = part.iter().min().zip(part.iter().max());
            ends.map_or(0, |(least, most)| most.abs_diff(*least))
        };
        let (before, behind) = apart.split_at(place);
        2 * within(before).max(within(behind)) < step(place).unsigned_abs()
    });
    match jump {
        Some(place) => format!(
            "With profile {} it jumps by {:+} counts against the axis",
            profile(place),
            step(place)
        ),
        None if (ratio - 1.0).abs() <= SAME => {
            "It and the axis do not keep together: encoder less counts is not the same for all pairs".into()
        }
        None if (ratio + 1.0).abs() <= SAME => {
            "It counts down where the axis counts up: turn its direction over".into()
        }
        None if ratio.abs() <= SAME => "It stands still while the axis moves".into(),
        None => format!("It counts {ratio:.4} for each count of the axis"),
    }
}

#[cfg(test)]
mod tests {
    use crate::format::triggers::{LatchSignal, TriggerLatch, Triggers};
    use crate::pair::{PairOptions, pair};
    use crate::profile::Stamp;

    /// What pairing a hundred profiles of uneven rhythm says, the encoder as `of` makes it from place and count.
    fn said(of: impl Fn(i64, i64) -> i64) -> (usize, String) {
        let at_us = |i: i64| 5000 * i + (i * i * 37) % 1900;
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
        let stamps: Vec<Stamp> = (0..100)
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
        // From profile 30 on by 1000 counts: what is before it is left out, and the clock is not to blame.
        let (pairs, text) = said(|i, count| count + if i >= 30 { 1000 } else { 0 });
        assert!((60..=70).contains(&pairs), "{pairs}");
        assert!(
            text.contains("With profile 30 it jumps by +1000 counts"),
            "{text}"
        );
        assert!(!text.contains("sensor's clock jumps"), "{text}");
    }
}
