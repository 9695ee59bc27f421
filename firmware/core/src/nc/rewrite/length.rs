//! Lengths as whole picometres: sums of increments stay exact, in mm and in inches.

use super::refusal::Reason;
use super::words::Number;

/// A length in picometres.
pub(super) type Pm = i64;

pub(super) const PM_PER_MM: f64 = 1e9;

/// Nothing is farther away: 100 m.
pub(super) const LIMIT_PM: Pm = 100_000_000_000_000;

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
pub(super) fn power(n: u8) -> i64 {
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
pub(super) struct Step {
    /// Decimals that are written.
    pub decimals: u8,
    pub pm: Pm,
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
pub(super) fn length(number: Number, unit: Unit) -> Result<Pm, Reason> {
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
        .ok_or(Reason::OutOfRange)
}

/// Decimal text of a whole number of steps: always with a point, without trailing zeros
/// (`X100` would be 0.1 mm on many controls, `X100.` never is).
pub(super) struct Decimal {
    text: [u8; 28],
    start: usize,
}

impl Decimal {
    pub fn new(steps: i64, decimals: u8) -> Self {
        let mut made = Self {
            text: [0; 28],
            start: 28,
        };
        let mut rest = steps.unsigned_abs();
        let mut left = decimals;
        let mut seen = false;
        while left > 0 {
            let digit = rest % 10;
            rest /= 10;
            seen |= digit != 0;
            if seen {
                made.put(b'0' + digit as u8);
            }
            left -= 1;
        }
        made.put(b'.');
        loop {
            made.put(b'0' + (rest % 10) as u8);
            rest /= 10;
            if rest == 0 {
                break;
            }
        }
        if steps < 0 {
            made.put(b'-');
        }
        made
    }

    /// Puts a character before what is there.
    pub fn put(&mut self, byte: u8) {
        let Some(at) = self.start.checked_sub(1) else {
            return;
        };
        if let Some(slot) = self.text.get_mut(at) {
            *slot = byte;
            self.start = at;
        }
    }

    pub fn bytes(&self) -> &[u8] {
        self.text.get(self.start..).unwrap_or_default()
    }
}
