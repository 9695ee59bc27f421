//! The board's own key: the last 16 KB of the flash that the code runs from.
//!
//! # Design
//!
//! No request reaches this flash, and it is not the journal's chip, which can be taken off and read
//! elsewhere. While it is written nothing can be fetched from it, so the boot ROM's functions are called
//! from RAM without interrupts. That happens once at each start, before anything else runs: an entry of
//! a hundred bytes, and an erasure of 45 ms each fortieth time.
//!
//! # Limitations
//!
//! BOOTSEL and the debug port read and replace all of this flash: who has the cabinet's key has the
//! board's. An image that is copied to the BOOTSEL drive leaves these sectors as they are.

use embassy_rp::Peri;
use embassy_rp::flash::{Blocking, Error, FLASH_BASE, Flash as Driver};
use embassy_rp::peripherals::FLASH;
use umi_core::journal::{Flash, Geometry};

/// All of the chip's flash.
#[cfg(not(feature = "rp2350"))]
const CHIP_BYTES: usize = 2 * 1024 * 1024;
#[cfg(feature = "rp2350")]
const CHIP_BYTES: usize = 4 * 1024 * 1024;

const SECTOR_BYTES: u32 = 4096;

/// What the linker keeps free: memory-rp2040.x.
const GEOMETRY: Geometry = Geometry {
    sectors: 4,
    sector_size: SECTOR_BYTES,
    write_size: 1,
    page_size: 256,
};

unsafe extern "C" {
    /// Where these sectors begin.
    #[link_name = "__board_key"]
    static BOARD_KEY: u8;
}

/// The sectors of the key.
pub struct KeyFlash(Driver<'static, FLASH, Blocking, CHIP_BYTES>);

impl KeyFlash {
    /// Takes them.
    pub fn new(flash: Peri<'static, FLASH>) -> Self {
        Self(Driver::new_blocking(flash))
    }
}

/// Where an address of these sectors is in the chip's flash.
fn place(addr: u32) -> u32 {
    let start = (&raw const BOARD_KEY).addr() as u32 - FLASH_BASE.addr() as u32;
    start.saturating_add(addr)
}

impl Flash for KeyFlash {
    type Error = Error;

    fn geometry(&self) -> Geometry {
        GEOMETRY
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_read(place(addr), into)
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.blocking_write(place(addr), bytes)
    }

    fn erase(&mut self, sector: u32) -> Result<(), Error> {
        let from = place(sector.saturating_mul(SECTOR_BYTES));
        self.0
            .blocking_erase(from, from.saturating_add(SECTOR_BYTES))
    }
}
