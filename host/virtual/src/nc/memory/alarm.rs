//! Alarms: they stop a program, or would stop it.

use std::fmt;

use super::settings::ControlFamily;

/// Whether a control stops at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// It stops.
    Alarm,
    /// It may run, though not everywhere or not as meant.
    Warning,
}

/// What a control shows when it stops: where, what, and what to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Alarm {
    /// As this control numbers it, where that is known: Fanuc's PS number (114: format
    /// error in a macro statement), 3000 + n of `#3000 = n`, GRBL's `error:` number (of
    /// probing, its `ALARM:`).
    pub number: Option<u32>,
    /// Whether a control stops at it.
    pub severity: Severity,
    /// The program's O number.
    pub program: u32,
    /// The line in the loaded text, from 1; 0 if it is no line's.
    pub line: u32,
    /// The column in the line, from 1.
    pub column: Option<u32>,
    /// The line as it was loaded.
    pub block: String,
    /// What is wrong and what to do.
    pub message: String,
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "O{:04}", self.program)?;
        if self.line > 0 {
            write!(f, " line {}", self.line)?;
        }
        if let Some(column) = self.column {
            write!(f, " column {column}")?;
        }
        if !self.block.is_empty() {
            write!(f, " `{}`", self.block)?;
        }
        match (self.severity, self.number) {
            (Severity::Warning, _) => write!(f, ": warning: ")?,
            (Severity::Alarm, Some(number)) => write!(f, ": alarm {number}: ")?,
            (Severity::Alarm, None) => write!(f, ": alarm: ")?,
        }
        f.write_str(&self.message)
    }
}

impl std::error::Error for Alarm {}

/// A number of an alarm.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Number {
    /// As Fanuc 0i-D and 30i number it (PS alarms).
    Fanuc(u32),
    /// As the control at hand numbers it.
    Own(u32),
}

/// An alarm that does not know its block yet.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fault {
    number: Option<Number>,
    severity: Severity,
    /// Index of the byte in its line.
    at: Option<usize>,
    message: String,
}

impl Fault {
    /// Without a number: controls differ, or it is not known.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            number: None,
            severity: Severity::Alarm,
            at: None,
            message: message.into(),
        }
    }

    /// With the number that Fanuc 0i-D and 30i show.
    pub fn ps(number: u32, message: impl Into<String>) -> Self {
        Self {
            number: Some(Number::Fanuc(number)),
            ..Self::new(message)
        }
    }

    /// With the number that the control at hand shows.
    pub fn own(number: u32, message: impl Into<String>) -> Self {
        Self {
            number: Some(Number::Own(number)),
            ..Self::new(message)
        }
    }

    /// Something that a control may let pass.
    pub fn warning(message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Warning,
            ..Self::new(message)
        }
    }

    /// At this byte of the line, unless it already has a place.
    pub fn at(mut self, at: usize) -> Self {
        self.at = self.at.or(Some(at));
        self
    }

    /// The alarm in its block.
    pub fn in_block(self, dialect: ControlFamily, program: u32, line: u32, block: &str) -> Alarm {
        Alarm {
            number: match self.number {
                Some(Number::Fanuc(number)) => match dialect {
                    ControlFamily::Fanuc => Some(number),
                    ControlFamily::Grbl => grbl(number),
                    _ => None,
                },
                Some(Number::Own(number)) => Some(number),
                None => None,
            },
            severity: self.severity,
            program,
            line,
            column: self
                .at
                .and_then(|at| u32::try_from(at).ok())
                .map(|at| at.saturating_add(1)),
            block: block.trim().to_string(),
            message: self.message,
        }
    }
}

/// GRBL's `error:` for the same fault.
const fn grbl(fanuc: u32) -> Option<u32> {
    match fanuc {
        // Bad number format, unsupported command, undefined feed, no offsets of an arc.
        5 => Some(2),
        10 => Some(20),
        11 => Some(22),
        22 => Some(35),
        _ => None,
    }
}

/// What may go wrong in a block.
pub(crate) type Checked<T> = Result<T, Fault>;

#[cfg(test)]
mod tests {
    use super::*;

    /// One line: where, what, what to do. Fanuc's numbers are shown on a Fanuc only.
    #[test]
    fn one_line() {
        let fault = Fault::ps(11, "no feed: give F").at(2);
        let alarm = fault
            .clone()
            .in_block(ControlFamily::Fanuc, 1040, 12, "G1 X0.0\r");
        assert_eq!(
            alarm.to_string(),
            "O1040 line 12 column 3 `G1 X0.0`: alarm 11: no feed: give F"
        );
        assert_eq!(fault.in_block(ControlFamily::Haas, 1, 1, "").number, None);
        assert_eq!(
            Fault::own(1015, "")
                .in_block(ControlFamily::Haas, 1, 1, "")
                .number,
            Some(1015)
        );
    }
}
