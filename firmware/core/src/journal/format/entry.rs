//! One entry as bytes. There is one encoder and one decoder, for flash and files.
//!
//! ```text
//! offset  size  field (little endian)
//!      0     1  marker 0xA5
//!      1     1  kind
//!      2     2  n, length of the payload, 0..=8192
//!      4     8  seq
//!     12     8  t_us
//!     20     n  payload
//!   20+n     8  first bytes of the chain value that includes this entry
//!   28+n     4  CRC-32 of everything before it
//! ```
//!
//! The marker is neither the erased value nor ASCII, so a search finds few false
//! starts in text. The limit of n keeps the cost of a false start small. The CRC
//! is last, so an entry that was cut fails it.

use super::chain::{CRC32, Chain, Link, TAG_SIZE};
use super::layout::{FIELDS, MAX_PAYLOAD, OVERHEAD};
use crate::journal::flash::Flash;
use crate::units::Micros;

/// Longest payload of the format, in bytes. It does not follow the records, so
/// that a journal stays readable when they become shorter.
const LONGEST: u16 = 8192;

const _: () = assert!(MAX_PAYLOAD <= LONGEST as usize);

/// First byte of every entry.
pub(in crate::journal) const MARKER: u8 = 0xA5;

/// One record of the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry<'a> {
    /// Number of the entry: 0 for the first of the board's life, then without gaps.
    pub seq: u64,
    /// When it happened, on the board's clock of that power cycle.
    pub t: Micros,
    /// What the payload is; the journal does not look at it.
    pub kind: u8,
    /// The payload, at most [`MAX_PAYLOAD`] bytes.
    pub payload: &'a [u8],
}

impl Entry<'_> {
    /// Gives the encoded entry to `sink` in pieces, in order; returns the chain
    /// value that includes it. The caller has checked the payload's length.
    pub(in crate::journal) fn emit<E>(
        &self,
        previous: &Chain,
        mut sink: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<Chain, E> {
        let fields = Fields {
            kind: self.kind,
            len: self.payload.len() as u16,
            seq: self.seq,
            t: self.t,
        }
        .encode();
        let mut link = Link::after(previous);
        link.feed(&fields);
        link.feed(self.payload);
        let chain = link.finish();
        let tag = chain.tag();
        let mut crc = CRC32.digest();
        for piece in [&fields, self.payload, &tag] {
            crc.update(piece);
            sink(piece)?;
        }
        sink(&crc.finalize().to_le_bytes())?;
        Ok(chain)
    }
}

/// Encodes an entry around its payload of `len` bytes, which stands in `out` behind the first
/// [`FIELDS`] bytes. `entry` is its kind, time and number. Returns its length; nothing if `out` is
/// too short.
#[must_use]
pub fn encode_in_place(
    out: &mut [u8],
    (kind, t, seq): (u8, Micros, u64),
    len: usize,
    previous: &Chain,
) -> Option<usize> {
    let (entry, _) = out.split_at_mut_checked(len + OVERHEAD)?;
    let (content, trailer) = entry.split_at_mut_checked(FIELDS + len)?;
    let fields = Fields {
        kind,
        len: u16::try_from(len).ok()?,
        seq,
        t,
    };
    *content.first_chunk_mut()? = fields.encode();
    let mut link = Link::after(previous);
    link.feed(content);
    let tag = link.finish().tag();
    let mut crc = CRC32.digest();
    crc.update(content);
    crc.update(&tag);
    let (place, crc_place) = trailer.split_at_mut_checked(TAG_SIZE)?;
    place.copy_from_slice(&tag);
    crc_place.copy_from_slice(&crc.finalize().to_le_bytes());
    Some(len + OVERHEAD)
}

/// What stands before the payload.
#[derive(Clone, Copy, Debug)]
pub(in crate::journal) struct Fields {
    pub kind: u8,
    pub len: u16,
    pub seq: u64,
    pub t: Micros,
}

impl Fields {
    fn encode(&self) -> [u8; FIELDS] {
        let [l0, l1] = self.len.to_le_bytes();
        let [s0, s1, s2, s3, s4, s5, s6, s7] = self.seq.to_le_bytes();
        let [t0, t1, t2, t3, t4, t5, t6, t7] = self.t.0.to_le_bytes();
        [
            MARKER, self.kind, l0, l1, //
            s0, s1, s2, s3, s4, s5, s6, s7, //
            t0, t1, t2, t3, t4, t5, t6, t7,
        ]
    }

