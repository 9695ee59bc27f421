//! Parts of the flash that the code runs from: the board's own key, and the images of a boot loader.
//!
//! # Design
//!
//! ```text
//! 1000 0000   64 KB  boot loader; its last 32 bytes: the key of who makes images
//! 1001 0000   16 KB  which image counts
//! 1001 4000  976 KB  image A
//! 1010 8000  976 KB  image B
//! 101F C000   16 KB  the board's own key
//! ```
//!
//! Without a boot loader one image has all but the last part. Those of a Pico 2 stand elsewhere (`ab_images.rs`). While a part is written nothing can be fetched from this flash, so the
//! boot ROM's functions are called from RAM without interrupts: 45 ms for a sector that is erased, 0.4 ms for
//! a page. The key is written once at each start, before anything else runs; an image comes while no clamping
//! is under way and no axis moves.
//!
//! # Limitations
//!
//! BOOTSEL and the debug port read and replace all of this flash: who has the cabinet's key has the
//! board's. An image that is copied to the BOOTSEL drive leaves the board's key as it is.

use embassy_rp::Peri;
use embassy_rp::flash::{Blocking, Error, Flash as Driver};
use embassy_rp::peripherals::FLASH;
use umi_core::journal::{Flash, Geometry};
#[cfg(any(feature = "update", feature = "boot"))]
use umi_core::trust::access::update::slots::Maker;
#[cfg(feature = "slot-ab")]
use umi_core::trust::access::update::slots::boot_rom;

/// All of the chip's flash.
#[cfg(not(feature = "rp2350"))]
const CHIP_BYTES: usize = 2 * 1024 * 1024;
#[cfg(feature = "rp2350")]
const CHIP_BYTES: usize = 4 * 1024 * 1024;

/// What is erased at once.
pub const SECTOR_BYTES: u32 = 4096;

/// The board's key: what the linker keeps free, link/flash-*.x.
pub const KEY: FlashPlace = FlashPlace {
    from: CHIP_BYTES as u32 - 4 * SECTOR_BYTES,
    sectors: 4,
};

/// Some sectors.
#[derive(Clone, Copy)]
pub struct FlashPlace {
    /// Where they begin, from the start of the flash.
    pub from: u32,
    /// How many.
    pub sectors: u16,
}

#[cfg(any(feature = "update", feature = "boot"))]
impl FlashPlace {
    /// Where it ends.
    pub const fn end(self) -> u32 {
        self.from + self.sectors as u32 * SECTOR_BYTES
    }
}

/// The key of who makes images, which stands at this address; erased: nothing is taken.
#[cfg(any(feature = "update", feature = "boot"))]
pub fn maker(address: u32) -> Maker {
    let mut key = [0; 32];
    for (byte, at) in key.iter_mut().zip(address as usize..) {
        // SAFETY: the address is one of the flash, which is there.
        *byte = unsafe { core::ptr::with_exposed_provenance::<u8>(at).read_volatile() };
    }
    match key.iter().all(|byte| *byte == 0xFF) {
        true => Maker::First(None),
        false => Maker::Fixed(key),
    }
}

/// Reads flash by its own address, whatever of it the boot ROM shows, and beside the cache (RP2350 data sheet, 4.4.1).
#[cfg(feature = "slot-ab")]
fn read_unshown(from: u32, into: &mut [u8]) {
    const UNSHOWN: u32 = 0x1C00_0000;

    let from = core::ptr::with_exposed_provenance::<u8>((UNSHOWN + from) as usize);
    // SAFETY: the caller has held it against its place, which is of the flash; nobody writes there meanwhile.
    into.copy_from_slice(unsafe { core::slice::from_raw_parts(from, into.len()) });
}

/// Sectors of the chip's flash.
pub struct ChipFlash {
    driver: Driver<'static, FLASH, Blocking, CHIP_BYTES>,
    place: FlashPlace,
    /// The mark of a trial reads as it was signed.
    #[cfg(feature = "slot-ab")]
    as_signed: bool,
}

impl ChipFlash {
    /// Takes them.
    pub fn new(flash: Peri<'static, FLASH>, place: FlashPlace) -> Self {
        Self {
            driver: Driver::new_blocking(flash),
            place,
            #[cfg(feature = "slot-ab")]
            as_signed: false,
        }
    }

    /// An image that the boot ROM starts, whose mark of a trial reads as it was signed.
    #[cfg(feature = "slot-ab")]
    pub fn reads_as_signed(self) -> Self {
        Self {
            as_signed: true,
            ..self
        }
    }

    fn at(&self, addr: u32) -> u32 {
        self.place.from.saturating_add(addr)
    }

    /// Whether so many bytes from `addr` on are of this place.
    fn holds(&self, addr: u32, count: usize) -> Result<(), Error> {
        let end = addr as usize + count;
        let size = usize::from(self.place.sectors) * SECTOR_BYTES as usize;
        if end <= size {
            Ok(())
        } else {
            Err(Error::OutOfBounds)
        }
    }
}

impl Flash for ChipFlash {
    type Error = Error;

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: self.place.sectors,
            sector_size: SECTOR_BYTES,
            write_size: 1,
            page_size: 256,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Error> {
        self.holds(addr, into.len())?;
        #[cfg(not(feature = "slot-ab"))]
        self.driver.blocking_read(self.at(addr), into)?;
        #[cfg(feature = "slot-ab")]
        {
            read_unshown(self.at(addr), into);
            if self.as_signed {
                boot_rom::as_signed(addr, into);
            }
        }
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Error> {
        self.holds(addr, bytes.len())?;
        self.driver.blocking_write(self.at(addr), bytes)
    }

    fn erase(&mut self, sector: u32) -> Result<(), Error> {
        let from = sector.saturating_mul(SECTOR_BYTES);
        self.holds(from, SECTOR_BYTES as usize)?;
        let from = self.at(from);
        self.driver
            .blocking_erase(from, from.saturating_add(SECTOR_BYTES))
    }
}
