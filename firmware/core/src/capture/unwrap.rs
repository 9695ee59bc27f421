//! Unwrapping: counters of few bits, extended to 64.
//!
//! The usual way counts overflows in an interrupt, and is wrong when the counter
//! has wrapped and the interrupt has not come yet. Here nothing is counted: a
//! position that was known a short while ago says which of the positions with
//! these low bits is meant, namely the nearest.

use crate::units::Counts;

/// The position nearest to `reference` whose low `BITS` bits are those of `raw`.
///
/// Right as long as the true position is less than 2^(`BITS` - 1) from
/// `reference`, in either direction. Bits of `raw` above are ignored.
#[must_use]
pub const fn nearest<const BITS: u32>(Counts(reference): Counts, raw: u32) -> Counts {
    const { assert!(BITS >= 2 && BITS <= 32, "a counter has 2 to 32 bits") };
    let unused = 32 - BITS;
    // The difference of the low bits, its sign carried upwards.
    let difference = (raw.wrapping_sub(reference as u32) << unused) as i32 >> unused;
    Counts(reference.wrapping_add(difference as i64))
}

/// An up and down counter of `BITS` bits, extended to 64.
///
/// The condition: [`look`](Self::look) is called so often that the counter moves
/// by **less than 2^(`BITS` - 1)** between two calls. See
/// [`longest_gap_us`](Self::longest_gap_us).
///
/// ```
/// use umi_core::capture::unwrap::Extender;
/// use umi_core::units::Counts;
///
/// let mut axis = Extender::<16>::new(0xFFFE);
/// assert_eq!(axis.position(), Counts(-2));
/// assert_eq!(axis.look(0x0003), Counts(3));
/// // An edge captured -1 in hardware, before that look.
/// assert_eq!(axis.captured(0xFFFF), Counts(-1));
///
/// // At 20 million counts per second a look each millisecond is enough.
/// const { assert!(Extender::<16>::longest_gap_us(20_000_000) > 1_000) };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extender<const BITS: u32> {
    position: Counts,
}

impl<const BITS: u32> Extender<BITS> {
    /// Begins at what the counter reads now, as a number with a sign: all ones are -1.
    #[must_use]
    pub const fn new(raw: u32) -> Self {
        Self {
            position: nearest::<BITS>(Counts(0), raw),
        }
    }

    /// Notes what the counter reads now and returns its position.
    pub const fn look(&mut self, raw: u32) -> Counts {
        self.position = nearest::<BITS>(self.position, raw);
        self.position
    }

    /// The position of a value that hardware captured a while ago.
    ///
    /// The condition: between the capture and the latest look, whichever came
    /// first, the counter moved by **less than 2^(`BITS` - 1)** in all. So what
    /// hardware captures is read within that time too.
    #[must_use]
    pub const fn captured(&self, raw: u32) -> Counts {
        nearest::<BITS>(self.position, raw)
    }

    /// The position at the latest look.
    #[must_use]
    pub const fn position(&self) -> Counts {
        self.position
    }

    /// The longest time between two looks at this count rate, rounded down.
    #[must_use]
    pub const fn longest_gap_us(counts_per_s: u32) -> u64 {
        if counts_per_s == 0 {
            return u64::MAX;
        }
        ((1 << (BITS - 1)) - 1) * 1_000_000 / counts_per_s as u64
    }
}

/// A counter of `BITS` bits that only counts up, as one of illegal transitions.
///
/// The condition: less than 2^`BITS` events between two looks. The total stays
/// at its largest value when it has reached it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tally<const BITS: u32> {
    raw: u32,
    total: u32,
}

impl<const BITS: u32> Tally<BITS> {
    /// No event yet; the counter reads `raw` now.
    #[must_use]
    pub const fn new(raw: u32) -> Self {
        Self { raw, total: 0 }
    }

    /// Notes what the counter reads now and returns the events since [`new`](Self::new).
    pub const fn look(&mut self, raw: u32) -> u32 {
        const { assert!(BITS >= 1 && BITS <= 32, "a counter has 1 to 32 bits") };
        let new = raw.wrapping_sub(self.raw) & (u32::MAX >> (32 - BITS));
        self.raw = raw;
        self.total = self.total.saturating_add(new);
        self.total
    }

