//! What can go wrong between the control's port and a hit: every fault by
//! name, with where, when and what to do.

use core::fmt;

use heapless::String;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::pattern::Coding;

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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum FaultKind {
    /// Characters with wrong parity.
    BadParity {
        /// How many.
        count: u16,
        /// Position of the first one.
        first: u16,
    },
    /// Characters that the code does not have, or that no text contains.
    UnknownCharacter {
        /// How many.
        count: u16,
        /// Position of the first one.
        first: u16,
        /// The first one as received.
        byte: u8,
    },
    /// The line is longer than the receiver keeps; its head is kept.
    LineTooLong {
        /// Bytes kept.
        kept: u16,
    },
    /// The line broke off: the port was closed or fell silent before its end.
    LineUnterminated,
    /// The line fits none of the job's patterns.
    NotUnderstood,
    /// A number is not as the format says.
    NumberFormat {
        /// What is wrong with it.
        issue: NumberIssue,
        /// Position of the number.
        position: u16,
    },
    /// The check value of a checked line is not that of its fields.
    BadCheckValue {
        /// As printed, in units of 0.0001.
        printed: u32,
        /// As computed from the fields, in units of 0.0001.
        computed: u32,
    },
    /// Checked lines are missing.
    Gap {
        /// The run.
        run: u32,
        /// First missing sequence number.
        from: u32,
        /// Last missing sequence number.
        to: u32,
    },
    /// A checked line came again with the same content; the second is dropped.
    Repeat {
        /// The run.
        run: u32,
        /// The sequence number.
        sequence: u32,
    },
    /// A checked line came again, but not with the same content (or it is too
    /// old to be compared); the second is dropped.
    ConflictingRepeat {
        /// The run.
        run: u32,
        /// The sequence number.
        sequence: u32,
        /// False if the first one is too old to be compared.
        compared: bool,
    },
    /// The value may have lost its high digits.
    OverflowSuspect {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
        /// Integer digits that the format can print.
        integer_digits: u8,
    },
    /// The value is outside the stated travel.
    OutsideTravel {
        /// 0 X, 1 Y, 2 Z.
        axis: u8,
    },
    /// All coordinates are exactly zero.
    NullPoint,
    /// The line says that the probe did not touch; there is no hit.
    NotTouched,
    /// A block ended before its points were complete.
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
    BlockCountMismatch {
        /// Points announced.
        expected: u16,
        /// Points that came, with this one.
        got: u16,
    },
    /// Raw binary in the stream, as BPRNT sends it.
    BinaryData,
    /// A part program was punched on this port; none of its lines were used.
    ProgramReceived {
        /// Lines of the program.
        lines: u32,
    },
    /// A part program on this port has no end.
    ProgramUnterminated {
        /// Lines of the program.
        lines: u32,
    },
    /// Rows of a table are missing.
    RowGap {
        /// First missing row.
        from: u16,
        /// Last missing row.
        to: u16,
    },
    /// A row of a table came again.
    RowRepeated {
        /// The row.
        row: u16,
    },
    /// Bytes were lost before the receiver saw them.
    BufferOverrun {
        /// How many, at least.
        lost: u32,
    },
    /// The control's character code changed.
    CodingChanged {
        /// Before.
        from: Coding,
        /// From this line on.
        to: Coding,
    },
}

/// What is wrong with a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum NumberIssue {
    /// Another number of decimals than the format prints: digits were lost.
    Decimals {
        /// As the format says.
        expected: u8,
        /// As printed.
        got: u8,
    },
    /// More integer digits than the format prints: the format in the job is not
    /// that of the macro, or fields ran together.
    IntegerDigits {
        /// As the format says.
        expected: u8,
        /// As printed.
        got: u8,
    },
    /// No digit where a number is due.
    Missing,
    /// A second number where the line has room for one: a digit was lost inside
    /// a number, or a field is too many.
    Surplus,
    /// A whole number is due.
    NotWhole,
    /// The number is larger than the field allows.
    TooLarge,
}

