//! What can go wrong, each with a code for machines and a sentence for people.

use core::fmt;

/// What is wrong with the record itself, as reading it shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The entry's CRC or length is wrong: its content is not known.
    Damaged {
        /// The entry that should be there.
        seq: u64,
    },
    /// Entries `first..next` are not there.
    Missing {
        /// The first entry that is missing.
        first: u64,
        /// The entry that was found instead.
        next: u64,
    },
    /// The entry is whole, and its chain value does not follow from what stands
    /// before it: it, or something before it, was changed.
    ChainBroken {
        /// The first entry that does not fit.
        seq: u64,
    },
    /// The bytes end inside this entry.
    CutShort {
        /// The entry that is not complete.
        seq: u64,
    },
}

impl Fault {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Damaged { .. } => "entry_damaged",
            Self::Missing { .. } => "entries_missing",
            Self::ChainBroken { .. } => "chain_broken",
            Self::CutShort { .. } => "entry_cut_short",
        }
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

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Damaged { seq } => write!(
                f,
                "entry {seq} is damaged (its check value is wrong): \
                 do not rely on it, keep the file or the board for examination"
            ),
            Self::Missing { first, next } => write!(
                f,
                "entries {first} to {} are missing: look for another copy of this journal",
                next.saturating_sub(1)
            ),
            Self::ChainBroken { seq } => write!(
                f,
                "entry {seq} does not follow from the entries before it: the record was \
                 changed at or before it; compare with another copy or a noted chain value"
            ),
            Self::CutShort { seq } => write!(
                f,
                "the journal ends inside entry {seq}: it was not copied to its end, pull it again"
            ),
        }
    }
}

impl core::error::Error for Fault {}

/// Why a flash region cannot hold a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeometryFault {
    /// Fewer than two sectors: the record would be gone while one is erased.
    TooFewSectors,
    /// `write_size` is not a power of two between 1 and 256.
    WriteSize,
    /// `page_size` is not a power of two, or smaller than `write_size`.
    PageSize,
    /// `sector_size` is not a multiple of `page_size` (and of four).
    SectorNotWholePages,
    /// A sector cannot hold its header and one entry of 64 bytes.
    SectorTooSmall,
    /// The region is larger than 2 GiB.
    TooLarge,
}

/// Why a journal call was refused or failed. `E` is the flash driver's error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error<E> {
    /// The flash driver reported an error. The entry was not acknowledged; it
    /// may or may not be found after the next power-up.
    Flash(E),
    /// The flash did not keep what was programmed, in two different sectors.
    NotKept {
        /// The first address that reads back differently.
        addr: u32,
    },
    /// The region cannot hold a journal.
    Geometry(GeometryFault),
    /// The region holds something that is not a journal.
    NotAJournal,
    /// The region holds a journal of another format version.
    Version {
        /// The version found.
        found: u8,
    },
    /// The region holds a journal that was laid out for another shape.
    OtherGeometry {
        /// Sectors it was laid out for.
        sectors: u16,
        /// Their size in bytes.
        sector_size: u32,
        /// Alignment of its entries in bytes.
        align: u32,
    },
    /// The payload is longer than an entry can hold.
    PayloadTooLong {
        /// Its length in bytes.
        len: usize,
        /// The longest that fits here.
        max: usize,
    },
    /// The caller's buffer is too small for the entry.
    BufferTooSmall {
        /// The size needed in bytes.
        need: usize,
    },
    /// The entry was overwritten long ago or does not exist yet.
    OutOfRange {
        /// The entry asked for.
        seq: u64,
        /// The oldest entry there is.
        first: u64,
        /// The number that the next entry will get.
        next: u64,
    },
    /// The record itself is bad.
    Record(Fault),
}

impl<E> Error<E> {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Flash(_) => "flash_error",
            Self::NotKept { .. } => "flash_not_kept",
            Self::Geometry(_) => "flash_unsuitable",
            Self::NotAJournal => "not_a_journal",
            Self::Version { .. } => "journal_version",
            Self::OtherGeometry { .. } => "journal_geometry",
            Self::PayloadTooLong { .. } => "payload_too_long",
            Self::BufferTooSmall { .. } => "buffer_too_small",
            Self::OutOfRange { .. } => "out_of_range",
            Self::Record(fault) => fault.code(),
        }
    }
}

impl<E: fmt::Debug> fmt::Display for Error<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flash(error) => write!(
                f,
                "the flash reports {error:?}: the entry is not recorded; try again, \
                 and replace the board if it stays"
            ),
            Self::NotKept { addr } => write!(
                f,
                "the flash does not keep what is written (at {addr:#x} of the journal): \
                 it is worn out or failing, replace the board"
            ),
            Self::Geometry(fault) => {
                write!(f, "this flash region cannot hold a journal: {fault}")
            }
            Self::NotAJournal => write!(
                f,
                "the flash region holds something that is not a journal: \
                 save it if it may matter, then format the region"
            ),
            Self::Version { found } => write!(
                f,
                "the journal on this board has format version {found}: \
                 use the firmware that wrote it, or pull it and format the region"
            ),
            Self::OtherGeometry {
                sectors,
                sector_size,
                align,
            } => write!(
                f,
                "the journal on this board was laid out for {sectors} sectors of {sector_size} \
                 bytes, aligned to {align}: use the firmware that wrote it, or pull it and format \
                 the region"
            ),
            Self::PayloadTooLong { len, max } => write!(
                f,
                "a payload of {len} bytes is too long for the journal: split it, {max} fit"
            ),
            Self::BufferTooSmall { need } => {
                write!(
                    f,
                    "the buffer is too small for this entry: {need} bytes are needed"
                )
            }
            Self::OutOfRange { seq, first, next } if seq < first => write!(
                f,
                "entry {seq} is no longer on the board, the oldest is {first} (next is {next}): \
                 start at {first}"
            ),
            Self::OutOfRange { seq, first, next } => write!(
                f,
                "entry {seq} does not exist yet, the next will be {next} (oldest is {first}): \
                 ask again later"
            ),
            Self::Record(fault) => fault.fmt(f),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for Error<E> {}

impl<E> From<Fault> for Error<E> {
    fn from(fault: Fault) -> Self {
        Self::Record(fault)
    }
}

impl fmt::Display for GeometryFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooFewSectors => "give it two or more erase sectors",
            Self::WriteSize => "the write size must be a power of two, 1 to 256 bytes",
            Self::PageSize => {
                "the page size must be a power of two and not smaller than the write size"
            }
            Self::SectorNotWholePages => {
                "the sector size must be a multiple of the page size and of four bytes"
            }
            Self::SectorTooSmall => {
                "a sector must hold its header and an entry of 64 bytes; join sectors"
            }
            Self::TooLarge => "the region is larger than 2 GiB; give it less",
        })
    }
}

impl core::error::Error for GeometryFault {}