    /// Events up to the latest look.
    #[must_use]
    pub const fn total(&self) -> u32 {
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// Follows an axis through moves that keep the condition; captures come at
    /// any moment since the look before, and are read after the next look.
    fn follow<const BITS: u32>(start: i64, moves: &[(i64, i64)]) {
        let half = 1_i64 << (BITS - 1);
        let mask = (1_u64 << BITS) - 1;
        let raw = |position: i64| (position as u64 & mask) as u32;
        let mut truth = start;
        let mut axis = Extender::<BITS> {
            position: Counts(start),
        };
        for (step, edge) in moves {
            let before = truth;
            truth += step % half;
            // Both ways round: the counter may have turned back since the edge.
            let captured = truth + edge % half;
            let garbage = if BITS == 32 { 0 } else { 0xA5A5_A5A5 << BITS };
            assert_eq!(axis.look(raw(truth) | garbage), Counts(truth));
            assert_eq!(axis.captured(raw(captured)), Counts(captured));
            assert_eq!(axis.position(), Counts(truth), "a capture does not move it");
            assert_eq!(
                axis.captured(raw(before)),
                Counts(before),
                "the look before"
            );
        }
    }

    proptest! {
        /// No position is off by a wrap, wherever the counter wraps, for all the
        /// widths that boards have.
        #[test]
        fn follows_every_move_within_the_condition(
            start in -(1_i64 << 62)..(1_i64 << 62),
            moves in prop::collection::vec((any::<i64>(), any::<i64>()), 1..200),
        ) {
            follow::<16>(start, &moves);
            follow::<18>(start, &moves);
            follow::<24>(start, &moves);
            follow::<32>(start, &moves);
        }

        /// A tally is the sum of what came, modulo nothing.
        #[test]
        fn tally_adds_up(start: u32, steps in prop::collection::vec(0_u32..(1 << 14), 1..100)) {
            let mut hardware = start & 0x3FFF;
            let mut tally = Tally::<14>::new(hardware);
            for step in &steps {
                hardware = (hardware + step) & 0x3FFF;
                tally.look(hardware);
            }
            prop_assert_eq!(tally.total(), steps.iter().sum::<u32>());
        }
    }

    /// The condition is sharp: the last move inside of it is right, the first
    /// outside is off by one wrap.
    #[test]
    fn the_condition_is_sharp() {
        for (moved, seen) in [(32_767, 32_767), (-32_767, -32_767), (32_768, -32_768)] {
            let mut axis = Extender::<16>::new(0);
            assert_eq!(axis.look(moved as u32), Counts(seen));
        }
    }

    /// The case that fails where overflows are counted: the counter wrapped, and
    /// whoever reads it has not been told; it wraps to and fro at every look.
    #[test]
    fn to_and_fro_over_the_wrap() {
        let mut axis = Extender::<16>::new(0);
        let seen: Vec<i64> = [0xFFFF, 0, 0xFFFE, 1, 0xFFFF, 0]
            .into_iter()
            .map(|raw| axis.look(raw).0)
            .collect();
        assert_eq!(seen, [-1, 0, -2, 1, -1, 0]);
    }

    /// The gap that is promised keeps the condition, one microsecond more does not.
    #[test]
    fn longest_gap_keeps_the_condition() {
        for rate in [1, 999, 1_000_000, 12_500_000, u32::MAX] {
            let gap = Extender::<18>::longest_gap_us(rate);
            let counts = |us: u64| u128::from(us) * u128::from(rate) / 1_000_000;
            assert!(counts(gap) < 1 << 17, "{rate}");
            assert!(counts(gap + 1) >= (1 << 17) - 1, "{rate}");
        }
        assert_eq!(Extender::<16>::longest_gap_us(0), u64::MAX);
    }

    /// A total that is full stays full.
    #[test]
    fn tally_saturates() {
        let mut tally = Tally::<32>::new(1);
        assert_eq!(tally.look(0), u32::MAX);
        assert_eq!(tally.look(7), u32::MAX);
    }
}