/// What ended a block of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum BlockEndCause {
    /// As many points came as were announced.
    Count,
    /// The header of another block.
    NewHeader,
    /// Silence.
    Timeout,
    /// The control closed the port (DC4, ETX, EOT).
    PortClosed,
    /// The control opened the port anew (DC2).
    PortOpened,
    /// A part program began.
    Program,
    /// The input ended.
    EndOfInput,
}

impl fmt::Display for BlockEndCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Count => "its count",
            Self::NewHeader => "the header of another block",
            Self::Timeout => "silence",
            Self::PortClosed => "the control closing the port",
            Self::PortOpened => "the control opening the port anew",
            Self::Program => "a part program",
            Self::EndOfInput => "the end of the input",
        })
    }
}

/// The name of a fault, the same in every version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
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
    pub const COUNT: usize = 21;

    /// All of them, in the order of [`Counters::faults`].
    pub const ALL: [Self; Self::COUNT] = [
        Self::BadParity,
        Self::UnknownCharacter,
        Self::LineTooLong,
        Self::LineUnterminated,
        Self::NotUnderstood,
        Self::NumberFormat,
        Self::BadCheckValue,
        Self::Gap,
        Self::Repeat,
        Self::ConflictingRepeat,
        Self::OverflowSuspect,
        Self::OutsideTravel,
        Self::NullPoint,
        Self::NotTouched,
        Self::BlockIncomplete,
        Self::BlockCountMismatch,
        Self::BinaryData,
        Self::ProgramReceived,
        Self::ProgramUnterminated,
        Self::BufferOverrun,
        Self::CodingChanged,
    ];

    /// The name in files, journals and `--json`.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::BadParity => "bad_parity",
            Self::UnknownCharacter => "unknown_character",
            Self::LineTooLong => "line_too_long",
            Self::LineUnterminated => "line_unterminated",
            Self::NotUnderstood => "not_understood",
            Self::NumberFormat => "number_format",
            Self::BadCheckValue => "bad_check_value",
            Self::Gap => "gap",
            Self::Repeat => "repeat",
            Self::ConflictingRepeat => "conflicting_repeat",
            Self::OverflowSuspect => "overflow_suspect",
            Self::OutsideTravel => "outside_travel",
            Self::NullPoint => "null_point",
            Self::NotTouched => "not_touched",
            Self::BlockIncomplete => "block_incomplete",
            Self::BlockCountMismatch => "block_count_mismatch",
            Self::BinaryData => "binary_data",
            Self::ProgramReceived => "program_received",
            Self::ProgramUnterminated => "program_unterminated",
            Self::BufferOverrun => "buffer_overrun",
            Self::CodingChanged => "coding_changed",
        }
    }
}

impl fmt::Display for FaultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
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

/// The letter of an axis number.
const fn axis_letter(axis: u8) -> char {
    match axis {
        0 => 'X',
        1 => 'Y',
        _ => 'Z',
    }
}