    /// The fields, or nothing if no entry can start like this.
    fn decode(bytes: &[u8; FIELDS]) -> Option<Self> {
        let [
            marker,
            kind,
            l0,
            l1,
            s0,
            s1,
            s2,
            s3,
            s4,
            s5,
            s6,
            s7,
            t0,
            t1,
            t2,
            t3,
            t4,
            t5,
            t6,
            t7,
        ] = *bytes;
        let len = u16::from_le_bytes([l0, l1]);
        (marker == MARKER && len <= LONGEST).then_some(Self {
            kind,
            len,
            seq: u64::from_le_bytes([s0, s1, s2, s3, s4, s5, s6, s7]),
            t: Micros(u64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7])),
        })
    }
}

/// Payload length that the first four bytes of an entry announce, if an entry
/// can start like that.
pub(in crate::journal) fn announced_len([marker, _, l0, l1]: [u8; 4]) -> Option<u16> {
    let len = u16::from_le_bytes([l0, l1]);
    (marker == MARKER && len <= LONGEST).then_some(len)
}

/// An entry whose CRC is right, at an address of its source.
#[derive(Clone, Copy, Debug)]
pub(in crate::journal) struct Found {
    pub addr: u32,
    pub fields: Fields,
    tag: [u8; TAG_SIZE],
}

impl Found {
    /// Address of the payload.
    pub fn payload_at(&self) -> u32 {
        self.addr + FIELDS as u32
    }

    /// Encoded length without padding.
    pub fn encoded_len(&self) -> usize {
        usize::from(self.fields.len) + OVERHEAD
    }
}

/// Where entries are read from: a flash or a slice.
pub(in crate::journal) trait Source {
    type Error;
    fn fetch(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error>;
}

impl<F: Flash> Source for F {
    type Error = F::Error;

    fn fetch(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        self.read(addr, into)
    }
}

/// Why there is no entry at an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::journal) enum NoEntry {
    /// The source ends before the entry would.
    CutShort,
    /// The marker, the length or the CRC is wrong.
    Damaged,
}

/// Looks for an entry at `addr`, ending at or before `limit`. Reads it once.
pub(in crate::journal) fn probe<S: Source>(
    source: &mut S,
    addr: u32,
    limit: u32,
) -> Result<Result<Found, NoEntry>, S::Error> {
    let room = limit.saturating_sub(addr) as usize;
    if room < OVERHEAD {
        return Ok(Err(NoEntry::CutShort));
    }
    let mut bytes = [0; FIELDS];
    source.fetch(addr, &mut bytes)?;
    let Some(fields) = Fields::decode(&bytes) else {
        return Ok(Err(NoEntry::Damaged));
    };
    let len = u32::from(fields.len);
    if room < usize::from(fields.len) + OVERHEAD {
        return Ok(Err(NoEntry::CutShort));
    }
    let mut crc = CRC32.digest();
    crc.update(&bytes);
    each_piece(source, addr + FIELDS as u32, len, |piece| crc.update(piece))?;
    let mut tag = [0; TAG_SIZE];
    source.fetch(addr + FIELDS as u32 + len, &mut tag)?;
    crc.update(&tag);
    let mut stored = [0; 4];
    source.fetch(addr + (FIELDS + TAG_SIZE) as u32 + len, &mut stored)?;
    if crc.finalize() == u32::from_le_bytes(stored) {
        Ok(Ok(Found { addr, fields, tag }))
    } else {
        Ok(Err(NoEntry::Damaged))
    }
}

/// The chain value that includes `found` when `previous` is the one before it,
/// or nothing if the entry does not follow that value. Reads the entry once more.
pub(in crate::journal) fn chain_over<S: Source>(
    source: &mut S,
    found: &Found,
    previous: &Chain,
) -> Result<Option<Chain>, S::Error> {
    let mut link = Link::after(previous);
    let hashed = FIELDS as u32 + u32::from(found.fields.len);
    each_piece(source, found.addr, hashed, |piece| link.feed(piece))?;
    let chain = link.finish();
    Ok((chain.tag() == found.tag).then_some(chain))
}

/// Reads `len` bytes in pieces of 64, so that no entry-sized buffer is needed.
pub(in crate::journal) fn each_piece<S: Source>(
    source: &mut S,
    mut addr: u32,
    mut len: u32,
    mut visit: impl FnMut(&[u8]),
) -> Result<(), S::Error> {
    let mut buffer = [0; 64];
    while len > 0 {
        let n = len.min(buffer.len() as u32);
        let (piece, _) = buffer.split_at_mut(n as usize);
        source.fetch(addr, piece)?;
        visit(piece);
        addr += n;
        len -= n;
    }
    Ok(())
}
