//! The header of a sector, which lets a reader start there.
//!
//! ```text
//! offset  size  field (little endian)
//!      0     4  magic "UMJS"
//!      4     1  format version, 1
//!      5     1  log2 of the entry alignment in bytes
//!      6     2  sectors in the region
//!      8     4  size of a sector in bytes
//!     12     8  generation: 1 for the first sector ever written, then +1 each
//!     20     8  seq of the first entry in this sector
//!     28    32  chain value before that entry
//!     60     4  CRC-32 of everything before it
//! ```
//!
//! Behind it, at the next multiple of the alignment, stands one mark of one
//! alignment unit: anything but erased says that the *following* sector has been
//! given up and may be half erased. Entries start behind the mark.

use super::chain::{CRC32, Chain};
use super::layout::{HEADER_SIZE, Layout};

/// Version of everything on flash and in files that this code writes.
pub(in crate::journal) const VERSION: u8 = 1;

const MAGIC: [u8; 4] = *b"UMJS";

/// What a sector says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::journal) struct Header {
    pub generation: u64,
    pub first_seq: u64,
    pub chain: Chain,
}

/// What is found where a header should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::journal) enum HeaderRead {
    Valid(Header),
    /// A sound header of another format version.
    OtherVersion(u8),
    /// A sound header of a region with another shape.
    OtherGeometry {
        sectors: u16,
        sector_size: u32,
        align: u32,
    },
    /// No header: erased, torn, damaged or something else.
    None,
}

impl Header {
    pub fn encode(&self, layout: &Layout) -> [u8; HEADER_SIZE] {
        let mut bytes = [0; HEADER_SIZE];
        let mut rest = bytes.as_mut_slice();
        put(&mut rest, &MAGIC);
        put(&mut rest, &[VERSION, layout.align.trailing_zeros() as u8]);
        put(&mut rest, &(layout.sectors as u16).to_le_bytes());
        put(&mut rest, &layout.sector_size.to_le_bytes());
        put(&mut rest, &self.generation.to_le_bytes());
        put(&mut rest, &self.first_seq.to_le_bytes());
        put(&mut rest, &self.chain.0);
        seal(&mut bytes);
        bytes
    }

    pub fn decode(bytes: &[u8; HEADER_SIZE], layout: &Layout) -> HeaderRead {
        Self::decode_sound(bytes, layout).unwrap_or(HeaderRead::None)
    }

    fn decode_sound(bytes: &[u8; HEADER_SIZE], layout: &Layout) -> Option<HeaderRead> {
        let mut rest = unseal(bytes)?;
        if take(&mut rest)? != MAGIC {
            return None;
        }
        let [version, align_log2] = take(&mut rest)?;
        if version != VERSION {
            return Some(HeaderRead::OtherVersion(version));
        }
        let sectors = u16::from_le_bytes(take(&mut rest)?);
        let sector_size = u32::from_le_bytes(take(&mut rest)?);
        let align = 1u32.checked_shl(u32::from(align_log2)).unwrap_or(0);
        let same = u32::from(sectors) == layout.sectors
            && sector_size == layout.sector_size
            && align == layout.align;
        if !same {
            return Some(HeaderRead::OtherGeometry {
                sectors,
                sector_size,
                align,
            });
        }
        Some(HeaderRead::Valid(Self {
            generation: u64::from_le_bytes(take(&mut rest)?),
            first_seq: u64::from_le_bytes(take(&mut rest)?),
            chain: Chain(take(&mut rest)?),
        }))
    }
}

/// Writes `field` at the start of `rest` and moves on behind it.
pub(crate) fn put(rest: &mut &mut [u8], field: &[u8]) {
    if let Some((place, behind)) = core::mem::take(rest).split_at_mut_checked(field.len()) {
        place.copy_from_slice(field);
        *rest = behind;
    }
}

/// Takes a field of `N` bytes from the start of `rest`.
pub(crate) fn take<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (field, behind) = rest.split_first_chunk()?;
    *rest = behind;
    Some(*field)
}

/// Puts the CRC of what is before them into the last four bytes.
pub(crate) fn seal<const N: usize>(bytes: &mut [u8; N]) {
    if let Some((content, crc)) = bytes.split_last_chunk_mut::<4>() {
        *crc = CRC32.checksum(content).to_le_bytes();
    }
}

/// The bytes before the CRC, if it is right.
pub(crate) fn unseal<const N: usize>(bytes: &[u8; N]) -> Option<&[u8]> {
    let (content, crc) = bytes.split_last_chunk::<4>()?;
    (CRC32.checksum(content) == u32::from_le_bytes(*crc)).then_some(content)
}
