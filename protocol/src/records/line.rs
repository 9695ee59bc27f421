//! Lines and hits as they arrive, for live view.

use heapless::String;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::{Approach, Name};

/// Characters of a line that are reported, at most.
pub const MAX_LINE_TEXT: usize = 160;

/// A line from the control.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct LineReport {
    /// Counts lines, from 1.
    pub number: u32,
    /// Where its first byte stands in the stream.
    pub byte_offset: u64,
    /// When its last byte came.
    pub t_us: u64,
    /// What the receiver made of it.
    pub status: LineStatus,
    /// The text without parity and control codes; longer lines are cut.
    pub text: String<MAX_LINE_TEXT, u8>,
}

/// What the receiver made of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum LineStatus {
    /// It fits one of the job's patterns.
    Matched,
    /// A separator or comment that carries no data.
    Separator,
    /// Part of a program punched on the same port.
    Program,
    /// It fits no pattern.
    NotUnderstood,
    /// Parity, length or check value are wrong: its values are not used.
    Damaged,
    /// It asks for a program: `READ O1234`.
    Request,
    /// A checked line that has come before, to the last digit: it says nothing new.
    Repeated,
}

impl LineStatus {
    /// Such a line says nothing new of the part: what was measured before it still holds.
    #[must_use]
    pub const fn is_silent(self) -> bool {
        matches!(self, Self::Request | Self::Separator | Self::Repeated)
    }
}

/// A hit as the control reported it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct HitReport {
    /// The line that carried it.
    pub line: u32,
    /// When the line's last byte came.
    pub t_us: u64,
    /// The feature, where it is known.
    pub feature: Option<Name>,
    /// Position as printed.
    pub position_mm: [f64; 3],
    /// Direction of motion, where the line says it.
    pub approach: Option<Approach>,
    /// Feed, where the line says it.
    pub feed_mm_per_min: Option<f64>,
}
