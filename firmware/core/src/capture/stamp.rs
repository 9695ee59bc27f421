//! Instants: a count at an edge to 64 bits, and cycles to nanoseconds.

use crate::units::Cycles;

/// A free-running counter of `BITS` bits that takes `STEP` cycles per count and
/// whose count is captured at an edge.
///
/// A coarser clock, which need not be in phase, says which of the instants with
/// these low bits is meant: the latest that is not in the future.
///
/// The condition: an edge is looked at **before the counter has gone round once**,
/// 2^`BITS` · `STEP` cycles less `ahead_cycles`: 34 s for 32 bits, one cycle per
/// count and 125 MHz.
///
/// ```
/// use umi_core::capture::stamp::Stamper;
/// use umi_core::units::Cycles;
///
/// // Started at cycle 1000, a count each two cycles.
/// let skip = Stamper::<32, 2>::new(Cycles(1_000), 125);
/// assert_eq!(skip.instant(50, Cycles(1_150)), Some(Cycles(1_100)));
/// // The same count, once round later.
/// let round = |instant: u64| Cycles(instant + (1 << 33));
/// assert_eq!(skip.instant(50, round(1_150)), Some(round(1_100)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamper<const BITS: u32, const STEP: u32> {
    start_cycles: u64,
    ahead_cycles: u32,
}

impl<const BITS: u32, const STEP: u32> Stamper<BITS, STEP> {
    const MASK: u32 = {
        assert!(BITS >= 1 && BITS <= 32, "a counter has 1 to 32 bits");
        assert!(STEP >= 1, "a count takes at least one cycle");
        u32::MAX >> (32 - BITS)
    };

    /// The counter was 0 at the start. The coarse clock may be behind the
    /// counter by up to `ahead_cycles`: its resolution, and what is not known
    /// about the start.
    #[must_use]
    pub const fn new(Cycles(start_cycles): Cycles, ahead_cycles: u32) -> Self {
        Self {
            start_cycles,
            ahead_cycles,
        }
    }

    /// Cycles in which the counter goes round once.
    const LAP_CYCLES: u64 = (1 << BITS) * STEP as u64;

    /// Counts from a later lap on, if two have passed: short differences are quick to
    /// work with. To be called now and then, at least once a lap.
    pub const fn advance(&mut self, Cycles(now_cycles): Cycles) {
        if now_cycles.saturating_sub(self.start_cycles) >= 2 * Self::LAP_CYCLES {
            self.start_cycles = self.start_cycles.saturating_add(Self::LAP_CYCLES);
        }
    }

    /// The instant at which the counter was `raw`, asked now.
    ///
    /// `None`: the counter has not been `raw` since it was started, so this is
    /// no count of an edge.
    #[must_use]
    pub const fn instant(&self, raw: u32, Cycles(now_cycles): Cycles) -> Option<Cycles> {
        let since = now_cycles
            .saturating_add(self.ahead_cycles as u64)
            .saturating_sub(self.start_cycles);
        // Short where the number is short: a Cortex-M0+ takes ten times longer for 64 bits.
        let latest = if since >> 32 == 0 {
            (since as u32 / STEP) as u64
        } else {
            since / STEP as u64
        };
        let back = (latest as u32).wrapping_sub(raw) & Self::MASK;
        match latest.checked_sub(back as u64) {
            Some(counts) => {
                let since = counts.saturating_mul(STEP as u64);
                Some(Cycles(self.start_cycles).after(since))
            }
            None => None,
        }
    }
}

/// Conversions for a clock of `HZ` cycles per second.
///
/// In whole numbers: the result is the exact one rounded down, whatever the
/// instant, so that nothing drifts.
///
/// ```
/// use umi_core::capture::stamp::Rate;
/// use umi_core::units::Cycles;
///
/// assert_eq!(Rate::<125_000_000>::ns(Cycles(3)), 24);
/// assert_eq!(Rate::<240_000_000>::ns(Cycles(7)), 29); // 29.17
/// assert_eq!(Rate::<240_000_000>::cycles(1_000), Cycles(240_000));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Rate<const HZ: u32>;

impl<const HZ: u32> Rate<HZ> {
    /// Nanoseconds per cycle, as a fraction in lowest terms.
    const NS: (u64, u64) = lowest_terms(1_000_000_000, HZ);
    /// Cycles per microsecond, as a fraction in lowest terms.
    const PER_US: (u64, u64) = {
        let (us, cycles) = lowest_terms(1_000_000, HZ);
        (cycles, us)
    };

    /// The nanoseconds that so many cycles take, rounded down.
    #[must_use]
    pub const fn ns(Cycles(cycles): Cycles) -> u64 {
        scale(cycles, Self::NS)
    }

