//! Part programs that a board keeps: what is known of one, and why one is refused.

use heapless::Vec;
use postcard_derive::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;
use thiserror::Error;

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
    /// When it goes out to the control, and how.
    pub release: Release,
    /// How long the control may hold the line while the program is sent, seconds: 5 for one
    /// that the control stores, longer than its longest motion for one that it carries out
    /// as it comes. One that was held for longer begins anew.
    pub hold_s: u16,
    /// What was said of it where it is rewritten. Records of an earlier firmware end before.
    pub stated: Stated,
}

/// What whoever puts a program says of it, because its text does not: see `umi nc rewrite`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct Stated {
    /// Modes in force when it starts, packed: `umi_core::rewrite::StartModes::packed`. 0: none.
    pub start_packed: u16,
    /// Whose meaning counts where controls differ.
    pub dialect: StatedDialect,
    /// A program that it may call although its text is not there; 0: none.
    pub allow_call: u16,
}

/// Whose meaning counts where controls differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum StatedDialect {
    /// Nobody has said: what they do differently is refused.
    #[default]
    NotSaid,
    /// Fanuc, Haas, Mitsubishi.
    Fanuc,
    /// `LinuxCNC`.
    LinuxCnc,
}

/// When a program goes out to a control that asks for it.
///
/// "After an OK verdict" means: begun within the job's setup time-out, before anything is
/// measured again or lost and before another job, and once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Release {
    /// As it is, after an OK verdict.
    AfterVerdict,
    /// After an OK verdict, every motion carried by that verdict's registration. Not with a
    /// job that sends a correction: it would correct twice.
    Rewritten(RewriteSpec),
    /// As it is, whenever it is asked for: a program that probes.
    Always,
    /// Not at all: as the control has punched it.
    Never,
}

/// How a program is rewritten for its control: see `umi nc rewrite`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct RewriteSpec {
    /// Decimals of a length in mm that the control takes, 1 to 6; inches have one more.
    pub decimals_mm: u8,
    /// How far an arc may lie from its image, rounding included.
    pub chord_um: u16,
    /// How far pecks retract where a canned cycle is written out.
    pub clearance_um: u16,
    /// What a length without a decimal point means.
    pub integers: IntegerRule,
    /// The unit before the program says `G20` or `G21`.
    pub unit: UnitRule,
}

/// What a length without a decimal point means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum IntegerRule {
    /// Nobody has said: refused.
    Refused,
    /// Millimetres or inches.
    Units,
    /// Increments of the control.
    Increments,
}

/// The unit before a program says any.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum UnitRule {
    /// The program has to say: motions before are refused.
    Said,
    /// Millimetres.
    Mm,
    /// Inches.
    Inch,
}

/// Why a control that asked for a program got one that raises an alarm.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Withheld {
    /// There is no OK verdict, or it holds no more.
    #[error("there is no OK verdict that holds: probe the part")]
    NoVerdict,
    /// There is no such program.
    #[strum(serialize = "program_not_there")]
    #[error("there is no such program on the board: umi program put")]
    NotThere,
    /// It went out after this verdict already.
    #[strum(serialize = "program_gone_out")]
    #[error("it went out after this verdict already: probe the part again")]
    GoneOut,
    /// The verdict's correction has not gone out yet, and it needs that.
    #[error(
        "the control has not read the verdict's correction yet, and the program as it is needs it: read that first"
    )]
    NotCorrected,
    /// It broke off because the control held the line for too long: nobody knows where the
    /// machine stands in it.
    #[error(
        "it broke off because the control held the line for longer than --hold-s, and nobody knows where the machine stands in it: ask for it again"
    )]
    HeldTooLong,
    /// It does not begin with `%`: what a control has of an older one would run on into it; or
    /// it does not end with `%`, and nobody knows whether it is all of it.
    #[error(
        "it does not begin with %, and what a control still has of an older program would run on into it; or it does not end with %, and may be cut off: put % on its first and last line"
    )]
    NoPercent,
    /// It was punched by the control; nobody has said that it may go out.
    #[strum(serialize = "program_not_released")]
    #[error(
        "the control has punched it and nobody has released it: umi program get it, look at it, and put it with --release"
    )]
    NotReleased,
    /// The job sends a correction: the rewritten program would correct twice.
    #[error(
        "the job sends a correction, and the rewritten program would correct once more: say `send = \"never\"` in the job's [correction], or put the program with --release after-verdict"
    )]
    CorrectedTwice,
    /// The verdict has no registration to rewrite it by.
    #[error("the verdict has no registration to rewrite it by")]
    NoRegistration,
    /// Its settings cannot be used.
    #[error("increment, chord or clearance that it was put with cannot be used")]
    BadSettings,
    /// It cannot be rewritten truly.
    #[error("line {line}, column {column} cannot be rewritten truly: umi nc check says why")]
    NotRewritable {
        /// Line of the program, from 1.
        line: u32,
        /// Character of the line, from 1.
        column: u16,
    },
    /// What is in the flash is not what was put there.
    #[strum(serialize = "program_damaged")]
    #[error(
        "what is in the board's flash is not what was put there: put it again, and replace the board if it stays"
    )]
    Damaged,
    /// The code in which the control writes lacks a character of it.
    #[error("the code in which the control writes has no {:?}", char::from(*.byte))]
    NotInCode {
        /// The character.
        byte: u8,
    },
    /// The journal does not keep that it goes out.
    #[error(
        "the board's journal does not keep that it goes out, and what is not in it does not move metal: look at the board (umi info)"
    )]
    NotJournaled,
    /// Evidence would be overwritten that nobody has acknowledged.
    #[error(
        "the journal is full of evidence that nobody has acknowledged, and the owner wants it kept: pull it, then umi log ack"
    )]
    JournalFull,
    /// The owner allows no program without a verdict.
    #[error(
        "the board's owner allows no program without a verdict (umi config get: ceilings.always)"
    )]
    AlwaysForbidden,
    /// The setup was taught: where it stands is where the program wants it.
    #[error("the setup was taught, and needs no correction: probe the next one")]
    OnlyTaught,
    /// The correction of the latest verdict has gone out.
    #[error("the correction of the latest verdict has gone out: probe the part again")]
    CorrectionGone,
}

