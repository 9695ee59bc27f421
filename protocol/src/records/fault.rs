//! Faults between the control's port and a hit: each by name, with place, time and
//! remedy.

use core::fmt;

use heapless::String;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumCount, IntoStaticStr, VariantArray};
use thiserror::Error;

use crate::job::pattern::Coding;
use crate::records::reason::axis_name;

/// Characters of a line that a fault quotes, at most.
pub const MAX_EXCERPT: usize = 40;

/// The beginning of the text that a fault is about.
pub type Excerpt = String<MAX_EXCERPT, u8>;

/// Something was lost, damaged, doubtful or not understood.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Fault {
    /// What is wrong, with its figures.
    pub kind: FaultKind,
    /// The line, counted from 1; 0 if no line had come yet.
    pub line: u32,
    /// Where the line's first byte stands in the stream.
    pub byte_offset: u64,
    /// When it was noticed, on the board's clock.
    pub t_us: u64,
    /// The beginning of the line, or the name of the block.
    pub text: Excerpt,
}

impl Fault {
    /// The name of the fault.
    #[must_use]
    pub const fn code(&self) -> FaultCode {
        self.kind.code()
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "line {} (byte {}): {}",
            self.line, self.byte_offset, self.kind
        )?;
        if self.text.is_empty() {
            Ok(())
        } else {
            write!(f, " [{}]", self.text)
        }
    }
}

