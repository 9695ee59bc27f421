//! The journal as a file or stream, `.umij`: a header and then the entries just
//! as they were appended, without the padding of the flash.
//!
//! ```text
//! offset  size  field (little endian)
//!      0     4  magic "UMIJ"
//!      4     1  format version, 1
//!      5     3  zero
//!      8     8  seq of the first entry in this file
//!     16    32  chain value before that entry
//!     48     4  CRC-32 of everything before it
//!     52        entries, one behind the other
//! ```
//!
//! A file that was cut between two entries is a shorter, valid file: compare
//! [`EntryIter::next_seq`] and [`EntryIter::chain_head`] at its end with what the
//! board said.

use core::fmt;

use super::chain::Chain;
use super::entry::{Entry, Found, NoEntry, Source, chain_over, probe};
use super::error::JournalFault;
use super::layout::OVERHEAD;
use super::sector::{VERSION, put, seal, take, unseal};

/// Size of an encoded [`FileHeader`].
pub const FILE_HEADER_SIZE: usize = 52;

const MAGIC: [u8; 4] = *b"UMIJ";

/// What a `.umij` file starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileHeader {
    /// Number of the first entry in the file.
    pub first_seq: u64,
    /// Chain value before that entry.
    pub chain_before: Chain,
}

impl FileHeader {
    /// The header as bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; FILE_HEADER_SIZE] {
        let mut bytes = [0; FILE_HEADER_SIZE];
        let mut rest = bytes.as_mut_slice();
        put(&mut rest, &MAGIC);
        put(&mut rest, &[VERSION, 0, 0, 0]);
        put(&mut rest, &self.first_seq.to_le_bytes());
        put(&mut rest, &self.chain_before.0);
        seal(&mut bytes);
        bytes
    }

    /// Reads a header.
    ///
    /// # Errors
    /// [`FileError::NotAJournal`], [`FileError::Version`],
    /// [`FileError::HeaderDamaged`].
    pub fn decode(bytes: &[u8]) -> Result<Self, FileError> {
        if !bytes.starts_with(&MAGIC) {
            return Err(FileError::NotAJournal);
        }
        let header: &[u8; FILE_HEADER_SIZE] =
            bytes.first_chunk().ok_or(FileError::HeaderDamaged)?;
        let mut rest = unseal(header).ok_or(FileError::HeaderDamaged)?;
        Self::fields(&mut rest).unwrap_or(Err(FileError::HeaderDamaged))
    }

    fn fields(rest: &mut &[u8]) -> Option<Result<Self, FileError>> {
        let [_, _, _, _, found, _, _, _] = take(rest)?;
        if found != VERSION {
            return Some(Err(FileError::Version { found }));
        }
        let first_seq = u64::from_le_bytes(take(rest)?);
        Some(Ok(Self {
            first_seq,
            chain_before: Chain(take(rest)?),
        }))
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
    let header = FileHeader::decode(bytes)?;
    let (_, entries) = bytes.split_at_checked(FILE_HEADER_SIZE).unwrap_or_default();
    Ok((
        header,
        EntryIter::new(entries, header.first_seq, header.chain_before),
    ))
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
        let result = self.decode();
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
                    "this journal file has format version {found}, this tool reads 1"
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
