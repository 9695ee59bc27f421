//! The DPRNT receiver: bytes from the control in, lines, hits and faults out.
//!
//! ```text
//! byte ─► code and parity ─► line ─► program? ─► pattern ─► hit
//!         (coding)           (line)  (program)   (pattern, block, checked)
//! ```
//!
//! It works byte by byte, without a heap; the same bytes give the same output
//! however they are cut into pieces. Time is only handed through, and compared
//! with the job's idle time-out in [`LineSplitter::on_time`].
//!
//! # What controls send
//!
//! Rules that makers' manuals and captures teach; the tests name them.
//!
//! 1. Blanks may stand between a sign and its digits: `X - 123.4560` (Brother,
//!    Fanuc with 6001#1 = 0). The sign belongs to the number that follows.
//! 2. A value too large for its field loses its high digits without a word
//!    (Brother, Fanuc), or widens the field (Haas). A hit whose value may have
//!    lost digits carries a doubt ([`Doubts`]).
//! 3. An empty variable prints as zero: so does a missed measurement. A point of
//!    zeros carries a doubt; a single zero can only be caught by a flag.
//! 4. There is a negative zero: the sign is that before rounding.
//! 5. The integer part may be missing: `-.46`.
//! 6. Fields may stand without blanks: `X128.474Y-91.200T23`.
//! 7. Lines end in LF, CR, LF CR, LF CR CR, CR LF or EIA's EOB; a run is one end.
//! 8. Control codes stand anywhere: DC1 to DC4, NUL, DEL, SI, SO, and parity in
//!    bit 7. Parity is checked; a line with a wrong character is kept and
//!    reported, but its values are not used.
//! 9. The port may be closed before it is opened: DC4 DC2 at the start.
//! 10. Lines come twice, after a restart inside a program or from a dry run: run
//!     and sequence numbers tell ([`checked`]).
//! 11. BPRNT is raw binary. It is refused by name.
//!
//! And part programs are punched on the same port: nothing in them is a point.
//!
//! Nothing is dropped silently: every byte is in one of the [`Counters`], every
//! line becomes an [`Item::Line`], everything wrong an [`Item::Fault`].

mod code;
mod config;
mod line;
mod stream;
#[cfg(test)]
mod tests;

use umi_protocol::fault::{BlockEndCause, Fault};
use umi_protocol::job::{Approach, Name};

use crate::units::{Micros, Point};

pub use code::encode::encode;
pub use config::{ConfigError, TemplateIssue, check_config};
pub use line::checked;
pub use line::raw_line::MAX_LINE;
pub use stream::line_splitter::LineSplitter;
pub use umi_protocol::fault::Counters;
pub use umi_protocol::line::LineStatus;
pub use umi_protocol::pattern::{Coding, ReceiverConfig};

/// What the receiver hands to its sink, in the order of the stream: first a
/// line, then what follows from it.
#[derive(Clone, Debug, PartialEq)]
pub enum Item<'a> {
    /// A line came to its end.
    Line(Line<'a>),
    /// A block of points begins.
    BlockStart(BlockStart),
    /// A point.
    Hit(ReportedHit),
    /// A block of points ends.
    BlockEnd(BlockEnd),
    /// A checked line says something about its run.
    Announced(Announced),
    /// The line asks for the program of this number.
    Request(u32),
    /// The control reads (DC1) between two lines, with no block or program begun.
    Reads,
    /// Something is wrong.
    Fault(Fault),
}

/// A line from the control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line<'a> {
    /// Counts lines with at least one character, from 1.
    pub number: u32,
    /// Where its first byte stands in the stream.
    pub byte_offset: u64,
    /// When its first byte came.
    pub first: Micros,
    /// When its last byte (or its line end) came.
    pub last: Micros,
    /// What the receiver made of it.
    pub status: LineStatus,
    /// Which of the job's patterns it fits, from 0.
    pub pattern: Option<u8>,
    /// The code in which it was read.
    pub coding: Coding,
    /// The text without parity and control codes, printable ASCII only: a
    /// character that could not be read stands as `?`.
    pub text: &'a str,
}