/// What is wrong, with its figures. Positions count characters from 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema, Error)]
#[postcard(crate = crate)]
pub enum FaultKind {
    /// Characters with wrong parity.
    #[error(
        "wrong parity, first at character {first}, {count} in all: the line is not used; check cable, screen and baud rate"
    )]
    BadParity {
        /// How many.
        count: u16,
        /// Position of the first one.
        first: u16,
    },
    /// Characters that the code does not have, or that no text contains.
    #[error(
        "byte {byte:#04x} at character {first}, which no text has, {count} such in all: the line is not used; check code, baud rate and what else sends on this port"
    )]
    UnknownCharacter {
        /// How many.
        count: u16,
        /// Position of the first one.
        first: u16,
        /// The first one as received.
        byte: u8,
    },
    /// The line is longer than the receiver keeps; its head is kept.
    #[error(
        "the line is longer than {kept} bytes: it is not used; print fewer fields, and check that the control sends line ends"
    )]
    LineTooLong {
        /// Bytes kept.
        kept: u16,
    },
    /// The line broke off: the port was closed or fell silent before its end.
    #[error(
        "the line broke off before its end: it is not used; put PCLOS after the last DPRNT, and do not reset while the control sends"
    )]
    LineUnterminated,
    /// The line fits none of the job's patterns.
    #[error("the line fits none of the job's patterns")]
    NotUnderstood,
    /// A number is not as the format says.
    #[error("number at {position}: {issue}")]
    NumberFormat {
        /// What is wrong with it.
        issue: NumberIssue,
        /// Position of the number.
        position: u16,
    },
    /// The check value of a checked line is not that of its fields.
    #[error("check value {}.{:04} where the fields give {}.{:04}: a digit, sign or field is wrong; the line is not used", .printed / 10_000, .printed % 10_000, .computed / 10_000, .computed % 10_000)]
    BadCheckValue {
        /// As printed, in units of 0.0001.
        printed: u32,
        /// As computed from the fields, in units of 0.0001.
        computed: u32,
    },
    /// Checked lines are missing.
    #[error(
        "lines {from} to {to} of run {run} are missing: measure again, and check handshake and cable"
    )]
    Gap {
        /// The run.
        run: u32,
        /// First missing sequence number.
        from: u32,
        /// Last missing sequence number.
        to: u32,
    },
    /// A checked line came again with the same content; the second is dropped.
    #[error("line {sequence} of run {run} came again with the same content: the second is dropped")]
    Repeat {
        /// The run.
        run: u32,
        /// The sequence number.
        sequence: u32,
    },
    /// A checked line came again, but not with the same content (or it is too
    /// old to be compared); the second is dropped.
    #[error("line {sequence} of run {run} came again{}", repeated(*.compared))]
    ConflictingRepeat {
        /// The run.
        run: u32,
        /// The sequence number.
        sequence: u32,
        /// False if the first one is too old to be compared.
        compared: bool,
    },
    /// The value may have lost its high digits.
    #[error("{} may have lost digits above {integer_digits}: print more integer digits, or state the machine's travel in the job", axis_name(*.axis))]
    OverflowSuspect {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Integer digits that the format can print.
        integer_digits: u8,
    },
    /// The value is outside the stated travel.
    #[error("{} is outside the travel that the job states: wrong unit, wrong work offset or wrong travel", axis_name(*.axis))]
    OutsideTravel {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
    },
    /// All coordinates are exactly zero.
    #[error(
        "all coordinates are zero: a missed measurement prints as zero; check that the probe touched"
    )]
    NullPoint,
    /// The line says that the probe did not touch; there is no hit.
    #[error(
        "the line says that the probe did not touch: there is no hit; check the target and the probe"
    )]
    NotTouched,
    /// A block ended before its points were complete.
    #[error(fmt = incomplete)]
    BlockIncomplete {
        /// Points announced; none if the count line did not come or was damaged.
        expected: Option<u16>,
        /// Points that came intact.
        got: u16,
        /// Lines that were damaged or not understood where a point was due.
        damaged: u16,
        /// What ended it.
        ended_by: BlockEndCause,
    },
    /// More points came than the count line says.
    #[error(
        "point {got} of a block of {expected}: the count line and the points do not agree; correct the macro"
    )]
    BlockCountMismatch {
        /// Points announced.
        expected: u16,
        /// Points that came, with this one.
        got: u16,
    },
    /// Raw binary in the stream, as BPRNT sends it.
    #[error("raw binary (BPRNT) on the line: it cannot be received safely; use DPRNT in the macro")]
    BinaryData,
    /// A part program was punched on this port; none of its lines were used.
    #[error(
        "a part program of {lines} lines was punched on this port: none of it is used as points"
    )]
    ProgramReceived {
        /// Lines of the program.
        lines: u32,
    },
    /// A part program on this port has no end.
    #[error(
        "a part program of {lines} lines without an end (% or DC4): none of it is used as points; what followed it may be lost"
    )]
    ProgramUnterminated {
        /// Lines of the program.
        lines: u32,
    },
    /// Rows of a table are missing.
    #[error(
        "rows {from} to {to} of the table are missing: measure again, and check handshake and cable"
    )]
    RowGap {
        /// First missing row.
        from: u16,
        /// Last missing row.
        to: u16,
    },
    /// A row of a table came again.
    #[error("row {row} of the table came again: the table is not used; measure again")]
    RowRepeated {
        /// The row.
        row: u16,
    },
    /// Bytes were lost before the receiver saw them.
    #[error(
        "at least {lost} bytes were lost before the receiver: the line is not used; check the handshake"
    )]
    BufferOverrun {
        /// How many, at least.
        lost: u32,
    },
    /// The control's character code changed.
    #[error(
        "the control now sends {to}, before it was {from}: set the code in the job if this is not intended"
    )]
    CodingChanged {
        /// Before.
        from: Coding,
        /// From this line on.
        to: Coding,
    },
}

