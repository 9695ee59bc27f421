//! Layout of a journal: sizes, and addresses on its flash.

use super::chain::TAG_SIZE;
use crate::journal::error::GeometryFault;
use crate::journal::flash::{Geometry, LARGEST_WRITE};

/// Longest payload that is written, in bytes: that of the longest record, and what stands before
/// it in the ring of evidence (`archive`).
pub const MAX_PAYLOAD: usize = umi_protocol::message::MAX_RECORD + 40;

/// Bytes of an entry that are not payload. In flash, padding comes on top.
pub const OVERHEAD: usize = FIELDS + TAG_SIZE + 4;

/// Bytes before the payload.
pub const FIELDS: usize = 20;

/// Size of an encoded header.
pub(in crate::journal) const HEADER_SIZE: usize = 64;

/// Far above any board, and no sum of addresses overflows.
const LARGEST_REGION: u64 = 1 << 31;

/// A payload that must fit in a sector, so that a journal is of any use.
const LEAST_PAYLOAD: u32 = 64;

/// Where things are: derived once from the geometry, which it has checked.
#[derive(Clone, Copy, Debug)]
pub(in crate::journal) struct Layout {
    pub sectors: u32,
    pub sector_size: u32,
    /// Every entry starts at a multiple of this.
    pub align: u32,
    /// `page_size`, or `align` where that is larger.
    page: u32,
    /// Offset in a sector of the mark that its successor is given up.
    mark_at: u32,
    /// Offset in a sector of its first entry.
    data_at: u32,
}

impl Layout {
    pub fn new(geometry: Geometry) -> Result<Self, GeometryFault> {
        let Geometry {
            sectors,
            sector_size,
            write_size,
            page_size,
        } = geometry;
        if sectors < 2 {
            return Err(GeometryFault::TooFewSectors);
        }
        if !write_size.is_power_of_two() || write_size > LARGEST_WRITE as u32 {
            return Err(GeometryFault::WriteSize);
        }
        if !page_size.is_power_of_two() || page_size < write_size {
            return Err(GeometryFault::PageSize);
        }
        // Four bytes at least, so that a search for entries has few places to try.
        let align = write_size.max(4);
        let page = page_size.max(align);
        if sector_size % page != 0 {
            return Err(GeometryFault::SectorNotWholePages);
        }
        if u64::from(sectors) * u64::from(sector_size) > LARGEST_REGION {
            return Err(GeometryFault::TooLarge);
        }
        let mark_at = (HEADER_SIZE as u32).next_multiple_of(align);
        let data_at = mark_at + align;
        let layout = Self {
            sectors: u32::from(sectors),
            sector_size,
            align,
            page,
            mark_at,
            data_at,
        };
        if sector_size < data_at + layout.entry_size(LEAST_PAYLOAD) {
            return Err(GeometryFault::SectorTooSmall);
        }
        Ok(layout)
    }

    /// Bytes that an entry with this payload takes in the flash.
    pub fn entry_size(&self, payload: u32) -> u32 {
        (payload + OVERHEAD as u32).next_multiple_of(self.align)
    }

    /// The longest payload that fits: [`MAX_PAYLOAD`] unless sectors are small.
    pub fn max_payload(&self) -> usize {
        MAX_PAYLOAD.min((self.sector_size - self.data_at) as usize - OVERHEAD)
    }

    pub fn next(&self, sector: u32) -> u32 {
        if sector + 1 < self.sectors {
            sector + 1
        } else {
            0
        }
    }

    pub fn previous(&self, sector: u32) -> u32 {
        if sector == 0 {
            self.sectors - 1
        } else {
            sector - 1
        }
    }

    pub fn start(&self, sector: u32) -> u32 {
        sector * self.sector_size
    }

    /// Address just behind a sector.
    pub fn end(&self, sector: u32) -> u32 {
        (sector + 1) * self.sector_size
    }

    pub fn mark(&self, sector: u32) -> u32 {
        self.start(sector) + self.mark_at
    }

    /// Address of the first entry of a sector.
    pub fn data(&self, sector: u32) -> u32 {
        self.start(sector) + self.data_at
    }

    /// Where to go on after a power cycle, when `end` is the address behind the
    /// newest entry and nothing can be seen there.
    ///
    /// A program that was cut in its first moment can leave cells that read as
    /// erased and are not. They lie in the page that holds `end`, so that page is
    /// left alone: programming it again could fail the flash's error correction,
    /// now or when the cells have aged.
    pub fn resume(&self, end: u32) -> u32 {
        (end + 1).next_multiple_of(self.page)
    }

    /// Where to go on after a power cycle, when `used` is the address behind the
    /// last byte of a torn entry that is not erased, and `announced` the end that
    /// its start tells.
    ///
    /// More of the entry may have been programmed, as 0xFF. Its first program is
    /// read back before the next, so either it went no further than that, or its
    /// start can be believed.
    pub fn resume_behind_torn(&self, used: u32, announced: u32) -> u32 {
        self.resume(announced.max(used + LARGEST_WRITE as u32))
    }
}