impl Withheld {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.into()
    }

    /// What an alarm says on the control's screen: capitals, 28 at most, and no `%`, which
    /// ends a program wherever it stands.
    #[must_use]
    pub const fn alarm(&self) -> &'static str {
        match self {
            Self::NoVerdict => "NO OK VERDICT",
            Self::NotThere => "NO SUCH PROGRAM",
            Self::GoneOut => "PROGRAM HAS GONE OUT - PROBE",
            Self::NotCorrected => "READ THE CORRECTION FIRST",
            Self::HeldTooLong => "HELD TOO LONG - ASK AGAIN",
            Self::NoPercent => "NO PERCENT AT BEGIN OR END",
            Self::NotReleased => "PROGRAM NOT RELEASED",
            Self::CorrectedTwice => "JOB CORRECTS ALREADY",
            Self::NoRegistration => "VERDICT WITHOUT REGISTRATION",
            Self::BadSettings => "SETTINGS OF PROGRAM",
            Self::NotRewritable { .. } => "PROGRAM NOT REWRITABLE",
            Self::Damaged => "PROGRAM DAMAGED",
            Self::NotInCode { .. } => "CHARACTER NOT IN CODE",
            Self::NotJournaled => "JOURNAL NOT WRITTEN",
            Self::JournalFull => "JOURNAL FULL - UMI LOG ACK",
            Self::AlwaysForbidden => "OWNER FORBIDS WITHOUT PROBE",
            Self::OnlyTaught => "TAUGHT - NO CORRECTION",
            Self::CorrectionGone => "CORRECTION WENT OUT",
        }
    }
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
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, Error, IntoStaticStr,
)]
#[strum(serialize_all = "snake_case", prefix = "program_")]
#[postcard(crate = crate)]
pub enum ProgramRefusal {
    /// This board has no room for programs, or what has it does not answer.
    #[strum(serialize = "no_store")]
    #[error(
        "the board has no room for programs, or its memory does not answer: umi info says more"
    )]
    NoRoomAtAll,
    /// The number is not 1 to [`MAX_NUMBER`].
    #[strum(serialize = "number")]
    #[error("a program's number is 1 to {}", MAX_NUMBER)]
    BadNumber,
    /// It has no bytes.
    #[error("the program is empty")]
    Empty,
    /// It finds no room in one piece. A program is replaced only when the new one is
    /// whole, so both need room.
    #[strum(serialize = "store_full")]
    #[error(
        "the program needs {needed_bytes} bytes in one piece, the longest free piece has {longest_bytes} (of {free_bytes} free): delete programs (a program that is replaced stays until the new one is whole)"
    )]
    Full {
        /// What it needs.
        needed_bytes: u32,
        /// The longest program that finds room now.
        longest_bytes: u32,
        /// All free room, in one piece or not.
        free_bytes: u32,
    },
    /// As many programs are kept as can be.
    #[error("the board keeps {most} programs and no more: delete one")]
    TooMany {
        /// So many.
        most: u16,
    },
    /// There is no such program.
    #[error("there is no such program on the board")]
    NotThere,
    /// No upload of this program has begun.
    #[error("no upload of this program has begun: begin it again")]
    NotBegun,
    /// Bytes are missing before its end.
    #[error("the board has only the first {offset} bytes: go on there")]
    Incomplete {
        /// So many are there.
        offset: u32,
    },
    /// What is in the flash has another check value: upload it again.
    #[error(
        "what is in the board's flash has check value {crc32:08X}, not the program's: put it again, and replace the board if it stays"
    )]
    Damaged {
        /// The value of what is there.
        crc32: u32,
    },
    /// A setup is being measured or a program is being sent, or programs are deleted faster than the
    /// board's record can hold (one in two seconds, behind 64 at once): ask again.
    #[error(
        "the board measures a setup or sends a program, or programs were deleted too fast: ask again in two seconds"
    )]
    Busy,
    /// The control has not sent it, or not all of it.
    #[error("the control has not sent it, or not to its end: let it send again")]
    BrokeOff,
    /// What was to be passed through may not go out, or not on: the control has an alarm.
    #[error("the control has got an alarm instead: {0}")]
    Withheld(Withheld),
    /// There is a program of this number with other bytes, and what a control punches
    /// replaces none.
    #[error(
        "the board has another program of this number, with check value {crc32:08X}: delete that one, or punch this one under another number"
    )]
    OtherThere {
        /// The check value of the program that is there.
        crc32: u32,
    },
    /// A start mode is none, or none that the board keeps.
    #[error(
        "a mode that the program is said to begin with is none that the board keeps: one of each group, G54 to G59 among them"
    )]
    BadStart,
    /// The owner allows no program without a verdict.
    #[error(
        "the board's owner allows no program that goes out without a verdict (umi config get: ceilings.always): put it with another --release"
    )]
    AlwaysForbidden,
    /// The room that punched programs may have is taken.
    #[error(
        "punched programs have taken all the room that they may have: get them, then delete them (umi program get, umi program delete)"
    )]
    PunchedFull,
}

impl ProgramRefusal {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Withheld(why) => why.code(),
            // As a job's limit.
            Self::AlwaysForbidden => "beyond_ceiling",
            other => other.into(),
        }
    }
}
