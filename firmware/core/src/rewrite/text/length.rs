//! Lengths as whole picometres: sums of increments stay exact, in mm and in inches.

use super::words::Number;
use crate::rewrite::refusal::RewriteRefusal;

/// A length in picometres.
pub(in crate::rewrite) type Pm = i64;

pub(in crate::rewrite) const PM_PER_MM: f64 = 1e9;

/// Nothing is farther away: 100 m.
pub(in crate::rewrite) const LIMIT_PM: Pm = 100_000_000_000_000;

#[allow(clippy::indexing_slicing, reason = "computed when it is compiled")]
const POWERS: [i64; 19] = {
    let mut powers = [1; 19];
    let mut n = 1;
    while n < powers.len() {
        powers[n] = powers[n - 1] * 10;
        n += 1;
    }
    powers
};

/// 10ⁿ, for n up to 18.
pub(in crate::rewrite) fn power(n: u8) -> i64 {
    POWERS.get(usize::from(n)).copied().unwrap_or(i64::MAX)
}

/// The unit of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// G21.
    Millimetre,
    /// G20.
    Inch,
}

/// What a control can be told: the last decimal of a length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) struct Step {
    /// Decimals that are written.
    pub decimals: u8,
    pub pm: Pm,
    pub half_pm: f64,
    pub per_pm: f64,
}

impl Step {
    /// The step with so many decimals in mm; inches have one decimal more.
    #[allow(clippy::cast_precision_loss, reason = "at most 10^9")]
    pub fn new(decimals_mm: u8, unit: Unit) -> Self {
        let (decimals, pm) = match unit {
            Unit::Millimetre => (decimals_mm, power(9 - decimals_mm.min(9))),
            Unit::Inch => (decimals_mm + 1, 254 * power(7 - decimals_mm.min(7))),
        };
        Self {
            decimals,
            pm,
            half_pm: pm as f64 / 2.0,
            per_pm: 1.0 / pm as f64,
        }
    }

    /// The nearest number of steps.
    #[allow(clippy::cast_possible_truncation, reason = "callers bound it")]
    pub fn count(&self, pm: f64) -> i64 {
        let steps = pm * self.per_pm;
        // Halves go away from zero, as controls round.
        (if steps < 0.0 {
            steps - 0.5
        } else {
            steps + 0.5
        }) as i64
    }
}

/// A written number times a unit.
#[inline]
pub(in crate::rewrite) fn length(number: Number, unit: Unit) -> Result<Pm, RewriteRefusal> {
    let (scale, exponent) = match unit {
        Unit::Millimetre => (1, 9),
        Unit::Inch => (254, 8),
    };
    let pm = if number.decimals <= exponent {
        number
            .digits
            .checked_mul(scale * power(exponent - number.decimals))
    } else {
        // Beyond a picometre: round.
        let divisor = power(number.decimals - exponent);
        number
            .digits
            .checked_mul(scale)
            .map(|all| (all + divisor / 2 * all.signum()) / divisor)
    };
    pm.filter(|pm| pm.unsigned_abs() <= LIMIT_PM.unsigned_abs())
        .ok_or(RewriteRefusal::OutOfRange)
}

/// Characters of a decimal number, at most: letter, sign, 19 digits, point; eight digits are
/// written at once.
pub(in crate::rewrite) const DECIMAL: usize = 32;

/// Writes the decimal text of a whole number of steps and returns its length: always with a
/// point, without trailing zeros (`X100` would be 0.1 mm on many controls, `X100.` never is).
#[inline]
pub(in crate::rewrite) fn decimal(
    text: &mut [u8; DECIMAL],
    letter: Option<u8>,
    steps: i64,
    decimals: u8,
) -> usize {
    let mut at = 0;
    if let Some(letter) = letter {
        put(text, &mut at, letter);
    }
    if steps < 0 {
        put(text, &mut at, b'-');
    }
    let steps = steps.unsigned_abs();
    if steps < 100_000_000 && decimals < 8 {
        short(text, &mut at, steps as u32, decimals);
    } else {
        long(text, &mut at, steps, decimals);
    }
    at
}

