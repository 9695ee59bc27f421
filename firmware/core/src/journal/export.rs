//! The journal as a file or stream, `.umij`: a header and then the entries just
//! as they were appended, without the padding of the flash.
//!
//! ```text
//! offset  size  field (little endian)
//!      0     4  magic "UMIJ"
//!      4     1  format version, 2
//!      5     3  zero
//!      8     8  seq of the first entry in this file
//!     16    32  chain value before that entry
//!     48    32  nonce of the head that ends it; zeros: none was asked for
//!     80     4  CRC-32 of everything before it
//!     84        entries, one behind the other
//! ```
//!
//! Between two entries a gap may stand, for entries that the board's ring had overwritten before
//! they were read:
//!
//! ```text
//! offset  size  field (little endian)
//!      0     1  marker 0x5A
//!      1     3  zero
//!      4     8  seq of the first entry that is not there
//!     12     8  seq of the entry behind the gap
//!     20    32  chain value before that entry
//!     52     4  CRC-32 of everything before it
//! ```
//!
//! Version 1 has neither nonce nor gaps: its header ends with the CRC-32 at offset 48, and its
//! entries stand at 52. It is read for ever.
//!
//! A file that was cut between two entries is a shorter, valid file. What tells is a head
//! ([`umi_protocol::head`]): the board's signature over everything before it.

use core::fmt;

use super::error::JournalFault;
use super::format::chain::Chain;
use super::format::entry::{Entry, Found, NoEntry, Source, chain_over, probe};
use super::format::layout::OVERHEAD;
use super::format::sector::{put, seal, take, unseal};

/// Size of an encoded [`FileHeader`].
pub const FILE_HEADER_SIZE: usize = 84;

/// Size of the header of version 1.
pub const FILE_HEADER_SIZE_1: usize = 52;

/// Size of an encoded [`Gap`].
pub const GAP_SIZE: usize = 56;

/// The version that is written.
pub const FILE_VERSION: u8 = 2;

const MAGIC: [u8; 4] = *b"UMIJ";

/// First byte of a gap.
const GAP_MARKER: u8 = 0x5A;

/// What a `.umij` file starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileHeader {
    /// Number of the first entry in the file.
    pub first_seq: u64,
    /// Chain value before that entry.
    pub chain_before: Chain,
    /// Nonce of the head that ends the file; none: none was asked for.
    pub nonce: Option<[u8; 32]>,
}

impl FileHeader {
    /// The header as bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; FILE_HEADER_SIZE] {
        let mut bytes = [0; FILE_HEADER_SIZE];
        let mut rest = bytes.as_mut_slice();
        put(&mut rest, &MAGIC);
        put(&mut rest, &[FILE_VERSION, 0, 0, 0]);
        put(&mut rest, &self.first_seq.to_le_bytes());
        put(&mut rest, &self.chain_before.0);
        put(&mut rest, &self.nonce.unwrap_or_default());
        seal(&mut bytes);
        bytes
    }

    /// Reads a header of any version, and says how many bytes it takes.
    ///
    /// # Errors
    /// [`FileError::NotAJournal`], [`FileError::Version`],
    /// [`FileError::HeaderDamaged`].
    pub fn decode(bytes: &[u8]) -> Result<(Self, usize), FileError> {
        if !bytes.starts_with(&MAGIC) {
            // Cut within its first bytes, or emptied, it is damaged as one that is cut behind them.
            return Err(match MAGIC.starts_with(bytes) {
                true => FileError::HeaderDamaged,
                false => FileError::NotAJournal,
            });
        }
        // The version is believed only where the check value of its own header is right.
        match (
            whole::<FILE_HEADER_SIZE_1>(bytes),
            whole::<FILE_HEADER_SIZE>(bytes),
        ) {
            (Some((1, header)), _) => Ok((header, FILE_HEADER_SIZE_1)),
            (_, Some((FILE_VERSION, header))) => Ok((header, FILE_HEADER_SIZE)),
            (Some((found, _)), _) | (_, Some((found, _))) => Err(FileError::Version { found }),
            (None, None) => Err(FileError::HeaderDamaged),
        }
    }

    /// The header of a file whose first bytes are not those of a journal, and all others are.
    #[must_use]
    pub fn lost_its_magic(bytes: &[u8]) -> bool {
        let mut repaired = [0; FILE_HEADER_SIZE];
        let length = bytes.len().min(FILE_HEADER_SIZE);
        let (place, _) = repaired.split_at_mut(length);
        let (start, _) = bytes.split_at(length);
        place.copy_from_slice(start);
        for (place, byte) in repaired.iter_mut().zip(MAGIC) {
            *place = byte;
        }
        let (repaired, _) = repaired.split_at(length);
        !bytes.starts_with(&MAGIC) && Self::decode(repaired).is_ok()
    }
}

