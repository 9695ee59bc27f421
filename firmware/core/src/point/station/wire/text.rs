//! A sensor's readings as text.
//!
//! ```text
//! 00017 43.998213 87.2 3391
//! 00018 - out_of_range
//! ```

use umi_protocol::point_sensor::{ColumnSeparator, SensorText};

pub use umi_protocol::point_sensor::SignalLoss;

use super::buffer::{LineBuffer, TooLong};
use crate::units::Mm;

/// Longest line.
const LINE: usize = 80;

/// Most columns.
pub(in crate::point::station) const COLUMNS: usize = 8;

/// How a sensor writes a reading: columns, counted from 0, with something between them. A
/// distance that begins with no digit and no sign before one is no signal; its reason is then
/// in the column behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadingText {
    /// What stands between columns; several blanks count as one.
    pub separator: u8,
    /// The reading's own number.
    pub number: usize,
    /// Distance, mm.
    pub gamma: usize,
    /// Signal to noise, per cent.
    pub snr: usize,
    /// Light received.
    pub total: usize,
}

impl Default for ReadingText {
    /// Number, distance, SNR, Total with blanks between them.
    fn default() -> Self {
        SensorText::default().into()
    }
}

impl From<SensorText> for ReadingText {
    fn from(text: SensorText) -> Self {
        Self {
            separator: match text.separator {
                ColumnSeparator::Blank => b' ',
                ColumnSeparator::Comma => b',',
                ColumnSeparator::Semicolon => b';',
                ColumnSeparator::Tab => b'\t',
            },
            number: text.number.into(),
            gamma: text.gamma.into(),
            snr: text.snr.into(),
            total: text.total.into(),
        }
    }
}

/// A reading with its quality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoodReading {
    /// Distance along the beam.
    pub gamma: Mm,
    /// Signal to noise, per cent.
    pub snr: f64,
    /// Light received.
    pub total: f64,
}

/// What a line says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberedReading {
    /// The reading's own number.
    pub number: u32,
    /// What was read, or why nothing was.
    pub signal: Result<GoodReading, SignalLoss>,
}

/// A line as it comes.
#[derive(Debug, Default)]
pub(in crate::point::station) struct TextLine(LineBuffer<LINE>);

impl TextLine {
    /// Something of the line is lost: it says nothing.
    pub fn spoil(&mut self) {
        self.0.spoil();
    }

    /// The next byte; at the end of a line, what it says. Empty lines say nothing.
    pub fn byte(&mut self, byte: u8, text: &ReadingText) -> Option<Result<NumberedReading, ()>> {
        let byte = byte & 0x7F;
        if byte != b'\n' && byte != b'\r' {
            self.0.push(byte);
            return None;
        }
        match self.0.end() {
            Ok(b"") => None,
            Ok(line) => Some(reading(line, text).ok_or(())),
            Err(TooLong) => Some(Err(())),
        }
    }
}

/// What a line says.
fn reading(line: &[u8], text: &ReadingText) -> Option<NumberedReading> {
    let line = core::str::from_utf8(line).ok()?;
    let mut columns = [""; COLUMNS];
    let mut parts = line
        .split(char::from(text.separator))
        .map(str::trim)
        .filter(|part| text.separator != b' ' || !part.is_empty());
    for (slot, part) in columns.iter_mut().zip(&mut parts) {
        *slot = part;
    }
    let column = |place: usize| columns.get(place).copied().unwrap_or("");
    let number = column(text.number).parse().ok()?;
    let finite = |word: &str| word.parse().ok().filter(|x: &f64| x.is_finite());
    let Some(gamma) = finite(column(text.gamma)) else {
        let loss = match column(text.gamma + 1) {
            "out_of_range" => SignalLoss::OutOfRange,
            "too_steep" => SignalLoss::TooSteep,
            "occluded" => SignalLoss::Occluded,
            "underexposed" => SignalLoss::Underexposed,
            _ => return None,
        };
        return Some(NumberedReading {
            number,
            signal: Err(loss),
        });
    };
    Some(NumberedReading {
        number,
        signal: Ok(GoodReading {
            gamma: Mm(gamma),
            snr: finite(column(text.snr))?,
            total: finite(column(text.total))?,
        }),
    })
}