/// What is wrong with a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error)]
#[postcard(crate = crate)]
pub enum NumberIssue {
    /// Another number of decimals than the format prints: digits were lost.
    #[error(
        "{got} decimals where the format prints {expected}: digits were lost, or the job's format is not that of the macro"
    )]
    Decimals {
        /// As the format says.
        expected: u8,
        /// As printed.
        got: u8,
    },
    /// More integer digits than the format prints: the format in the job is not
    /// that of the macro, or fields ran together.
    #[error(
        "{got} integer digits where the format prints {expected}: fields ran together, or the job's format is not that of the macro"
    )]
    IntegerDigits {
        /// As the format says.
        expected: u8,
        /// As printed.
        got: u8,
    },
    /// No digit where a number is due.
    #[error("no number where one is due: it was lost, or the control could not print it")]
    Missing,
    /// A second number where the line has room for one: a digit was lost inside
    /// a number, or a field is too many.
    #[error(
        "a number too many: a digit inside a number was lost, or the macro prints more fields than the pattern has"
    )]
    Surplus,
    /// A whole number is due.
    #[error("a whole number is due here: use a format without decimals")]
    NotWhole,
    /// The number is larger than the field allows.
    #[error("the number is larger than this field allows")]
    TooLarge,
}

/// What ended a block of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error)]
#[postcard(crate = crate)]
pub enum BlockEndCause {
    /// As many points came as were announced.
    #[error("its count")]
    Count,
    /// The header of another block.
    #[error("the header of another block")]
    NewHeader,
    /// Silence.
    #[error("silence")]
    Timeout,
    /// The control closed the port (DC4, ETX, EOT).
    #[error("the control closing the port")]
    PortClosed,
    /// The control opened the port anew (DC2).
    #[error("the control opening the port anew")]
    PortOpened,
    /// A part program began.
    #[error("a part program")]
    Program,
    /// The input ended.
    #[error("the end of the input")]
    EndOfInput,
}

/// The name of a fault, the same in every version.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    Schema,
    Display,
    EnumCount,
    IntoStaticStr,
    VariantArray,
)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum FaultCode {
    /// [`FaultKind::BadParity`]
    BadParity,
    /// [`FaultKind::UnknownCharacter`]
    UnknownCharacter,
    /// [`FaultKind::LineTooLong`]
    LineTooLong,
    /// [`FaultKind::LineUnterminated`]
    LineUnterminated,
    /// [`FaultKind::NotUnderstood`]
    NotUnderstood,
    /// [`FaultKind::NumberFormat`]
    NumberFormat,
    /// [`FaultKind::BadCheckValue`]
    BadCheckValue,
    /// [`FaultKind::Gap`], [`FaultKind::RowGap`]
    Gap,
    /// [`FaultKind::Repeat`]
    Repeat,
    /// [`FaultKind::ConflictingRepeat`], [`FaultKind::RowRepeated`]
    ConflictingRepeat,
    /// [`FaultKind::OverflowSuspect`]
    OverflowSuspect,
    /// [`FaultKind::OutsideTravel`]
    OutsideTravel,
    /// [`FaultKind::NullPoint`]
    NullPoint,
    /// [`FaultKind::NotTouched`]
    NotTouched,
    /// [`FaultKind::BlockIncomplete`]
    BlockIncomplete,
    /// [`FaultKind::BlockCountMismatch`]
    BlockCountMismatch,
    /// [`FaultKind::BinaryData`]
    BinaryData,
    /// [`FaultKind::ProgramReceived`]
    ProgramReceived,
    /// [`FaultKind::ProgramUnterminated`]
    ProgramUnterminated,
    /// [`FaultKind::BufferOverrun`]
    BufferOverrun,
    /// [`FaultKind::CodingChanged`]
    CodingChanged,
}

impl FaultCode {
    /// How many there are.
    pub const COUNT: usize = <Self as strum::EnumCount>::COUNT;

    /// All of them, in the order of [`Counters::faults`].
    pub const ALL: &[Self] = <Self as strum::VariantArray>::VARIANTS;

    /// The name in files, journals and `--json`.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        self.into()
    }
}