/// A header of `N` bytes with its version, if its check value is right.
fn whole<const N: usize>(bytes: &[u8]) -> Option<(u8, FileHeader)> {
    let header: &[u8; N] = bytes.first_chunk()?;
    let mut rest = unseal(header)?;
    let [_, _, _, _, version, _, _, _] = take(&mut rest)?;
    let first_seq = u64::from_le_bytes(take(&mut rest)?);
    let chain_before = Chain(take(&mut rest)?);
    let nonce = take::<32>(&mut rest).filter(|nonce| *nonce != [0; 32]);
    let header = FileHeader {
        first_seq,
        chain_before,
        nonce,
    };
    Some((version, header))
}

/// Entries that the board had overwritten before they were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// The first that is not there.
    pub first: u64,
    /// The entry behind them.
    pub next: u64,
    /// Chain value before that entry.
    pub chain_before: Chain,
}

impl Gap {
    /// The gap as bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; GAP_SIZE] {
        let mut bytes = [0; GAP_SIZE];
        let mut rest = bytes.as_mut_slice();
        put(&mut rest, &[GAP_MARKER, 0, 0, 0]);
        put(&mut rest, &self.first.to_le_bytes());
        put(&mut rest, &self.next.to_le_bytes());
        put(&mut rest, &self.chain_before.0);
        seal(&mut bytes);
        bytes
    }

    fn decode(bytes: &[u8; GAP_SIZE]) -> Option<Self> {
        let mut rest = unseal(bytes)?;
        let [marker, a, b, c] = take(&mut rest)?;
        let gap = Self {
            first: u64::from_le_bytes(take(&mut rest)?),
            next: u64::from_le_bytes(take(&mut rest)?),
            chain_before: Chain(take(&mut rest)?),
        };
        ([marker, a, b, c] == [GAP_MARKER, 0, 0, 0] && gap.first < gap.next).then_some(gap)
    }
}

/// Encodes `entry` to the start of `out` and moves `chain` on to include it.
/// Returns the length, or nothing if `out` has not payload plus [`OVERHEAD`]
/// bytes or the payload is longer than [`MAX_PAYLOAD`].
///
/// [`MAX_PAYLOAD`]: super::MAX_PAYLOAD
#[must_use]
pub fn encode_entry(entry: &Entry<'_>, chain: &mut Chain, out: &mut [u8]) -> Option<usize> {
    let len = entry.payload.len() + OVERHEAD;
    if entry.payload.len() > super::MAX_PAYLOAD || out.len() < len {
        return None;
    }
    let mut rest = out;
    let next = entry.emit(chain, |piece| {
        put(&mut rest, piece);
        Ok::<(), core::convert::Infallible>(())
    });
    let Ok(next) = next;
    *chain = next;
    Some(len)
}

/// Opens a `.umij` file: its header, and its entries from the first on.
///
/// # Errors
/// As [`FileHeader::decode`]; the entries report their own faults.
pub fn decode_file(bytes: &[u8]) -> Result<(FileHeader, EntryIter<'_>), FileError> {
    let (header, size) = FileHeader::decode(bytes)?;
    let (_, entries) = bytes.split_at_checked(size).unwrap_or_default();
    let mut entries = EntryIter::new(entries, header.first_seq, header.chain_before);
    entries.has_gaps = size == FILE_HEADER_SIZE;
    Ok((header, entries))
}

/// The entries in a slice, each checked: number, CRC and chain. Ends behind the
/// first fault, since nothing after it can be proven.
#[derive(Clone, Debug)]
pub struct EntryIter<'a> {
    bytes: &'a [u8],
    offset: usize,
    next_seq: u64,
    chain: Chain,
    failed: bool,
    /// Gaps may stand between entries.
    has_gaps: bool,
    gap: Option<Gap>,
}

impl<'a> EntryIter<'a> {
    /// Reads `bytes` as entries from `first_seq` on, where `chain_before` is the
    /// chain value before the first.
    #[must_use]
    pub fn new(bytes: &'a [u8], first_seq: u64, chain_before: Chain) -> Self {
        Self {
            bytes,
            offset: 0,
            next_seq: first_seq,
            chain: chain_before,
            failed: false,
            has_gaps: false,
            gap: None,
        }
    }

    /// The number after the last good entry.
    #[must_use]
    pub fn next_seq(&self) -> u64 {
        self.next_seq
    }

