//! Part programs punched on the port that also prints.
//!
//! A program is a text like any other, and may hold `DPRNT` statements and
//! coordinates: nothing in it may become a point. It begins with `%` and an
//! O-number, with an O-number alone, or with a named `%`; it ends with `%`,
//! when the control closes the port, or at a line that no program holds: a checked line
//! or the header of a block. A `%` by itself does not make a program:
//! printed files begin and end with it on some controls.

use crate::dprnt::line::number::is_blank;

/// Where we are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::dprnt) enum Program {
    /// Between programs.
    #[default]
    None,
    /// After a `%`: what follows decides.
    Percent,
    /// Printed text between two `%`.
    Printed,
    /// In a program, with as many lines so far.
    Inside(u32),
}

/// What a line means for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::dprnt) enum Step {
    /// Nothing: it is printed text as far as can be seen.
    Text,
    /// A `%` that separates.
    Mark,
    /// The first line of a program.
    Begin,
    /// A line of a program.
    Line,
    /// The `%` that ends a program of so many lines.
    End(u32),
}

impl Program {
    /// A line, before any pattern is tried on it.
    pub fn line(&mut self, text: &[u8]) -> Step {
        let text = trimmed(text);
        if let Self::Inside(lines) = *self {
            if text.first() == Some(&b'%') {
                *self = Self::None;
                return Step::End(lines);
            }
            self.damaged();
            return Step::Line;
        }
        if text == b"%" {
            *self = match *self {
                Self::Printed => Self::None,
                _ => Self::Percent,
            };
            return Step::Mark;
        }
        let begins = is_named_percent(text) || (*self == Self::Percent && is_program_number(text));
        if begins { self.begin() } else { Step::Text }
    }

    /// The same line, if it fits no pattern.
    pub fn no_pattern(&mut self, text: &[u8]) -> Step {
        let text = trimmed(text);
        let begins = match self {
            Self::Percent => is_block(text),
            _ => is_program_number(text),
        };
        if begins { self.begin() } else { Step::Text }
    }

    /// The line was printed text: after a `%` it says what this is.
    pub fn printed(&mut self) {
        if *self == Self::Percent {
            *self = Self::Printed;
        }
    }

    /// A line that cannot be read: inside a program it belongs to it.
    pub fn damaged(&mut self) {
        if let Self::Inside(lines) = self {
            *lines = lines.saturating_add(1);
        }
    }

    /// Whatever it is ends here; the lines of the program, if it is one.
    pub fn close(&mut self) -> Option<u32> {
        match core::mem::take(self) {
            Self::Inside(lines) => Some(lines),
            _ => None,
        }
    }

    fn begin(&mut self) -> Step {
        *self = Self::Inside(1);
        Step::Begin
    }
}

fn trimmed(mut text: &[u8]) -> &[u8] {
    while let Some((first, rest)) = text.split_first().filter(|(b, _)| is_blank(**b)) {
        let _ = first;
        text = rest;
    }
    while let Some((last, rest)) = text.split_last().filter(|(b, _)| is_blank(**b)) {
        let _ = last;
        text = rest;
    }
    text
}

/// `O1234`, `O1234(NAME)`, `:0001`.
fn is_program_number(text: &[u8]) -> bool {
    let Some((b'O' | b':', rest)) = text.split_first() else {
        return false;
    };
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    let rest = trimmed(rest.get(digits..).unwrap_or_default());
    (1..=8).contains(&digits) && matches!(rest.first(), None | Some(b'('))
}

/// `%1234`, `%NAME,MX,` (Fagor), `$NAME.MIN%` (Okuma).
fn is_named_percent(text: &[u8]) -> bool {
    let okuma = text.first() == Some(&b'$') && text.last() == Some(&b'%');
    okuma || (text.first() == Some(&b'%') && text.len() > 1)
}

/// A program number with anything after it, a comment, a name, a skipped block,
/// or a block that begins with N, G, M or T and a digit.
fn is_block(text: &[u8]) -> bool {
    match text {
        [b'(' | b'/' | b'<', ..] => true,
        [b'O' | b':' | b'N' | b'G' | b'M' | b'T', second, ..] => {
            second.is_ascii_digit() || *second == b'<'
        }
        _ => false,
    }
}
