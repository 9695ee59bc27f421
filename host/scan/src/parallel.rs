//! Work in chunks on several threads, with the same result for any number of them.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// How many threads a computation may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Threads(usize);

impl Threads {
    /// As many as `count`, at least one and at most 256.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self(count.clamp(1, 256))
    }

    /// As many as the machine has.
    #[must_use]
    pub fn all() -> Self {
        Self::new(thread::available_parallelism().map_or(1, std::num::NonZero::get))
    }

    /// `work` for each chunk of `0..total`, the results in the order of the chunks. What a chunk is does not depend on
    /// the number of threads, so that sums over chunks have the same bits for any number.
    pub fn chunks<R: Send>(
        self,
        total: usize,
        chunk: usize,
        work: impl Fn(Range<usize>) -> R + Sync,
    ) -> Vec<R> {
        let chunk = chunk.max(1);
        let count = total.div_ceil(chunk);
        let part = |i: usize| work(i * chunk..((i + 1) * chunk).min(total));
        if self.0 == 1 || count <= 1 {
            return (0..count).map(part).collect();
        }
        let next = AtomicUsize::new(0);
        let take = || {
            let mut done = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= count {
                    return done;
                }
                done.push((i, part(i)));
            }
        };
        let mut all: Vec<(usize, R)> = thread::scope(|scope| {
            let others: Vec<_> = (1..self.0.min(count)).map(|_| scope.spawn(take)).collect();
            let mut all = take();
            for other in others {
                match other.join() {
                    Ok(done) => all.extend(done),
                    Err(panic) => std::panic::resume_unwind(panic),
                }
            }
            all
        });
        all.sort_unstable_by_key(|(i, _)| *i);
        all.into_iter().map(|(_, result)| result).collect()
    }

    /// `work` for each number of `0..total`, in order.
    pub fn each<R: Send>(self, total: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
        let chunk = (total / 64).clamp(1, 1024);
        let mut all = Vec::with_capacity(total);
        for part in self.chunks(total, chunk, |range| range.map(&work).collect::<Vec<R>>()) {
            all.extend(part);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::Threads;

    #[test]
    fn sums_have_the_same_bits_for_any_number_of_threads() {
        let sum = |threads: usize| -> f64 {
            Threads::new(threads)
                .chunks(10_001, 128, |range| {
                    range.map(|i| 1.0 / (i as f64 + 1.0)).sum::<f64>()
                })
                .into_iter()
                .sum()
        };
        assert_eq!(sum(1).to_bits(), sum(7).to_bits());
        assert_eq!(Threads::new(3).each(1000, |i| i * i)[999], 999 * 999);
    }
}
