//! Numbers as controls print them.
//!
//! ```text
//! number = blank* [sign blank*] (digit+ ['.' digit*] | '.' digit+)
//! blank  = ' ' | '*'
//! ```
//!
//! A sign belongs to the number that follows it, however many blanks are
//! between (`- 136.6200`). The integer part may be missing (`-.46`), and the
//! decimals after a point. An asterisk is a blank that the control should have
//! replaced.

use umi_protocol::fault::NumberIssue;
use umi_protocol::pattern::{FieldFormat, Overflow};

use crate::dprnt::Digits;

/// A number as printed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::dprnt) struct Number {
    /// The value, correctly rounded; zero is never negative.
    pub value: f64,
    /// All digits as one integer: the value is `±mantissa / 10^decimals`.
    pub mantissa: u64,
    /// True if a minus was printed, also in front of zero.
    pub negative: bool,
    /// Digits as printed.
    pub digits: Digits,
    /// Where it stands in the line, from 1.
    pub position: u16,
}

/// A number that is not as it should be, and where it stands (from 1).
pub(in crate::dprnt) type Issue = (NumberIssue, u16);

/// Powers of ten that an f64 holds exactly.
const POWERS_OF_TEN: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// Integers up to here are exact in an f64.
const EXACT_INTEGERS: u64 = 1 << 53;

impl Number {
    /// The number with these digits; none if they cannot be held exactly.
    ///
    /// An integer below 2^53 divided by a power of ten up to 10^22 is one
    /// division of exact operands, hence correctly rounded (Clinger 1990, "How
    /// to read floating point numbers accurately"). So no large conversion
    /// tables are needed on a small processor.
    fn new(negative: bool, mantissa: u64, digits: Digits, position: u16) -> Option<Self> {
        if mantissa > EXACT_INTEGERS {
            return None;
        }
        let power = POWERS_OF_TEN.get(usize::from(digits.decimals))?;
        #[allow(clippy::cast_precision_loss)] // not above 2^53
        let size = mantissa as f64 / power;
        let value = if negative && mantissa != 0 {
            -size
        } else {
            size
        };
        Some(Self {
            value,
            mantissa,
            negative,
            digits,
            position,
        })
    }

    /// Whether the digits can come from a field of this format.
    ///
    /// The decimals are always printed in full, so any other number of them
    /// means that digits were lost or that fields ran together.
    ///
    /// # Errors
    /// What is wrong, and where.
    pub fn check(&self, format: FieldFormat) -> Result<(), Issue> {
        let Digits { integer, decimals } = self.digits;
        let issue = if decimals != format.decimals {
            NumberIssue::Decimals {
                expected: format.decimals,
                got: decimals,
            }
        } else if integer > format.integer_digits && format.overflow == Overflow::DropsDigits {
            NumberIssue::IntegerDigits {
                expected: format.integer_digits,
                got: integer,
            }
        } else {
            return Ok(());
        };
        Err((issue, self.position))
    }
}

/// True for what stands between fields.
pub(in crate::dprnt) const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'*')
}

