//! Part programs that a board keeps: what is known of one, and why one is refused.

use core::fmt;

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

use crate::job::Name;

/// Bytes of a program in one message, at most.
pub const MAX_PIECE: usize = 512;
/// Programs in one message, at most.
pub const MAX_LISTED: usize = 8;
/// The largest program number: O and eight digits.
pub const MAX_NUMBER: u32 = 99_999_999;

/// Bytes of a program, in one message.
pub type Piece = Vec<u8, MAX_PIECE>;

/// What is known of a program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct ProgramInfo {
    /// Its O-number, 1 to [`MAX_NUMBER`].
    pub number: u32,
    /// For people: the file's name or the first comment.
    pub name: Name,
    /// How many bytes it has.
    pub bytes: u32,
    /// CRC-32 (ISO-HDLC, that of zip) of all of them.
    pub crc32: u32,
}

/// How much room there is for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct ProgramRoom {
    /// Programs that are kept.
    pub programs: u16,
    /// As many can be.
    pub most_programs: u16,
    /// The longest program that finds room now.
    pub longest_bytes: u32,
    /// All free room, in one piece or not.
    pub free_bytes: u32,
    /// All room.
    pub total_bytes: u32,
}

/// Why the board does not do that with a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum ProgramRefusal {
    /// This board has no room for programs, or what has it does not answer.
    NoRoomAtAll,
    /// The number is not 1 to [`MAX_NUMBER`].
    BadNumber,
    /// It has no bytes.
    Empty,
    /// It finds no room in one piece. A program is replaced only when the new one is
    /// whole, so both need room.
    Full {
        /// What it needs.
        needed_bytes: u32,
        /// The longest program that finds room now.
        longest_bytes: u32,
        /// All free room, in one piece or not.
        free_bytes: u32,
    },
    /// As many programs are kept as can be.
    TooMany {
        /// So many.
        most: u16,
    },
    /// There is no such program.
    NotThere,
    /// No upload of this program has begun.
    NotBegun,
    /// Bytes are missing before its end.
    Incomplete {
        /// So many are there.
        offset: u32,
    },
    /// What is in the flash has another check value: upload it again.
    Damaged {
        /// The value of what is there.
        crc32: u32,
    },
    /// A plate is being measured or a program is being sent: ask again.
    Busy,
    /// There is a program of this number with other bytes, and what a control punches
    /// replaces none.
    OtherThere {
        /// The check value of the program that is there.
        crc32: u32,
    },
}

impl ProgramRefusal {
    /// A stable name for machines.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NoRoomAtAll => "program_no_store",
            Self::BadNumber => "program_number",
            Self::Empty => "program_empty",
            Self::Full { .. } => "program_store_full",
            Self::TooMany { .. } => "program_too_many",
            Self::NotThere => "program_not_there",
            Self::NotBegun => "program_not_begun",
            Self::Incomplete { .. } => "program_incomplete",
            Self::Damaged { .. } => "program_damaged",
            Self::Busy => "program_busy",
            Self::OtherThere { .. } => "program_other_there",
        }
    }
}

impl fmt::Display for ProgramRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoRoomAtAll => f.write_str(
                "the board has no room for programs, or its memory does not answer: umi info says more",
            ),
            Self::BadNumber => write!(f, "a program's number is 1 to {MAX_NUMBER}"),
            Self::Empty => f.write_str("the program is empty"),
            Self::Full {
                needed_bytes,
                longest_bytes,
                free_bytes,
            } => write!(
                f,
                "the program needs {needed_bytes} bytes in one piece, the longest free piece has {longest_bytes} (of {free_bytes} free): delete programs (a program that is replaced stays until the new one is whole)"
            ),
            Self::TooMany { most } => {
                write!(f, "the board keeps {most} programs and no more: delete one")
            }
            Self::NotThere => f.write_str("there is no such program on the board"),
            Self::NotBegun => {
                f.write_str("no upload of this program has begun: begin it again")
            }
            Self::Incomplete { offset } => write!(
                f,
                "the board has only the first {offset} bytes: go on there"
            ),
            Self::Damaged { crc32 } => write!(
                f,
                "what is in the board's flash has check value {crc32:08X}, not the program's: put it again, and replace the board if it stays"
            ),
            Self::Busy => f.write_str(
                "the board measures a plate or sends a program: ask again when it is over",
            ),
            Self::OtherThere { crc32 } => write!(
                f,
                "the board has another program of this number, with check value {crc32:08X}: delete that one, or punch this one under another number"
            ),
        }
    }
}

impl core::error::Error for ProgramRefusal {}
