//! Numbers as text: fixed decimals that fit the quantity, never a bare NaN,
//! never a negative zero.

/// What stands where there is no number.
pub const NONE: &str = "\u{2013}";
/// What stands where a number is NaN or infinite.
pub const NOT_FINITE: &str = "n/a";

/// Above this the decimals are meaningless and the digits would fill the page.
const LARGEST: f64 = 1e7;

/// Fixed decimals, ASCII.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NOT_FINITE.into();
    }
    if value.abs() >= LARGEST {
        return format!("{value:.3e}");
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|b| matches!(b, b'0' | b'.')) => digits.into(),
        _ => text,
    }
}

/// Fixed decimals with a plus sign where the sign matters.
pub fn signed(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    let zero = text.bytes().all(|b| matches!(b, b'0' | b'.'));
    if text.starts_with('-') || !value.is_finite() || zero {
        text
    } else {
        format!("+{text}")
    }
}

/// A position, distance or radius in mm: 0.1 µm, one digit below what a machine prints.
pub fn mm(value: f64) -> String {
    fixed(value, 4)
}

/// A length given in mm, shown in µm without sign.
pub fn um(value_mm: f64) -> String {
    fixed(value_mm * 1e3, 1)
}

/// A deviation given in mm, shown in µm with sign.
pub fn um_signed(value_mm: f64) -> String {
    signed(value_mm * 1e3, 1)
}

/// The same with a real minus sign, for the page.
pub fn typographic(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 2);
    let mut before: Option<char> = None;
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        let starts = before.is_none_or(|b| !b.is_alphanumeric());
        let number = chars.peek().is_some_and(char::is_ascii_digit);
        out.push(if c == '-' && starts && number {
            '\u{2212}'
        } else {
            c
        });
        before = Some(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No NaN, no negative zero, no page-filling digits.
    #[test]
    fn odd_numbers_stay_readable() {
        assert_eq!(fixed(f64::NAN, 3), NOT_FINITE);
        assert_eq!(signed(f64::NEG_INFINITY, 3), NOT_FINITE);
        assert_eq!(fixed(-0.000_01, 3), "0.000");
        assert_eq!(signed(-0.0, 1), "0.0");
        assert_eq!(fixed(-1e300, 4), "-1.000e300");
        assert_eq!(mm(-136.71049), "-136.7105");
        assert_eq!(um_signed(0.0138), "+13.8");
        assert_eq!(um(0.0005), "0.5");
    }

    /// Only a sign becomes a minus sign; hyphens in names stay.
    #[test]
    fn minus_signs() {
        assert_eq!(typographic("-1.5"), "\u{2212}1.5");
        assert_eq!(typographic("g10-68 by -2"), "g10-68 by \u{2212}2");
    }
}