/// Reads a line from left to right.
#[derive(Clone, Copy, Debug)]
pub(in crate::dprnt) struct Cursor<'a> {
    text: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    /// At the first character.
    pub const fn new(text: &'a [u8]) -> Self {
        Self { text, at: 0 }
    }

    /// The next character.
    pub fn peek(&self) -> Option<u8> {
        self.text.get(self.at).copied()
    }

    /// Position of the next character, from 1.
    pub fn position(&self) -> u16 {
        u16::try_from(self.at.saturating_add(1)).unwrap_or(u16::MAX)
    }

    /// Passes over blanks.
    pub fn blanks(&mut self) {
        while self.peek().is_some_and(is_blank) {
            self.at += 1;
        }
    }

    /// Takes this character if it is the next one.
    pub fn take(&mut self, byte: u8) -> bool {
        let here = self.peek() == Some(byte);
        self.at += usize::from(here);
        here
    }

    /// Takes this text if it comes next.
    pub fn take_text(&mut self, text: &[u8]) -> bool {
        let rest = self.text.get(self.at..).unwrap_or_default();
        let here = rest.starts_with(text);
        if here {
            self.at += text.len();
        }
        here
    }

    /// Takes characters as long as they are wanted.
    pub fn take_while(&mut self, wanted: impl Fn(u8) -> bool) -> &'a [u8] {
        let from = self.at;
        while self.peek().is_some_and(&wanted) {
            self.at += 1;
        }
        self.text.get(from..self.at).unwrap_or_default()
    }

    /// Passes over blanks; true if nothing is left.
    pub fn at_end(&mut self) -> bool {
        self.blanks();
        self.peek().is_none()
    }

    /// Passes over blanks; true if a number could begin here.
    pub fn at_number(&mut self) -> bool {
        self.blanks();
        self.peek()
            .is_some_and(|b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.'))
    }

    /// Reads a number.
    ///
    /// # Errors
    /// `Missing` without a digit, `Surplus` if a second point follows,
    /// `TooLarge` if the digits cannot be held exactly.
    pub fn number(&mut self) -> Result<Number, Issue> {
        self.blanks();
        let position = self.position();
        let negative = match self.peek() {
            Some(b'-') => true,
            Some(b'+') => false,
            _ => return self.unsigned(false, position),
        };
        self.at += 1;
        self.blanks();
        self.unsigned(negative, position)
    }

    fn unsigned(&mut self, negative: bool, position: u16) -> Result<Number, Issue> {
        let mut mantissa = 0u64;
        let mut too_large = false;
        let mut add = |digits: &[u8]| {
            for digit in digits {
                mantissa = mantissa
                    .saturating_mul(10)
                    .saturating_add(u64::from(digit - b'0'));
                too_large |= mantissa > EXACT_INTEGERS;
            }
        };
        let integer = self.take_while(|b| b.is_ascii_digit());
        add(integer);
        let mut decimals: &[u8] = &[];
        if self.take(b'.') {
            decimals = self.take_while(|b| b.is_ascii_digit());
            add(decimals);
        }
        if integer.is_empty() && decimals.is_empty() {
            return Err((NumberIssue::Missing, position));
        }
        if self.peek() == Some(b'.') {
            return Err((NumberIssue::Surplus, self.position()));
        }
        let leading = integer.iter().take_while(|b| **b == b'0').count();
        let digits = Digits {
            integer: u8::try_from(integer.len() - leading).unwrap_or(u8::MAX),
            decimals: u8::try_from(decimals.len()).unwrap_or(u8::MAX),
        };
        if too_large {
            return Err((NumberIssue::TooLarge, position));
        }
        Number::new(negative, mantissa, digits, position).ok_or((NumberIssue::TooLarge, position))
    }

    /// Reads a whole number without sign, `most` at most.
    ///
    /// # Errors
    /// `Missing`, `NotWhole` or `TooLarge`.
    pub fn whole(&mut self, most: u32) -> Result<u32, Issue> {
        self.blanks();
        let position = self.position();
        let number = self.number()?;
        if number.negative || number.digits.decimals != 0 {
            return Err((NumberIssue::NotWhole, position));
        }
        match u32::try_from(number.mantissa) {
            Ok(value) if value <= most => Ok(value),
            _ => Err((NumberIssue::TooLarge, position)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::format;
    use std::string::String;

    use proptest::prelude::*;

    use super::*;

    fn read(text: &str) -> Result<Number, NumberIssue> {
        let mut cursor = Cursor::new(text.as_bytes());
        let number = cursor.number().map_err(|(issue, _)| issue)?;
        assert!(cursor.at_end(), "{text}: something is left");
        Ok(number)
    }

    fn value(text: &str) -> f64 {
        read(text).unwrap().value
    }

    /// Rule 1: blanks or asterisks between sign and digits.
    #[test]
    fn sign_apart_from_digits() {
        assert_eq!(value("- 123.4560"), -123.456);
        assert_eq!(value("-   91.200"), -91.2);
        assert_eq!(value("*-**135.0190*"), -135.019);
        assert_eq!(value("+ 1.5"), 1.5);
    }

    /// Rules 4 and 5: negative zero, missing integer part; and a point without decimals.
    #[test]
    fn missing_parts_and_negative_zero() {
        assert_eq!(value("-.46"), -0.46);
        assert_eq!(value("12."), 12.0);
        let zero = read("-  0.000").unwrap();
        assert!(zero.negative && zero.value == 0.0 && zero.value.is_sign_positive());
    }

    /// What is not a number, and what cannot be held exactly, is refused by name.
    #[test]
    fn refused() {
        assert_eq!(read(""), Err(NumberIssue::Missing));
        assert_eq!(read("-"), Err(NumberIssue::Missing));
        assert_eq!(read("."), Err(NumberIssue::Missing));
        assert_eq!(read("- -5"), Err(NumberIssue::Missing));
        assert_eq!(read("1.2.3"), Err(NumberIssue::Surplus));
        assert_eq!(read("123456789012345678"), Err(NumberIssue::TooLarge));
        assert_eq!(
            read("99999999999999999999999999"),
            Err(NumberIssue::TooLarge)
        );
        assert_eq!(
            read(&format!("0.{}", "0".repeat(30))),
            Err(NumberIssue::TooLarge)
        );
    }

    /// Digits are counted as printed, without leading zeros.
    #[test]
    fn digits_are_counted() {
        let digits = |text: &str| {
            let Digits { integer, decimals } = read(text).unwrap().digits;
            (integer, decimals)
        };
        assert_eq!(digits("- 123.4560"), (3, 4));
        assert_eq!(digits("0012.5"), (2, 1));
        assert_eq!(digits("-.46"), (0, 2));
        assert_eq!(digits("0"), (0, 0));
    }

    /// A format accepts exactly its decimals and no more integer digits.
    #[test]
    fn format_is_checked() {
        let format = FieldFormat {
            integer_digits: 2,
            decimals: 3,
            overflow: Overflow::DropsDigits,
        };
        let check = |text: &str, format| {
            read(text)
                .unwrap()
                .check(format)
                .map_err(|(issue, _)| issue)
        };
        assert_eq!(check("12.345", format), Ok(()));
        assert_eq!(
            check("12.34", format),
            Err(NumberIssue::Decimals {
                expected: 3,
                got: 2
            })
        );
        assert_eq!(
            check("12.3456", format),
            Err(NumberIssue::Decimals {
                expected: 3,
                got: 4
            })
        );
        assert_eq!(
            check("112.345", format),
            Err(NumberIssue::IntegerDigits {
                expected: 2,
                got: 3
            })
        );
        let haas = FieldFormat {
            overflow: Overflow::Expands,
            ..format
        };
        assert_eq!(check("112.345", haas), Ok(()));
    }

    /// Whole numbers have no sign, no decimals and a limit.
    #[test]
    fn whole_numbers() {
        let whole = |text: &str| {
            Cursor::new(text.as_bytes())
                .whole(999)
                .map_err(|(issue, _)| issue)
        };
        assert_eq!(whole("    7"), Ok(7));
        assert_eq!(whole("7."), Ok(7));
        assert_eq!(whole("7.0"), Err(NumberIssue::NotWhole));
        assert_eq!(whole("-7"), Err(NumberIssue::NotWhole));
        assert_eq!(whole("1000"), Err(NumberIssue::TooLarge));
        assert_eq!(whole("X"), Err(NumberIssue::Missing));
    }

    proptest! {
        /// Our conversion gives the same bits as the standard library's, which
        /// is correctly rounded for every input.
        #[test]
        fn same_bits_as_the_standard_library(
            negative: bool, mantissa in 0u64..=EXACT_INTEGERS, decimals in 0usize..=22
        ) {
            let digits = format!("{mantissa:0>width$}", width = decimals + 1);
            let (integer, fraction) = digits.split_at(digits.len() - decimals);
            let sign = if negative { "-" } else { "" };
            let text = format!("{sign}{integer}.{fraction}");
            let expected: f64 = text.parse().unwrap();
            prop_assert_eq!((value(&text) + 0.0).to_bits(), (expected + 0.0).to_bits(), "{}", text);
        }

        /// Padding between sign and digits never changes the value.
        #[test]
        fn padding_is_free(units in -99_999_999i64..=99_999_999, pad in "[ *]{0,6}") {
            let size = units.unsigned_abs();
            let digits = format!("{}.{:04}", size / 10_000, size % 10_000);
            let sign = if units < 0 { "-" } else { "" };
            let plain: String = format!("{sign}{digits}");
            let padded = format!("{sign}{pad}{digits}");
            let content = |text: &str| read(text).map(|n| (n.value, n.negative, n.digits));
            prop_assert_eq!(content(&plain), content(&padded));
        }
    }
}
