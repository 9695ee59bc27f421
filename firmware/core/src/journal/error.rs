//! Journal errors, each with a code for machines and a sentence for people.

use core::fmt;

use strum::IntoStaticStr;
use thiserror::Error;

/// What is wrong with the record itself, as reading it shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum JournalFault {
    /// The entry's CRC or length is wrong: its content is not known.
    #[strum(serialize = "entry_damaged")]
    #[error(
        "entry {seq} is damaged (its check value is wrong): do not rely on it, keep the file or the board for examination"
    )]
    Damaged {
        /// The entry that should be there.
        seq: u64,
    },
    /// Entries `first..next` are not there.
    #[strum(serialize = "entries_missing")]
    #[error("entries {first} to {} are missing: look for another copy of this journal", .next.saturating_sub(1))]
    Missing {
        /// The first entry that is missing.
        first: u64,
        /// The entry that was found instead.
        next: u64,
    },
    /// The entry is whole, and its chain value does not follow from what stands
    /// before it: it, or something before it, was changed.
    #[error(
        "entry {seq} does not follow from the entries before it: the record was changed at or before it; compare with another copy or a noted chain value"
    )]
    ChainBroken {
        /// The first entry that does not fit.
        seq: u64,
    },
    /// The bytes end inside this entry.
    #[strum(serialize = "entry_cut_short")]
    #[error("the journal ends inside entry {seq}: it was not copied to its end, pull it again")]
    CutShort {
        /// The entry that is not complete.
        seq: u64,
    },
}

impl JournalFault {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.into()
    }

    /// The first entry that is bad.
    #[must_use]
    pub fn seq(&self) -> u64 {
        match *self {
            Self::Damaged { seq }
            | Self::Missing { first: seq, .. }
            | Self::ChainBroken { seq }
            | Self::CutShort { seq } => seq,
        }
    }
}

/// Why a flash region cannot hold a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum GeometryFault {
    /// Fewer than two sectors: the record would be gone while one is erased.
    #[error("give it two or more erase sectors")]
    TooFewSectors,
    /// `write_size` is not a power of two between 1 and 256.
    #[error("the write size must be a power of two, 1 to 256 bytes")]
    WriteSize,
    /// `page_size` is not a power of two, or smaller than `write_size`.
    #[error("the page size must be a power of two and not smaller than the write size")]
    PageSize,
    /// `sector_size` is not a multiple of `page_size` (and of four).
    #[error("the sector size must be a multiple of the page size and of four bytes")]
    SectorNotWholePages,
    /// A sector cannot hold its header and one entry of 64 bytes.
    #[error("a sector must hold its header and an entry of 64 bytes; join sectors")]
    SectorTooSmall,
    /// The region is larger than 2 GiB.
    #[error("the region is larger than 2 GiB; give it less")]
    TooLarge,
}

/// Why a journal call was refused or failed. `E` is the flash driver's error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum JournalError<E> {
    /// The flash driver reported an error. The entry was not acknowledged; it
    /// may or may not be found after the next power-up.
    #[strum(serialize = "flash_error")]
    #[error(
        "the flash reports {0:?}: the entry is not recorded; try again, and replace the board if it stays"
    )]
    Flash(E),
    /// The flash did not keep what was programmed, in two different sectors.
    #[strum(serialize = "flash_not_kept")]
    #[error(
        "the flash does not keep what is written (at {addr:#x} of the journal): it is worn out or failing, replace the board"
    )]
    NotKept {
        /// The first address that reads back differently.
        addr: u32,
    },
    /// The oldest sector holds what must not be overwritten yet.
    #[strum(serialize = "journal_full")]
    #[error(
        "the journal is full of what nobody has acknowledged: the entry is not recorded; pull the journal, keep the file, and acknowledge it"
    )]
    Full,
    /// The region cannot hold a journal.
    #[strum(serialize = "flash_unsuitable")]
    #[error("this flash region cannot hold a journal: {0}")]
    Geometry(GeometryFault),
    /// The region holds something that is not a journal.
    #[strum(serialize = "not_a_journal")]
    #[error(
        "the flash region holds something that is not a journal: save it if it may matter, then format the region"
    )]
    NotAJournal,
    /// The region holds a journal of another format version.
    #[strum(serialize = "journal_version")]
    #[error(
        "the journal on this board has format version {found}: use the firmware that wrote it, or pull it and format the region"
    )]
    Version {
        /// The version found.
        found: u8,
    },
    /// The region holds a journal that was laid out for another shape.
    #[strum(serialize = "journal_geometry")]
    #[error(
        "the journal on this board was laid out for {sectors} sectors of {sector_size} bytes, aligned to {align}: use the firmware that wrote it, or pull it and format the region"
    )]
    OtherGeometry {
        /// Sectors it was laid out for.
        sectors: u16,
        /// Their size in bytes.
        sector_size: u32,
        /// Alignment of its entries in bytes.
        align: u32,
    },
    /// The payload is longer than an entry can hold.
    #[error("a payload of {len} bytes is too long for the journal: split it, {max} fit")]
    PayloadTooLong {
        /// Its length in bytes.
        len: usize,
        /// The longest that fits here.
        max: usize,
    },
    /// The caller's buffer is too small for the entry.
    #[error("the buffer is too small for this entry: {need} bytes are needed")]
    BufferTooSmall {
        /// The size needed in bytes.
        need: usize,
    },
    /// The entry was overwritten long ago or does not exist yet.
    #[error(fmt = out_of_range)]
    OutOfRange {
        /// The entry asked for.
        seq: u64,
        /// The oldest entry there is.
        first: u64,
        /// The number that the next entry will get.
        next: u64,
    },
    /// The record itself is bad.
    #[error("{0}")]
    Record(JournalFault),
}

impl<E> JournalError<E> {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Record(fault) => fault.code(),
            other => other.into(),
        }
    }
}

impl<E> From<JournalFault> for JournalError<E> {
    fn from(fault: JournalFault) -> Self {
        Self::Record(fault)
    }
}

fn out_of_range(seq: &u64, first: &u64, next: &u64, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if seq < first {
        write!(
            f,
            "entry {seq} is no longer on the board, the oldest is {first} (next is {next}): start at {first}"
        )
    } else {
        write!(
            f,
            "entry {seq} does not exist yet, the next will be {next} (oldest is {first}): ask again later"
        )
    }
}
