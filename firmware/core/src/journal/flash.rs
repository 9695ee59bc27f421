//! What the journal needs from a NOR flash, and where it puts things on it.

use super::entry::{MAX_PAYLOAD, OVERHEAD};
use super::error::GeometryFault;
use super::sector::HEADER_SIZE;

/// The value of a byte that was erased and not programmed since.
pub const ERASED: u8 = 0xFF;

/// A NOR flash region: erasing sets a sector to 0xFF, programming clears bits.
///
/// Addresses count from the start of the region. The journal keeps these
/// promises, which flash with error correction needs (STM32H7, L4, G4):
/// programs are aligned to `write_size` in address and length, their buffer is
/// aligned to four bytes, they never cross a sector end, and a word that was
/// programmed is not programmed again before its sector is erased.
///
/// In return a driver returns from `program` and `erase` only when the flash
/// has finished, and `read` must deliver *some* bytes for a word that its error
/// correction refuses (zeros will do): such a word is what a power cut leaves,
/// and the journal recognises it by its own check. `Err` is for a device that
/// does not answer.
///
/// # Example
///
/// A region in RAM, and a journal on it over a power cycle:
///
/// ```
/// use umi_core::journal::{ERASED, Flash, Geometry, Journal, MAX_PAYLOAD};
/// use umi_core::units::Micros;
///
/// struct Ram([u8; 4 * 4096]);
///
/// impl Flash for Ram {
///     type Error = core::convert::Infallible;
///
///     fn geometry(&self) -> Geometry {
///         Geometry { sectors: 4, sector_size: 4096, write_size: 1, page_size: 1 }
///     }
///     fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
///         into.copy_from_slice(&self.0[addr as usize..][..into.len()]);
///         Ok(())
///     }
///     fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error> {
///         self.0[addr as usize..][..bytes.len()].copy_from_slice(bytes);
///         Ok(())
///     }
///     fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
///         self.0[sector as usize * 4096..][..4096].fill(ERASED);
///         Ok(())
///     }
/// }
///
/// let (mut journal, recovery) = Journal::open(Ram([ERASED; 4 * 4096]))?;
/// assert!(recovery.fresh);
/// assert_eq!(journal.append(1, Micros(20), b"X-12.3450")?, 0);
///
/// let (mut journal, recovery) = Journal::open(journal.into_flash())?;
/// assert!(recovery.is_clean());
/// let mut payload = [0; MAX_PAYLOAD];
/// assert_eq!(journal.read(0, &mut payload)?.entry.payload, b"X-12.3450");
/// journal.verify(journal.first_seq(), journal.next_seq())?;
/// # Ok::<(), umi_core::journal::Error<core::convert::Infallible>>(())
/// ```
pub trait Flash {
    /// What the driver reports when the device does not answer.
    type Error: core::fmt::Debug;

    /// The shape of the region. It must not change while a journal is open.
    fn geometry(&self) -> Geometry;

    /// Reads `into.len()` bytes from `addr`, at any alignment.
    ///
    /// # Errors
    /// The device does not answer.
    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error>;

    /// Programs `bytes` at `addr`, from low addresses to high.
    ///
    /// # Errors
    /// The device does not answer or reports that programming failed.
    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error>;

    /// Erases the sector with this index (0 is the first of the region).
    ///
    /// # Errors
    /// The device does not answer or reports that erasing failed.
    fn erase(&mut self, sector: u32) -> Result<(), Self::Error>;
}

impl<F: Flash> Flash for &mut F {
    type Error = F::Error;

    fn geometry(&self) -> Geometry {
        (**self).geometry()
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        (**self).read(addr, into)
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        (**self).program(addr, bytes)
    }

    fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
        (**self).erase(sector)
    }
}

/// The shape of a flash region. All sizes are bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// How many erase sectors the region has; at least two.
    pub sectors: u16,
    /// Size of one erase sector in bytes.
    pub sector_size: u32,
    /// Smallest unit that can be programmed, in bytes: 1 (serial NOR) to 32
    /// (STM32H7); a power of two up to 256.
    pub write_size: u32,
    /// How many bytes the device programs at the same moment: 256 for the page
    /// of a serial NOR, `write_size` for most on-chip flash. A power cut can
    /// leave any part of such a page half programmed.
    pub page_size: u32,
}

/// The largest `write_size`, and the most that one program writes.
pub(crate) const LARGEST_WRITE: usize = 256;

/// Far above any board, and no sum of addresses overflows.
const LARGEST_REGION: u64 = 1 << 31;

/// A payload that must fit in a sector, so that a journal is of any use.
const LEAST_PAYLOAD: u32 = 64;

/// Where things are: derived once from the geometry, which it has checked.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
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