/// A block of points begins.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockStart {
    /// The name in the header.
    pub name: Name,
    /// The header's line.
    pub line: u32,
}

/// A block of points ends.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockEnd {
    /// The name in the header.
    pub name: Name,
    /// Points announced; none if the count line did not come or was damaged.
    pub expected: Option<u16>,
    /// Points that came intact.
    pub got: u16,
    /// Lines that were damaged or not understood where a point was due.
    pub damaged: u16,
    /// True if as many intact points came as were announced.
    pub complete: bool,
    /// What ended it.
    pub ended_by: BlockEndCause,
}

/// A point as the control printed it.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportedHit {
    /// The line that carried it.
    pub line: u32,
    /// When the line's first byte came.
    pub first: Micros,
    /// When the line's last byte came.
    pub last: Micros,
    /// Position as printed. A negative zero is given as zero, an axis that the
    /// line does not carry as zero (or as the job's `z_mm`).
    pub position: Point,
    /// Digits as printed, per axis; none for an axis that the line does not carry.
    pub digits: [Option<Digits>; 3],
    /// The feature's name: the block's header or the line's own.
    pub feature: Option<Name>,
    /// The feature's number on a checked line.
    pub feature_id: Option<u16>,
    /// The point's place, from 1: in its block (counting bad lines too), or as
    /// the line itself says.
    pub index: Option<u32>,
    /// The run of a checked line.
    pub run: Option<u32>,
    /// The sequence number of a checked line.
    pub sequence: Option<u32>,
    /// The direction of motion, where the line says it.
    pub approach: Option<Approach>,
    /// `Some(true)` where the line says that the probe touched. A line that
    /// says it did not is a fault and never a hit.
    pub touched: Option<bool>,
    /// The feed in mm/min, where the line says it.
    pub feed_mm_per_min: Option<f64>,
    /// Why the point must not be used as it stands.
    pub doubts: Doubts,
}

/// What a checked line says about its run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Announced {
    /// The run.
    pub run: u32,
    /// What it says.
    pub said: Said,
}

/// What can be said about a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Said {
    /// In which work offset it is probed, and its values (A7).
    Frame {
        /// 1 for G54 to 6 for G59; from 101 on a further one.
        offset: u16,
        /// X, Y, Z of it.
        origin: Point,
        /// The run in which the control was last asked to teach, this one too; 0: it does not say.
        asked_in: u32,
    },
    /// What else moves its coordinates (A9).
    Moved(Moved),
    /// By what its coordinates lie elsewhere than offset, external offset and tool length say
    /// (A7 T1).
    Shifted {
        /// The active work offset, as in [`Said::Frame`].
        offset: u16,
        /// Machine position less work position less all that has a variable.
        by: Point,
    },
    /// What it measures is to be the reference (A8).
    Teach {
        /// Also in place of one that there is.
        again: bool,
    },
}

/// What moves a run's coordinates besides its work offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// A rotation is active.
    pub is_rotated: bool,
    /// Tool length in force.
    pub tool_length_mm: f64,
    /// The external offset.
    pub external: Point,
}

/// Digits of a number as printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Digits {
    /// Before the point, without leading zeros.
    pub integer: u8,
    /// After the point.
    pub decimals: u8,
}

/// Why a point must not be used as it stands: a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Doubts(u8);

impl Doubts {
    /// No doubt.
    pub const NONE: Self = Self(0);
    /// A coordinate may have lost its high digits.
    pub const OVERFLOW_SUSPECT: Self = Self(1);
    /// All coordinates are exactly zero.
    pub const NULL_POINT: Self = Self(2);
    /// A coordinate is outside the stated travel.
    pub const OUTSIDE_TRAVEL: Self = Self(4);

    /// Adds the doubts of the other set.
    pub const fn add(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// True if all doubts of the other set are in this one.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// True if there is no doubt.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}
