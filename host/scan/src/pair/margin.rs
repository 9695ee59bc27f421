//! How far behind another shift may be and still be the true one.
//!
//! # Design
//! Let the true shift explain `d` profiles fewer than the best. Then the best has found, for each of these, a
//! latch by chance: one whose own profile was lost, for a profile whose own latch was lost. With `a`
//! profiles and `b` latches that the true shift leaves over, of `n`, chance brings about `a·b/n` such
//! meetings to the wrong shift and as many to the true one. The difference of the two has Skellam's
//! distribution (of two Poisson variables of the same mean μ); Chernoff's bound of its tail is
//! `P(D ≥ d) ≤ exp(−d·asinh(d / 2μ) + √(d² + 4μ²) − 2μ)`. The margin is the least `d` whose bound is below
//! [`CHANCE`].
//!
//! Losses come in runs, and a whole run may be met at once: a meeting counts as many as the longest run of
//! latches that the board says are missing, the next one as many as the next run, and so on.
//!
//! More than what is left over cannot be hidden: with `p` profiles and `l` latches that the best shift
//! does not explain, up to the smaller of both may belong together in truth. Latches that the board says it
//! missed, beyond the profiles that the best shift leaves over, count likewise: another shift may leave
//! more of them. Where either side is explained completely and the board missed none, the margin is 0.

use super::trains::{Trains, ends};

/// A meeting less probable than this (its logarithm) does not happen: 1e-9.
const CHANCE: f64 = -20.723;

/// The margin of a pairing (by place).
pub fn margin(trains: &Trains, pairing: &[Option<usize>], line: (f64, f64)) -> usize {
    let explained = pairing.iter().flatten().count();
    let profiles = pairing.len() - explained;
    let latches = trains.latches() - explained;
    let missed = usize::try_from(trains.missed).unwrap_or(usize::MAX);
    let hidden = profiles
        .min(latches)
        .max(missed.saturating_sub(profiles))
        .min(explained);
    if hidden == 0 {
        return 0;
    }
    // What stands before or behind the other stream was not lost by a fault.
    let inner = |times: &[f64], ends: (f64, f64)| {
        let begin = times.partition_point(|&t| t < ends.0 - trains.jitter_us);
        let end = times.partition_point(|&t| t <= ends.1 + trains.jitter_us);
        (end - begin.min(end)).saturating_sub(explained)
    };
    let (first, last) = ends(&trains.board);
    let sensor_at = |t: f64| (t - line.0) / (1.0 + line.1);
    let of_profiles = inner(&trains.sensor, (sensor_at(first), sensor_at(last)));
    let (first, last) = ends(&trains.sensor);
    let board_at = |t: f64| line.0 + (1.0 + line.1) * t;
    let of_latches = inner(&trains.board, (board_at(first), board_at(last)));
    let mut runs = trains.lost_runs.iter().copied();
    let mut margin = 0_u64;
    for meetings in 0..hidden {
        let left_over = (of_profiles + meetings) * (of_latches + meetings);
        if meetings > 0 && tail(meetings as f64, left_over as f64 / explained as f64) < CHANCE {
            break;
        }
        margin = margin.saturating_add(runs.next().unwrap_or(1));
    }
    usize::try_from(margin).unwrap_or(usize::MAX).min(hidden)
}

/// The logarithm of Chernoff's bound that the difference of two Poisson variables of this mean is `d` or more.
fn tail(d: f64, mean: f64) -> f64 {
    d.hypot(2.0 * mean) - 2.0 * mean - d * (d / (2.0 * mean)).asinh()
}
