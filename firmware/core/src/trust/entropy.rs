//! Bits of a source of noise, tested and conditioned into 32 bytes.
//!
//! # Design
//!
//! [`RAW_BITS`] bits are taken and tested; then SHA-256 makes 32 bytes of them and of everything that
//! was taken since the start. The source is trusted to have half a bit of min-entropy in each of its
//! bits, so a draw has twice as much as it gives.
//!
//! The tests are the two of NIST SP 800-90B, 4.4, with a false alarm in 2³⁰ draws: no bit comes
//! [`REPEATED`] times behind each other, and none is there more than [`MOST`] times. The second is done
//! with the bits' differences, too, at each distance up to [`LAGS`]: an oscillator that runs in step
//! with who looks at it gives patterns in which either bit is there often enough.
//!
//! # Limitations
//!
//! A test sees a source that is broken, not one that an attacker knows. Nothing here measures how much
//! entropy there is: that is a promise about the chip.

use sha2::{Digest as _, Sha256};

use super::board_key::NoEntropy;

/// Bits of a draw: the window of the adaptive proportion test for a binary source.
pub const RAW_BITS: usize = 1024;

/// The repetition count test: 1 + 30 / 0.5 (SP 800-90B, 4.4.1).
pub const REPEATED: u32 = 61;

/// The adaptive proportion test: 1 + the most that 1024 bits have of one with the probability
/// 2^-0.5, but for one case in 2³⁰ (SP 800-90B, 4.4.2).
pub const MOST: u32 = 810;

/// Distances at which bits are compared.
pub const LAGS: usize = 32;

/// What was drawn so far.
#[derive(Debug)]
pub struct EntropyPool {
    state: [u8; 32],
}

impl EntropyPool {
    /// One that knows nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: [0; 32] }
    }

    /// Fills 32 bytes from a source that gives a bit at each call.
    ///
    /// # Errors
    /// [`NoEntropy`]: the source is broken; what it gave counts for nothing.
    pub fn draw(
        &mut self,
        into: &mut [u8; 32],
        mut source: impl FnMut() -> bool,
    ) -> Result<(), NoEntropy> {
        let mut raw = [0; RAW_BITS / 32];
        for word in &mut raw {
            for place in 0..32 {
                *word |= u32::from(source()) << place;
            }
        }
        if !is_healthy(&raw) {
            return Err(NoEntropy);
        }
        let mut hash = Sha256::new();
        hash.update(self.state);
        for word in raw {
            hash.update(word.to_le_bytes());
        }
        let drawn: [u8; 32] = hash.finalize().into();
        // Neither tells the other.
        *into = Sha256::new_with_prefix([0])
            .chain_update(drawn)
            .finalize()
            .into();
        self.state = Sha256::new_with_prefix([1])
            .chain_update(drawn)
            .finalize()
            .into();
        Ok(())
    }
}

impl Default for EntropyPool {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether the bits pass the tests, the first of them in the lowest place.
#[must_use]
fn is_healthy(raw: &[u32; RAW_BITS / 32]) -> bool {
    let mut alike = 0;
    let mut last = None;
    let mut ones = 0;
    // The bits before this one, the latest in the lowest place.
    let mut before = 0_u32;
    let mut same = [0; LAGS];
    let bits = raw
        .iter()
        .flat_map(|word| (0..32).map(move |place| word >> place & 1));
    for bit in bits {
        alike = if last == Some(bit) { alike + 1 } else { 1 };
        if alike >= REPEATED {
            return false;
        }
        last = Some(bit);
        ones += bit;
        for (lag, same) in same.iter_mut().enumerate() {
            *same += u32::from(before >> lag & 1 == bit);
        }
        before = before << 1 | bit;
    }
    let is_usual = |count: u32| count < MOST && RAW_BITS as u32 - count < MOST;
    is_usual(ones) && same.into_iter().all(is_usual)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::collections::BTreeSet;
    use std::vec::Vec;

    /// Bits of which so many of 1000 are ones (Marsaglia 2003, xorshift32).
    fn source(seed: u32, ones: u32) -> impl FnMut() -> bool {
        let mut x = seed;
        move || {
            x ^= x << 13;
            x ^= x >> 17;
            x ^= x << 5;
            u64::from(x) * 1000 < u64::from(ones) << 32
        }
    }

    fn drawn(mut source: impl FnMut() -> bool) -> Result<[u8; 32], NoEntropy> {
        let mut bytes = [0; 32];
        EntropyPool::new().draw(&mut bytes, &mut source)?;
        Ok(bytes)
    }

    /// A source of half a bit a bit passes: fair, or with seven ones to three zeros, 10 000 times.
    #[test]
    fn a_source_that_works_is_never_refused() {
        for seed in 1..=5_000 {
            for ones in [500, 700] {
                assert!(drawn(source(seed, ones)).is_ok(), "{seed}, {ones}");
            }
        }
    }

    /// A source that stands, that is far from even, or that goes on in step with who looks at it, at
    /// any period up to 32, is refused.
    #[test]
    fn a_broken_source_is_refused() {
        assert_eq!(drawn(|| false), Err(NoEntropy));
        assert_eq!(drawn(|| true), Err(NoEntropy));
        for ones in [100, 150, 850, 900] {
            assert_eq!(drawn(source(7, ones)), Err(NoEntropy), "{ones}");
        }
        for period in 1..=LAGS {
            let mut of = source(3 + period as u32, 500);
            let pattern: Vec<bool> = (0..period).map(|_| of()).collect();
            let mut n = 0;
            let steady = || {
                n += 1;
                pattern[n % period]
            };
            assert_eq!(drawn(steady), Err(NoEntropy), "period {period}");
        }
        // It stands for a moment.
        let mut n = 0;
        let mut of = source(9, 500);
        let stops = || {
            n += 1;
            (300..300 + REPEATED).contains(&n) || of()
        };
        assert_eq!(drawn(stops), Err(NoEntropy));
    }

    /// No two draws are alike, not even those of a source that gives the same again; what a broken
    /// source gave is told by nothing.
    #[test]
    fn draws_differ() {
        let mut pool = EntropyPool::new();
        let mut all = BTreeSet::new();
        for _ in 0..100 {
            let mut bytes = [0; 32];
            pool.draw(&mut bytes, source(1, 500)).unwrap();
            assert!(all.insert(bytes));
        }
        let mut bytes = [7; 32];
        assert_eq!(pool.draw(&mut bytes, || true), Err(NoEntropy));
        assert_eq!(bytes, [7; 32]);
        assert_ne!(drawn(source(1, 500)), drawn(source(2, 500)));
    }
}
