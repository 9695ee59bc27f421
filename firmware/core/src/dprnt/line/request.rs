//! Program requests: the line `READ O1234` of a control.
//!
//! On a plain serial line a READ is one character, DC1, and does not say which program is
//! wanted. So a control that wants one prints its number first:
//!
//! ```text
//! POPEN
//! DPRNT[READ*O1234]
//! PCLOS
//! ```
//!
//! and then reads, calls (`M198 P1234`), or begins to carry out what comes.

use super::number::is_blank;
use umi_protocol::program::MAX_NUMBER;

/// The number of the program that a line asks for; none if it asks for none. Blanks may
/// stand anywhere between the parts, as where a variable is printed with leading blanks.
#[must_use]
pub(in crate::dprnt) fn program_asked_for(line: &[u8]) -> Option<u32> {
    let mut rest = line;
    for wanted in b"READO" {
        rest = expect(rest, *wanted)?;
        if *wanted != b'D' {
            continue;
        }
        // At least one blank: a word may begin with READ.
        if !rest.first().is_some_and(|byte| is_blank(*byte)) {
            return None;
        }
        rest = trimmed(rest);
    }
    rest = trimmed(rest);
    let mut number = 0_u32;
    let mut digits = 0;
    while let Some((digit @ b'0'..=b'9', more)) = rest.split_first() {
        number = number.checked_mul(10)?.checked_add((digit - b'0').into())?;
        digits += 1;
        rest = more;
    }
    let ends = trimmed(rest).is_empty() && digits > 0;
    (ends && (1..=MAX_NUMBER).contains(&number)).then_some(number)
}

fn expect(line: &[u8], letter: u8) -> Option<&[u8]> {
    let line = if letter == b'R' { trimmed(line) } else { line };
    let (first, rest) = line.split_first()?;
    (*first == letter).then_some(rest)
}

fn trimmed(line: &[u8]) -> &[u8] {
    let blanks = line.iter().take_while(|byte| is_blank(**byte)).count();
    line.get(blanks..).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::program_asked_for;

    /// What asks for a program, and what only looks as if it did.
    #[test]
    fn lines() {
        let asked = |line: &str| program_asked_for(line.as_bytes());
        for line in [
            "READ O1234",
            " READ O1234 ",
            "READ O  1234",
            "READ  O00001234",
        ] {
            assert_eq!(asked(line), Some(1234), "{line}");
        }
        assert_eq!(asked("READ O99999999"), Some(99_999_999));
        for line in [
            "",
            "READ",
            "READ O",
            "READ O0",
            "READO1234",
            "READ 1234",
            "READ O12A",
            "READ O1234 X1.",
            "READ O123456789",
            "READ O99999999999999999999",
            "READY O1",
            "R EAD O1",
            "X1. READ O1",
        ] {
            assert_eq!(asked(line), None, "{line}");
        }
    }
}