    /// The chain value that includes the last good entry.
    #[must_use]
    pub fn chain_head(&self) -> Chain {
        self.chain
    }

    /// How many bytes the good entries take. A stream goes on from here when a
    /// [`JournalFault::CutShort`] was only the end of what has arrived so far.
    #[must_use]
    pub fn offset(&self) -> usize {
        self.offset
    }

    /// The gap that stood before the latest entry, or at the end; once.
    pub fn take_gap(&mut self) -> Option<Gap> {
        self.gap.take()
    }

    /// Passes a gap, if one stands here.
    fn pass_gap(&mut self) -> Result<(), JournalFault> {
        let rest = self.bytes.get(self.offset..).unwrap_or_default();
        self.gap = None;
        if !self.has_gaps || rest.first() != Some(&GAP_MARKER) {
            return Ok(());
        }
        let seq = self.next_seq;
        let bytes = rest.first_chunk().ok_or(JournalFault::CutShort { seq })?;
        let gap = Gap::decode(bytes).filter(|gap| gap.first == seq);
        let gap = gap.ok_or(JournalFault::Damaged { seq })?;
        self.gap = Some(gap);
        self.next_seq = gap.next;
        self.chain = gap.chain_before;
        self.offset += GAP_SIZE;
        Ok(())
    }

    fn decode(&mut self) -> Result<Entry<'a>, JournalFault> {
        let seq = self.next_seq;
        let (_, rest) = self.bytes.split_at_checked(self.offset).unwrap_or_default();
        let limit = u32::try_from(rest.len()).unwrap_or(u32::MAX);
        let Ok(probed) = probe(&mut SliceSource(rest), 0, limit);
        let found = probed.map_err(|reason| match reason {
            NoEntry::CutShort => JournalFault::CutShort { seq },
            NoEntry::Damaged => JournalFault::Damaged { seq },
        })?;
        let Found { fields, .. } = found;
        if fields.seq > seq {
            return Err(JournalFault::Missing {
                first: seq,
                next: fields.seq,
            });
        }
        let Ok(chain) = chain_over(&mut SliceSource(rest), &found, &self.chain);
        let chain = chain
            .filter(|_| fields.seq == seq)
            .ok_or(JournalFault::ChainBroken { seq })?;
        let payload = rest
            .get(found.payload_at() as usize..)
            .and_then(|from| from.get(..usize::from(fields.len)))
            .ok_or(JournalFault::CutShort { seq })?;
        self.chain = chain;
        self.next_seq = seq.saturating_add(1);
        self.offset += found.encoded_len();
        Ok(Entry {
            seq,
            t: fields.t,
            kind: fields.kind,
            payload,
        })
    }
}

impl<'a> Iterator for EntryIter<'a> {
    type Item = Result<Entry<'a>, JournalFault>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed || self.offset == self.bytes.len() {
            return None;
        }
        let passed = self.pass_gap();
        if passed.is_ok() && self.offset == self.bytes.len() {
            return None;
        }
        let result = passed.and_then(|()| self.decode());
        self.failed = result.is_err();
        Some(result)
    }
}

impl core::iter::FusedIterator for EntryIter<'_> {}

/// A slice to read entries from; what lies outside of it reads as zeros, and the
/// decoder never asks for it.
struct SliceSource<'a>(&'a [u8]);

impl Source for SliceSource<'_> {
    type Error = core::convert::Infallible;

    fn fetch(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        let from = self.0.get(addr as usize..).unwrap_or_default();
        match from.split_at_checked(into.len()) {
            Some((bytes, _)) => into.copy_from_slice(bytes),
            None => into.fill(0),
        }
        Ok(())
    }
}

/// Why a file is not read as a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileError {
    /// It does not start as a `.umij` file does.
    NotAJournal,
    /// It has another format version.
    Version {
        /// The version found.
        found: u8,
    },
    /// Its header is cut short or damaged.
    HeaderDamaged,
}

impl FileError {
    /// A stable name for machines.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotAJournal => "not_a_journal",
            Self::Version { .. } => "journal_version",
            Self::HeaderDamaged => "journal_header_damaged",
        }
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotAJournal => {
                f.write_str("this is not a journal file: give one that `umi log` wrote (.umij)")
            }
            Self::Version { found } => {
                write!(
                    f,
                    "this journal file has format version {found}, this tool reads 1 and 2"
                )?;
                f.write_str(": update umi")
            }
            Self::HeaderDamaged => f.write_str(
                "the header of this journal file is damaged: pull the journal from the board again",
            ),
        }
    }
}

impl core::error::Error for FileError {}
