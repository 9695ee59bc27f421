//! How long a piece of work takes.

use std::hint::black_box;
use std::time::{Duration, Instant};

use crate::Contender;

/// Rounds of which the median counts: other work on the machine disturbs a few of them.
const ROUNDS: usize = 21;

/// A round is repeated work for this long, so that reading the clock costs nothing.
const ROUND: Duration = Duration::from_millis(20);

/// Times the contenders of one task; returns a JSON object with its answer for each.
///
/// They take turns, round by round, so that what else the machine does in the
/// meantime falls on all of them.
pub fn measure(contenders: &[Contender]) -> Vec<serde_json::Value> {
    let mut runs: Vec<Run<'_>> = contenders.iter().map(Run::new).collect();
    for _ in 0..ROUNDS {
        for run in &mut runs {
            let elapsed = run.repeat(run.times);
            run.rounds
                .push(elapsed.as_secs_f64() * 1e9 / f64::from(run.times));
        }
    }
    runs.into_iter().map(Run::figures).collect()
}

struct Run<'a> {
    contender: &'a Contender,
    answer: Vec<f64>,
    /// Calls in a round.
    times: u32,
    /// Nanoseconds of a call, for each round.
    rounds: Vec<f64>,
}

impl<'a> Run<'a> {
    fn new(contender: &'a Contender) -> Self {
        let mut run = Self {
            contender,
            answer: Vec::new(),
            times: 1,
            rounds: Vec::new(),
        };
        while run.repeat(run.times) < ROUND {
            run.times *= 2;
        }
        run
    }

    fn repeat(&mut self, times: u32) -> Duration {
        let start = Instant::now();
        for _ in 0..times {
            (self.contender.work)(&mut self.answer);
            black_box(&self.answer);
        }
        start.elapsed()
    }

    fn figures(mut self) -> serde_json::Value {
        self.rounds.sort_by(f64::total_cmp);
        serde_json::json!({
            "task": self.contender.task,
            "by": self.contender.by,
            "bytes": self.contender.bytes,
            "median_ns": self.rounds[ROUNDS / 2],
            "min_ns": self.rounds[0],
            "max_ns": self.rounds[ROUNDS - 1],
            "answer": self.answer,
        })
    }
}
