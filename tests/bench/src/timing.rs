//! How long a piece of work takes.

use std::hint::black_box;
use std::time::{Duration, Instant};

use crate::Contender;

/// Rounds of which the median counts: other work on the machine disturbs a few of them.
const ROUNDS: usize = 21;

/// A round is repeated work for this long, so that reading the clock costs nothing.
const ROUND: Duration = Duration::from_millis(20);

/// Times a contender; returns a JSON object with its answer.
pub fn measure(contender: &Contender) -> serde_json::Value {
    let mut answer = Vec::new();
    let mut repeat = |times: u32| {
        let start = Instant::now();
        for _ in 0..times {
            (contender.work)(&mut answer);
            black_box(&answer);
        }
        start.elapsed()
    };
    let mut times = 1;
    while repeat(times) < ROUND {
        times *= 2;
    }
    let mut rounds: Vec<f64> = (0..ROUNDS)
        .map(|_| repeat(times).as_secs_f64() * 1e9 / f64::from(times))
        .collect();
    rounds.sort_by(f64::total_cmp);
    serde_json::json!({
        "task": contender.task,
        "by": contender.by,
        "bytes": contender.bytes,
        "median_ns": rounds[ROUNDS / 2],
        "min_ns": rounds[0],
        "max_ns": rounds[ROUNDS - 1],
        "answer": answer,
    })
}
