//! Numbers with a fixed count of decimals, as text.
//!
//! # Design
//! [`Decimal::nearest`] gives the digits of `{:.n}`, by whole numbers. The core library's printing
//! of floats takes 10 KB of a board, for any number and any width; programs need neither.

use core::fmt;

/// A number of steps with a decimal point, always: `X100` would be 0.1 mm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decimal {
    negative: bool,
    steps: u64,
    decimals: u8,
}

impl Decimal {
    /// Steps of the last decimal; at most 18 decimals.
    pub(crate) const fn of_steps(steps: i64, decimals: u8) -> Self {
        Self {
            negative: steps < 0,
            steps: steps.unsigned_abs(),
            decimals,
        }
    }

    /// A number rounded to so many decimals, at most 18; a tie goes to the even digit.
    ///
    /// # Errors
    /// Not finite, beyond 2^53, or 2^64 steps and more.
    pub(crate) fn nearest(value: f64, decimals: u8) -> Result<Self, fmt::Error> {
        let bits = value.to_bits();
        let exponent = (bits >> 52) & 0x7FF;
        let fraction = bits & ((1 << 52) - 1);
        let mantissa = if exponent == 0 {
            fraction
        } else {
            fraction | (1 << 52)
        };
        // The value is exactly `mantissa / 2^shift`.
        let shift = 1075_u64.checked_sub(exponent.max(1)).ok_or(fmt::Error)?;
        let scaled = u128::from(mantissa).wrapping_mul(u128::from(unit(decimals)));
        let steps = match u32::try_from(shift) {
            Ok(0) => scaled,
            // 53 and 60 bits were multiplied: below this it is less than half a step.
            Ok(shift @ 1..=114) => {
                let (whole, twice_rest) = (scaled >> shift, (scaled << 1) & ((2 << shift) - 1));
                let (half, is_odd) = (1 << shift, whole & 1 == 1);
                whole + u128::from(twice_rest > half || twice_rest == half && is_odd)
            }
            _ => 0,
        };
        Ok(Self {
            negative: value.is_sign_negative(),
            steps: u64::try_from(steps).map_err(|_| fmt::Error)?,
            decimals,
        })
    }
}

const fn unit(decimals: u8) -> u64 {
    10_u64.pow(decimals as u32)
}

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = unit(self.decimals);
        let sign = if self.negative { "-" } else { "" };
        let (whole, rest) = (self.steps / unit, self.steps % unit);
        write!(f, "{sign}{whole}.{rest:00$}", usize::from(self.decimals))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use proptest::prelude::*;
    use std::format;

    use super::*;

    fn same(value: f64, decimals: u8) {
        let ours = Decimal::nearest(value, decimals).unwrap();
        assert_eq!(
            format!("{ours}"),
            format!("{value:.*}", usize::from(decimals))
        );
    }

    /// Ties, both zeros, the least and the largest.
    #[test]
    fn ends_and_ties() {
        for value in [
            0.0, -0.0, 0.5, 1.5, 2.5, 0.125, 0.375, 0.00005, 0.00015, 0.99995, 1e-320,
        ] {
            for decimals in [1, 2, 4, 6, 9] {
                same(value, decimals);
                same(-value, decimals);
            }
        }
        same(9_007_199_254_740_991.0, 1);
        for value in [f64::NAN, f64::INFINITY, 1e16] {
            assert!(Decimal::nearest(value, 4).is_err());
        }
        assert_eq!(format!("{}", Decimal::of_steps(-1_005, 3)), "-1.005");
    }

    proptest! {
        /// The digits are those that the library prints: of any number, and of tidy ones.
        #[test]
        fn digits_agree_with_the_library(
            any in any::<f64>(),
            small in -2.0..2.0_f64,
            tidy in -2_000_000..2_000_000_i32,
            decimals in 1_u8..=9,
        ) {
            for value in [small, f64::from(tidy) / 1e5, f64::from(tidy) / 64.0] {
                same(value, decimals);
            }
            if any.abs() < 1e9 {
                same(any, decimals);
            }
        }
    }
}