/// Nearly all numbers: 90 instructions of a PC a word, where a product and a branch for each
/// digit take 160; on a board, where dividing 64 bits is a call, the difference is larger.
#[inline]
fn short(text: &mut [u8; DECIMAL], at: &mut usize, steps: u32, decimals: u8) {
    let digits = eight_digits(steps);
    let decimals = u32::from(decimals);
    let wholes = 8_u32.saturating_sub(decimals);
    // One digit stands before the point in any case.
    let leading = (digits.trailing_zeros() / 8).min(wholes.saturating_sub(1));
    let trailing = digits.leading_zeros() / 8;
    let digits = digits | u64::from_ne_bytes([b'0'; 8]);
    put_some(
        text,
        at,
        digits >> (8 * leading),
        wholes.saturating_sub(leading),
    );
    put(text, at, b'.');
    if decimals > trailing {
        put_some(text, at, digits >> (8 * wholes), decimals - trailing);
    }
}

/// The eight digits of a number below 10⁸, a byte each, the first in the lowest: halved, and
/// halved again, so that all tens are divided from all ones at once.
const fn eight_digits(number: u32) -> u64 {
    const fn four_digits(number: u32) -> u32 {
        let pairs = (number / 100) | ((number % 100) << 16);
        // x / 10 of both, below 100.
        let tens = (pairs.wrapping_mul(103) >> 10) & 0x000F_000F;
        tens | (pairs.wrapping_sub(tens.wrapping_mul(10)) << 8)
    }
    let [high, low] = [four_digits(number / 10_000), four_digits(number % 10_000)];
    high as u64 | ((low as u64) << 32)
}

/// Digit by digit, from the last to the first.
fn long(text: &mut [u8; DECIMAL], at: &mut usize, steps: u64, decimals: u8) {
    let mut digits = [0; 24];
    let mut slots = digits.iter_mut();
    let mut put = |byte: u8| {
        if let Some(slot) = slots.next_back() {
            *slot = byte;
        }
    };
    let mut rest = steps;
    let mut seen = false;
    for _ in 0..decimals {
        let digit = (rest % 10) as u8;
        rest /= 10;
        seen |= digit != 0;
        if seen {
            put(b'0' + digit);
        }
    }
    put(b'.');
    loop {
        put(b'0' + (rest % 10) as u8);
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    let free = slots.len();
    for digit in digits.iter().skip(free) {
        self::put(text, at, *digit);
    }
}

#[inline]
fn put(text: &mut [u8; DECIMAL], at: &mut usize, byte: u8) {
    if let Some(slot) = text.get_mut(*at) {
        *slot = byte;
        *at += 1;
    }
}

/// The first of eight characters.
#[inline]
fn put_some(text: &mut [u8; DECIMAL], at: &mut usize, characters: u64, count: u32) {
    let slots = text.get_mut(*at..);
    if let Some(slots) = slots.and_then(<[u8]>::first_chunk_mut) {
        *slots = characters.to_le_bytes();
        *at += count as usize;
    }
}

#[cfg(test)]
mod tests {
    use std::format;
    use std::string::String;

    use proptest::prelude::*;

    use super::*;

    /// The same by the digits of a number that is written by the standard library.
    fn expected(steps: i64, decimals: u8) -> String {
        let decimals = usize::from(decimals);
        let digits = format!("{:0width$}", steps.unsigned_abs(), width = decimals + 1);
        let (whole, fraction) = digits.split_at(digits.len() - decimals);
        let sign = if steps < 0 { "-" } else { "" };
        format!("X{sign}{whole}.{}", fraction.trim_end_matches('0'))
    }

    proptest! {
        /// Every digit, every point, every zero; of few digits and of many.
        #[test]
        fn decimals_are_written_as_they_are(
            steps in prop_oneof![
                -1000_i64..1000,
                -100_000_100_i64..100_000_100,
                any::<i64>(),
                (-999_i64..1000, 0_u32..16).prop_map(|(n, zeros)| n * 10_i64.pow(zeros)),
            ],
            decimals in 0_u8..=18,
        ) {
            let mut text = [0; DECIMAL];
            let length = decimal(&mut text, Some(b'X'), steps, decimals);
            prop_assert_eq!(str::from_utf8(&text[..length]).unwrap(), expected(steps, decimals));
        }
    }
}