    /// The cycles that so many microseconds take, rounded down.
    #[must_use]
    pub const fn cycles(us: u64) -> Cycles {
        Cycles(scale(us, Self::PER_US))
    }
}

/// `value * numerator / denominator`, rounded down, without an overflow on the way.
const fn scale(value: u64, (numerator, denominator): (u64, u64)) -> u64 {
    let whole = (value / denominator).saturating_mul(numerator);
    whole.saturating_add(value % denominator * numerator / denominator)
}

const fn lowest_terms(numerator: u32, denominator: u32) -> (u64, u64) {
    assert!(denominator > 0, "a clock that stands has no rate");
    let (mut a, mut b) = (numerator, denominator);
    while b > 0 {
        (a, b) = (b, a % b);
    }
    ((numerator / a) as u64, (denominator / a) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ns_is_exact<const HZ: u32>(cycles: u64) {
        let exact = u128::from(cycles) * 1_000_000_000 / u128::from(HZ);
        assert_eq!(u128::from(Rate::<HZ>::ns(Cycles(cycles))), exact, "{HZ} Hz");
    }

    fn cycles_are_exact<const HZ: u32>(us: u64) {
        let exact = u128::from(us) * u128::from(HZ) / 1_000_000;
        assert_eq!(u128::from(Rate::<HZ>::cycles(us).0), exact, "{HZ} Hz");
    }

    proptest! {
        /// Both conversions against 128-bit arithmetic, for 50 years of cycles, at
        /// the clocks of the boards and at one that divides nothing.
        #[test]
        fn conversions_are_exact(cycles in 0_u64..(1 << 58)) {
            ns_is_exact::<125_000_000>(cycles);
            ns_is_exact::<150_000_000>(cycles);
            ns_is_exact::<200_000_000>(cycles);
            ns_is_exact::<240_000_000>(cycles);
            ns_is_exact::<48_000_001>(cycles);
            cycles_are_exact::<125_000_000>(cycles >> 8);
            cycles_are_exact::<150_000_000>(cycles >> 8);
            cycles_are_exact::<240_000_000>(cycles >> 8);
            cycles_are_exact::<48_000_001>(cycles >> 8);
        }

        /// The instant of an edge is found exactly, however late it is looked at
        /// within a round of the counter, with a coarse clock that is up to
        /// `ahead` behind; and it never is off by a round.
        #[test]
        fn instants_are_exact(
            start in 0_u64..(1 << 50),
            counts in 0_u64..(1 << 50),
            late in 0_u64..0xFFFF_0000,
            behind in 0_u64..=125,
        ) {
            let stamper = Stamper::<32, 2>::new(Cycles(start), 125);
            let edge = start + counts * 2;
            let now = edge + late * 2 - behind.min(edge);
            prop_assert_eq!(stamper.instant(counts as u32, Cycles(now)), Some(Cycles(edge)));

            let mut short = Stamper::<16, 1>::new(Cycles(start), 125);
            let counts = counts % (1 << 24);
            let edge = start + counts;
            let now = edge + late % 65_000 - behind.min(edge);
            prop_assert_eq!(short.instant(counts as u32 & 0xFFFF, Cycles(now)), Some(Cycles(edge)));
            // Also if somebody has seen to it that differences stay small.
            for lap in 1..=(now - start) >> 16 {
                short.advance(Cycles(start + (lap << 16)));
            }
            prop_assert!(short.start_cycles + (3 << 16) > now);
            prop_assert_eq!(short.instant(counts as u32 & 0xFFFF, Cycles(now)), Some(Cycles(edge)));
        }
    }

    /// A count from before the start is refused, not turned into an instant.
    #[test]
    fn nothing_before_the_start() {
        let stamper = Stamper::<32, 4>::new(Cycles(1_000), 0);
        let instant = |raw, now| stamper.instant(raw, Cycles(now)).map(|at| at.0);
        assert_eq!(instant(0, 1_003), Some(1_000));
        assert_eq!(instant(1, 1_003), None);
        assert_eq!(instant(u32::MAX, 5_000), None);
        assert_eq!(instant(0, 0), Some(1_000), "a clock far behind");
    }

    /// At the end of what 64 bits hold, values stay there.
    #[test]
    fn saturates() {
        assert_eq!(Rate::<125_000_000>::ns(Cycles(u64::MAX)), u64::MAX);
        let stamper = Stamper::<32, 1>::new(Cycles(u64::MAX - 1), u32::MAX);
        let last = Cycles(u64::MAX);
        assert_eq!(stamper.instant(1, last), Some(last));
    }
}