impl fmt::Display for NumberIssue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Decimals { expected, got } => write!(
                f,
                "{got} decimals where the format prints {expected}: digits were lost, or the job's format is not that of the macro"
            ),
            Self::IntegerDigits { expected, got } => write!(
                f,
                "{got} integer digits where the format prints {expected}: fields ran together, or the job's format is not that of the macro"
            ),
            Self::Missing => f.write_str("no number where one is due: it was lost, or the control could not print it"),
            Self::Surplus => f.write_str("a number too many: a digit inside a number was lost, or the macro prints more fields than the pattern has"),
            Self::NotWhole => f.write_str("a whole number is due here: use a format without decimals"),
            Self::TooLarge => f.write_str("the number is larger than this field allows"),
        }
    }
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadParity { count, first } => write!(
                f,
                "wrong parity, first at character {first}, {count} in all: the line is not used; check cable, screen and baud rate"
            ),
            Self::UnknownCharacter { count, first, byte } => write!(
                f,
                "byte {byte:#04x} at character {first}, which no text has, {count} such in all: the line is not used; check code, baud rate and what else sends on this port"
            ),
            Self::LineTooLong { kept } => write!(
                f,
                "the line is longer than {kept} bytes: it is not used; print fewer fields, and check that the control sends line ends"
            ),
            Self::LineUnterminated => f.write_str(
                "the line broke off before its end: it is not used; put PCLOS after the last DPRNT, and do not reset while the control sends",
            ),
            Self::NotUnderstood => f.write_str("the line fits none of the job's patterns"),
            Self::NumberFormat { issue, position } => write!(f, "number at {position}: {issue}"),
            Self::BadCheckValue { printed, computed } => write!(
                f,
                "check value {}.{:04} where the fields give {}.{:04}: a digit, sign or field is wrong; the line is not used",
                printed / 10_000,
                printed % 10_000,
                computed / 10_000,
                computed % 10_000
            ),
            Self::Gap { run, from, to } => write!(
                f,
                "lines {from} to {to} of run {run} are missing: measure again, and check handshake and cable"
            ),
            Self::Repeat { run, sequence } => write!(
                f,
                "line {sequence} of run {run} came again with the same content: the second is dropped"
            ),
            Self::ConflictingRepeat { run, sequence, compared: true } => write!(
                f,
                "line {sequence} of run {run} came again with other content: the second is dropped; the macro must take a new run number at each start"
            ),
            Self::ConflictingRepeat { run, sequence, compared: false } => write!(
                f,
                "line {sequence} of run {run} came again, too late to be compared: the second is dropped"
            ),
            Self::OverflowSuspect { axis, integer_digits } => write!(
                f,
                "{} may have lost digits above {integer_digits}: print more integer digits, or state the machine's travel in the job",
                axis_letter(*axis)
            ),
            Self::OutsideTravel { axis } => write!(
                f,
                "{} is outside the travel that the job states: wrong unit, wrong work offset or wrong travel",
                axis_letter(*axis)
            ),
            Self::NullPoint => f.write_str(
                "all coordinates are zero: a missed measurement prints as zero; check that the probe touched",
            ),
            Self::NotTouched => f.write_str(
                "the line says that the probe did not touch: there is no hit; check the target and the probe",
            ),
            Self::BlockIncomplete { expected: Some(expected), got, damaged, ended_by } => write!(
                f,
                "block with {got} good points of {expected} and {damaged} bad lines, ended by {ended_by}: measure again"
            ),
            Self::BlockIncomplete { expected: None, got, damaged, ended_by } => write!(
                f,
                "block without a good count line, with {got} points and {damaged} bad lines, ended by {ended_by}: measure again"
            ),
            Self::BlockCountMismatch { expected, got } => write!(
                f,
                "point {got} of a block of {expected}: the count line and the points do not agree; correct the macro"
            ),
            Self::BinaryData => f.write_str(
                "raw binary (BPRNT) on the line: it cannot be received safely; use DPRNT in the macro",
            ),
            Self::ProgramReceived { lines } => write!(
                f,
                "a part program of {lines} lines was punched on this port: none of it is used as points"
            ),
            Self::ProgramUnterminated { lines } => write!(
                f,
                "a part program of {lines} lines without an end (% or DC4): none of it is used as points; what followed it may be lost"
            ),
            Self::RowGap { from, to } => write!(
                f,
                "rows {from} to {to} of the table are missing: measure again, and check handshake and cable"
            ),
            Self::RowRepeated { row } => write!(
                f,
                "row {row} of the table came again: the table is not used; measure again"
            ),
            Self::BufferOverrun { lost } => write!(
                f,
                "at least {lost} bytes were lost before the receiver: the line is not used; check the handshake"
            ),
            Self::CodingChanged { from, to } => write!(
                f,
                "the control now sends {to}, before it was {from}: set the code in the job if this is not intended"
            ),
        }
    }
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
        for (place, code) in FaultCode::ALL.into_iter().enumerate() {
            assert_eq!(code as usize, place, "{code}");
        }
    }
}
