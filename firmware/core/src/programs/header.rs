//! The header of a stored program, in its first sector.
//!
//! ```text
//! offset      size   what
//! 0              a   mark: anything but erased says that the program is none any more
//! a             64   header, see below
//! +64, aligned   a   mark: anything but erased says that the program is complete
//! +a             a   mark as the first
//! next 256           the program's bytes, on into the following sectors
//! ```
//!
//! `a` is the alignment, `write_size` and at least 4. Two marks enclose the header: an
//! erase that a power cut stops may clear either, but not both and leave the header.
//!
//! ```text
//! offset  size  field of the header (little endian)
//!      0     4  magic "UMP" A7
//!      4     1  format version, 1
//!      5     1  log2 of the alignment
//!      6     2  the sector that it stands in
//!      8     4  size of a sector
//!     12     1  length of the name
//!     13     1  release: 0 after a verdict, 1 rewritten, 2 always, 3 never
//!     14     2  how long the control may hold the line, seconds; 0 is 5
//!     16     4  number
//!     20     4  bytes
//!     24     4  CRC-32 of these bytes
//!     28     4  generation: later ones are larger
//!     32    16  name
//!     48     1  of a rewritten one: decimals of a length in mm
//!     49     1  integers: 0 refused, 1 units, 2 increments
//!     50     1  unit: 0 said, 1 mm, 2 inch
//!     51     1  dialect: 0 not said, 1 Fanuc, 2 LinuxCNC
//!     52     2  chord, micrometres
//!     54     2  clearance, micrometres
//!     56     2  modes to begin with, as `StartModes::packed`; 0 none
//!     58     2  a program that it may call; 0 none
//!     60     4  CRC-32 of everything before it
//! ```

use umi_protocol::job::Name;
use umi_protocol::program::{
    IntegerRule, ProgramInfo, Release, RewriteSpec, Stated, StatedDialect, UnitRule,
};

use crate::journal::format::sector::{put, seal, take, unseal};
use crate::journal::{Geometry, GeometryFault};

/// Size of a header.
pub(super) const SIZE: usize = 64;
/// Bytes of one program of the flash, and what the first byte of a program is aligned to.
pub(super) const PAGE: u32 = 256;

/// Of a header that does not say: see [`ProgramInfo::hold_s`].
pub(super) const DEFAULT_HOLD_S: u16 = 5;

const MAGIC: [u8; 4] = *b"UMP\xA7";
const VERSION: u8 = 1;

/// Where things are: derived once from the geometry, which it has checked.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub sectors: u32,
    pub sector_size: u32,
    pub align: u32,
}

impl Layout {
    pub fn new(geometry: Geometry) -> Result<Self, GeometryFault> {
        let Geometry {
            sectors,
            sector_size,
            write_size,
            page_size: _,
        } = geometry;
        if sectors < 2 {
            return Err(GeometryFault::TooFewSectors);
        }
        if !write_size.is_power_of_two() || write_size > PAGE {
            return Err(GeometryFault::WriteSize);
        }
        let layout = Self {
            sectors: sectors.into(),
            sector_size,
            align: write_size.max(4),
        };
        if !sector_size.is_multiple_of(PAGE) {
            return Err(GeometryFault::SectorNotWholePages);
        }
        if u64::from(sectors) * u64::from(sector_size) > 1 << 31 {
            return Err(GeometryFault::TooLarge);
        }
        if sector_size <= layout.data() {
            return Err(GeometryFault::SectorTooSmall);
        }
        Ok(layout)
    }

    /// Offset of the header.
    pub const fn header(&self) -> u32 {
        self.align
    }

    /// Offset of the mark of a complete program.
    pub const fn complete(&self) -> u32 {
        self.align + (SIZE as u32).next_multiple_of(self.align)
    }

    /// Offsets of the two marks of what is no program any more.
    pub const fn void(&self) -> [u32; 2] {
        [0, self.complete() + self.align]
    }

    /// Offset of the first byte of a program.
    pub const fn data(&self) -> u32 {
        (self.complete() + 2 * self.align).next_multiple_of(PAGE)
    }

    /// Where a sector begins.
    pub const fn start(&self, sector: u32) -> u32 {
        sector * self.sector_size
    }

    /// The sectors that a program of so many bytes takes.
    pub fn sectors_for(&self, bytes: u32) -> u32 {
        let all = u64::from(self.data()) + u64::from(bytes);
        // A u32 divided by 512 at least.
        all.div_ceil(self.sector_size.into()) as u32
    }

    /// The longest program in so many sectors.
    pub fn capacity(&self, sectors: u32) -> u32 {
        (sectors * self.sector_size).saturating_sub(self.data())
    }
}

/// What a header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub program: ProgramInfo,
    pub generation: u32,
}