impl FaultKind {
    /// The name of the fault.
    #[must_use]
    pub const fn code(&self) -> FaultCode {
        match self {
            Self::BadParity { .. } => FaultCode::BadParity,
            Self::UnknownCharacter { .. } => FaultCode::UnknownCharacter,
            Self::LineTooLong { .. } => FaultCode::LineTooLong,
            Self::LineUnterminated => FaultCode::LineUnterminated,
            Self::NotUnderstood => FaultCode::NotUnderstood,
            Self::NumberFormat { .. } => FaultCode::NumberFormat,
            Self::BadCheckValue { .. } => FaultCode::BadCheckValue,
            Self::Gap { .. } | Self::RowGap { .. } => FaultCode::Gap,
            Self::Repeat { .. } => FaultCode::Repeat,
            Self::ConflictingRepeat { .. } | Self::RowRepeated { .. } => {
                FaultCode::ConflictingRepeat
            }
            Self::OverflowSuspect { .. } => FaultCode::OverflowSuspect,
            Self::OutsideTravel { .. } => FaultCode::OutsideTravel,
            Self::NullPoint => FaultCode::NullPoint,
            Self::NotTouched => FaultCode::NotTouched,
            Self::BlockIncomplete { .. } => FaultCode::BlockIncomplete,
            Self::BlockCountMismatch { .. } => FaultCode::BlockCountMismatch,
            Self::BinaryData => FaultCode::BinaryData,
            Self::ProgramReceived { .. } => FaultCode::ProgramReceived,
            Self::ProgramUnterminated { .. } => FaultCode::ProgramUnterminated,
            Self::BufferOverrun { .. } => FaultCode::BufferOverrun,
            Self::CodingChanged { .. } => FaultCode::CodingChanged,
        }
    }
}

/// What a repeat of other content, or of nobody knows which, comes to.
const fn repeated(compared: bool) -> &'static str {
    if compared {
        " with other content: the second is dropped; the macro must take a new run number at each start"
    } else {
        ", too late to be compared: the second is dropped"
    }
}

fn incomplete(
    expected: &Option<u16>,
    got: &u16,
    damaged: &u16,
    ended_by: &BlockEndCause,
    f: &mut fmt::Formatter<'_>,
) -> fmt::Result {
    match expected {
        Some(expected) => write!(f, "block with {got} good points of {expected}")?,
        None => write!(f, "block without a good count line, with {got} points")?,
    }
    write!(
        f,
        " and {damaged} bad lines, ended by {ended_by}: measure again"
    )
}

/// Everything that the receiver counts since it was started. Counters stop at
/// their largest value, they do not wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Counters {
    /// Bytes received.
    pub bytes: u64,
    /// Of these: characters of lines, also of damaged ones.
    pub bytes_text: u64,
    /// Of these: line ends.
    pub bytes_line_end: u64,
    /// Of these: control codes and feed that were dropped.
    pub bytes_control: u64,
    /// Of these: the rest of lines that were too long.
    pub bytes_discarded: u64,
    /// Bytes lost before the receiver, at least.
    pub bytes_lost: u64,
    /// Lines with at least one character.
    pub lines: u32,
    /// Lines that carried a point, a header, a count or a table row.
    pub lines_matched: u32,
    /// Lines that only separate.
    pub lines_separator: u32,
    /// Lines of part programs.
    pub lines_program: u32,
    /// Lines that fit no pattern.
    pub lines_not_understood: u32,
    /// Lines whose values are not used because they are damaged.
    pub lines_damaged: u32,
    /// Points handed on, with or without a doubt.
    pub hits: u32,
    /// Faults by [`FaultCode`], in the order of [`FaultCode::ALL`].
    pub faults: [u32; FaultCode::COUNT],
}

impl Counters {
    /// How often this fault occurred.
    #[must_use]
    pub fn of(&self, code: FaultCode) -> u32 {
        self.faults.get(code as usize).copied().unwrap_or(0)
    }

    /// Counts one fault.
    pub fn count(&mut self, code: FaultCode) {
        if let Some(n) = self.faults.get_mut(code as usize) {
            *n = n.saturating_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The counters' order is that of the table, so a code's count is its own.
    #[test]
    fn codes_stand_in_the_table_at_their_own_place() {
        for (place, code) in FaultCode::ALL.iter().copied().enumerate() {
            assert_eq!(code as usize, place, "{code}");
        }
    }
}
