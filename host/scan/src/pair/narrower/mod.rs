//! Where times agree far better than within the jitter, that decides between two shifts.
//!
//! # Design
//! Two shifts explain about as many profiles within the jitter. What the wrong one explains it met by chance, anywhere
//! within the jitter but for the two pairs that its line goes through: that all of its `k` pairs lie within a share `s` of
//! the jitter has a probability of `s^(k - 2)`, for each of the lines through two times of either stream, of which there
//! are fewer than `n²`. So the search is made again with narrower jitters. Where one shift alone is left that explains as
//! many as within the whole jitter, and chance is below [`CHANCE`], it is the right one.
//!
//! A train that repeats is met by a wrong shift about as closely as by the right one, whose sensor has the same noise. Where
//! that noise is as large as the narrower jitter, a pair of the right shift may lie just beyond it, and none of the wrong
//! one. So nothing is decided unless one shift is alone with twice the narrower jitter, too, and the train does not repeat
//! with that ([`super::even`]).

#[cfg(test)]
mod short;

use super::even::even_train;
use super::search::{self, SearchOutcome};
use super::trains::Trains;

/// Shares of the jitter that are tried.
const SHARES: [f64; 7] = [0.25, 0.18, 0.125, 0.09, 0.0625, 0.044, 0.031];
/// What is narrower says nothing: a sensor's clock has steps.
const LEAST_US: f64 = 0.5;
/// The logarithm of the probability that a wrong shift is taken: 1e-6.
const CHANCE: f64 = -13.8;
/// Longer scans are not tried: their own length decides, or they are even.
const LONGEST: usize = 200;
/// Steps of each search.
const MOST_STEPS: u64 = 20_000_000;

/// What narrower jitters say.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Narrower {
    /// This shift is the right one: the latch of each profile, within the whole jitter; and the jitter that decided.
    Decides(Vec<Option<usize>>, f64),
    /// One shift alone is left with this jitter, but it may be by chance.
    Leaves(f64),
    /// Nothing.
    Nothing,
}

/// Looks for the only shift that explains `explained` profiles within less than the jitter.
pub(super) fn narrower(trains: &Trains, explained: usize) -> Narrower {
    let most = trains.profiles().max(trains.latches());
    if most > LONGEST {
        return Narrower::Nothing;
    }
    let mut leaves = Narrower::Nothing;
    for share in SHARES {
        let jitter_us = share * trains.jitter_us;
        if jitter_us < LEAST_US {
            break;
        }
        let narrow = trains.of_jitter(jitter_us);
        let SearchOutcome::Only(found) = search::search_in(&narrow, MOST_STEPS) else {
            continue;
        };
        let twice = trains.of_jitter(2.0 * jitter_us);
        let SearchOutcome::Only(wider) = search::search_in(&twice, MOST_STEPS) else {
            continue;
        };
        let mut both = found.iter().zip(&wider);
        let agree = both.all(|(found, wider)| found.is_none() || found == wider);
        if !agree || even_train(&twice, &wider, "").is_some() {
            continue;
        }
        let count = found.iter().flatten().count();
        if count < explained {
            continue;
        }
        if leaves == Narrower::Nothing {
            leaves = Narrower::Leaves(jitter_us);
        }
        let chance = count.saturating_sub(2) as f64 * share.ln() + 2.0 * (most as f64).ln();
        if chance > CHANCE {
            continue;
        }
        if let Some(whole) = search::about(trains, &found) {
            return Narrower::Decides(whole, jitter_us);
        }
    }
    leaves
}