impl Header {
    pub fn encode(&self, layout: &Layout, sector: u32) -> [u8; SIZE] {
        let ProgramInfo {
            number,
            name,
            bytes,
            crc32,
            release,
            hold_s,
            stated,
        } = &self.program;
        let mut header = [0; SIZE];
        let mut rest = header.as_mut_slice();
        put(&mut rest, &MAGIC);
        put(&mut rest, &[VERSION, layout.align.trailing_zeros() as u8]);
        put(&mut rest, &(sector as u16).to_le_bytes());
        put(&mut rest, &layout.sector_size.to_le_bytes());
        let (kind, how, lengths) = release_bytes(*release);
        put(&mut rest, &[name.len() as u8, kind]);
        put(&mut rest, &hold_s.to_le_bytes());
        put(&mut rest, &number.to_le_bytes());
        put(&mut rest, &bytes.to_le_bytes());
        put(&mut rest, &crc32.to_le_bytes());
        put(&mut rest, &self.generation.to_le_bytes());
        let mut padded = [0; 16];
        for (slot, byte) in padded.iter_mut().zip(name.bytes()) {
            *slot = byte;
        }
        put(&mut rest, &padded);
        put(&mut rest, &how);
        let dialect = match stated.dialect {
            StatedDialect::NotSaid => 0,
            StatedDialect::Fanuc => 1,
            StatedDialect::LinuxCnc => 2,
        };
        put(&mut rest, &[dialect]);
        put(&mut rest, &lengths);
        put(&mut rest, &stated.start_packed.to_le_bytes());
        put(&mut rest, &stated.allow_call.to_le_bytes());
        seal(&mut header);
        header
    }

    /// What stands there, if it is a header of this layout in this sector.
    pub fn decode(header: &[u8; SIZE], layout: &Layout, sector: u32) -> Option<Self> {
        let mut rest = unseal(header)?;
        let ours = take(&mut rest)? == MAGIC
            && take(&mut rest)? == [VERSION, layout.align.trailing_zeros() as u8]
            && take(&mut rest)? == (sector as u16).to_le_bytes()
            && take(&mut rest)? == layout.sector_size.to_le_bytes();
        if !ours {
            return None;
        }
        let [name_len, kind] = take(&mut rest)?;
        let hold_s = u16::from_le_bytes(take(&mut rest)?);
        let number = u32::from_le_bytes(take(&mut rest)?);
        let bytes = u32::from_le_bytes(take(&mut rest)?);
        let crc32 = u32::from_le_bytes(take(&mut rest)?);
        let generation = u32::from_le_bytes(take(&mut rest)?);
        let padded: [u8; 16] = take(&mut rest)?;
        let how = take(&mut rest)?;
        let [dialect] = take(&mut rest)?;
        let release = release(kind, how, take(&mut rest)?)?;
        let stated = Stated {
            start_packed: u16::from_le_bytes(take(&mut rest)?),
            dialect: match dialect {
                0 => StatedDialect::NotSaid,
                1 => StatedDialect::Fanuc,
                2 => StatedDialect::LinuxCnc,
                _ => return None,
            },
            allow_call: u16::from_le_bytes(take(&mut rest)?),
        };
        let text = padded.get(..usize::from(name_len))?;
        let name = Name::try_from(core::str::from_utf8(text).ok()?).ok()?;
        let fits = sector + layout.sectors_for(bytes) <= layout.sectors;
        fits.then_some(Self {
            program: ProgramInfo {
                number,
                name,
                bytes,
                crc32,
                release,
                hold_s: if hold_s == 0 { DEFAULT_HOLD_S } else { hold_s },
                stated,
            },
            generation,
        })
    }
}

/// The kind of release, and of a rewritten one decimals, integers and unit, then lengths.
fn release_bytes(release: Release) -> (u8, [u8; 3], [u8; 4]) {
    let kind = match release {
        Release::AfterVerdict => 0,
        Release::Rewritten(_) => 1,
        Release::Always => 2,
        Release::Never => 3,
    };
    let Release::Rewritten(spec) = release else {
        return (kind, [0; 3], [0; 4]);
    };
    let integers = match spec.integers {
        IntegerRule::Refused => 0,
        IntegerRule::Units => 1,
        IntegerRule::Increments => 2,
    };
    let unit = match spec.unit {
        UnitRule::Said => 0,
        UnitRule::Mm => 1,
        UnitRule::Inch => 2,
    };
    let [c0, c1] = spec.chord_um.to_le_bytes();
    let [d0, d1] = spec.clearance_um.to_le_bytes();
    (kind, [spec.decimals_mm, integers, unit], [c0, c1, d0, d1])
}

fn release(kind: u8, how: [u8; 3], lengths: [u8; 4]) -> Option<Release> {
    let ([decimals_mm, integers, unit], [c0, c1, d0, d1]) = (how, lengths);
    Some(match kind {
        0 => Release::AfterVerdict,
        1 => Release::Rewritten(RewriteSpec {
            decimals_mm,
            chord_um: u16::from_le_bytes([c0, c1]),
            clearance_um: u16::from_le_bytes([d0, d1]),
            integers: match integers {
                0 => IntegerRule::Refused,
                1 => IntegerRule::Units,
                2 => IntegerRule::Increments,
                _ => return None,
            },
            unit: match unit {
                0 => UnitRule::Said,
                1 => UnitRule::Mm,
                2 => UnitRule::Inch,
                _ => return None,
            },
        }),
        2 => Release::Always,
        3 => Release::Never,
        _ => return None,
    })
}
