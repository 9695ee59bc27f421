//! Storage: NOR flash played by PSRAM, which a reset leaves as it is.
//!
//! # Design
//!
//! The cells behave as those of the serial NOR flash of the real boards: programming
//! clears bits, erasing sets a sector's, and to program what is not erased is an error
//! rather than a different value. QEMU can lay the PSRAM into a file
//! (`-object memory-backend-file,…,share=on`), so it also outlives QEMU: that is a power
//! cycle.
//!
//! # Limitations
//!
//! It takes no time, and no power cut falls into it: the journal is tested against those
//! on the host.

pub mod images;
pub mod owner;

use core::ptr;

use umi_core::journal::{ERASED, Flash, Geometry};

/// The journal: 4 MiB in the 64 KiB sectors of a serial NOR flash.
const JOURNAL: Geometry = Geometry {
    sectors: 64,
    sector_size: 65_536,
    write_size: 1,
    page_size: 256,
};

/// Job and taught reference.
const SETTINGS: Geometry = Geometry {
    sectors: 4,
    sector_size: 16_384,
    write_size: 1,
    page_size: 256,
};

/// Part programs: 4 MiB in the 4 KiB sectors of a serial NOR flash.
const PROGRAMS: Geometry = Geometry {
    sectors: 1024,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// Verdicts and other evidence, apart from the noise: 1 MiB.
const EVIDENCE: Geometry = Geometry {
    sectors: 16,
    ..JOURNAL
};

/// Small areas: what is kept for the owner, the keys of people, and the board's own.
const SMALL: Geometry = Geometry {
    sectors: 4,
    ..PROGRAMS
};

/// A place for an image: 640 KiB.
const SLOT: Geometry = Geometry {
    sectors: 160,
    ..PROGRAMS
};

/// Says that the memory behind it has been erased once, as flash comes from its maker. Areas that lie
/// elsewhere have another.
const FLASH: u32 = 0x464C_5349;

const JOURNAL_AT: usize = 0x1000;
const SETTINGS_AT: usize = JOURNAL_AT + size(JOURNAL);
const PROGRAMS_AT: usize = SETTINGS_AT + size(SETTINGS);
const EVIDENCE_AT: usize = PROGRAMS_AT + size(PROGRAMS);
const CUSTODY_AT: usize = EVIDENCE_AT + size(EVIDENCE);
const ACCESS_AT: usize = CUSTODY_AT + size(SMALL);
const KEY_AT: usize = ACCESS_AT + size(SMALL);
const STATE_AT: usize = KEY_AT + size(SMALL);
const SLOTS_AT: [usize; 2] = [STATE_AT + size(SMALL), STATE_AT + size(SMALL) + size(SLOT)];
const END: usize = STATE_AT + size(SMALL) + 2 * size(SLOT);
const _: () = assert!(END <= 16 * 1024 * 1024, "the PSRAM has 16 MB");

const fn size(geometry: Geometry) -> usize {
    geometry.sectors as usize * geometry.sector_size as usize
}

unsafe extern "C" {
    /// Where the linker script has the PSRAM.
    #[link_name = "__flash"]
    static PSRAM: u8;
}

/// A region of the flash.
pub struct Region {
    start: *mut u8,
    geometry: Geometry,
}

// SAFETY: the region is plain memory that belongs to this value alone.
unsafe impl Send for Region {}

/// Why the flash refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The address is outside of the region.
    Outside,
    /// What is to be programmed has not been erased.
    NotErased,
}

/// Before the first region the bench says what this machine has no hardware for: in place of a source
/// of entropy 32 bytes, zeros where there is none; a byte, 1 while the jumper is closed; and the public
/// key of who makes images, zeros where none are taken.
const ENTROPY_AT: usize = 16;
const JUMPER_AT: usize = ENTROPY_AT + 32;
const MAKER_AT: usize = JUMPER_AT + 1;

/// Whether the jumper is closed now.
pub fn jumper_is_closed() -> bool {
    let psram = &raw const PSRAM;
    // SAFETY: the byte is there, and only the bench writes to it.
    unsafe { psram.add(JUMPER_AT).read_volatile() == 1 }
}

/// All that the board keeps.
pub struct Areas {
    /// The journal.
    pub journal: Region,
    /// Job and taught reference.
    pub settings: Region,
    /// Part programs.
    pub programs: Region,
    /// Evidence.
    pub evidence: Region,
    /// For the owner.
    pub custody: Region,
    /// Keys of people.
    pub access: Region,
    /// The board's own key.
    pub key: Region,
    /// In place of a source of entropy.
    pub entropy: [u8; 32],
    /// Signed images.
    pub images: SlotRegions,
}

/// Of signed images.
pub struct SlotRegions {
    /// Which of them counts.
    pub state: Region,
    /// The images.
    pub slots: [Region; 2],
    /// The public key of who makes them; zeros: nobody's are taken.
    pub maker: [u8; 32],
}

/// Opens the flash.
///
/// # Safety
/// To be called once: the regions are the only ones that reach the PSRAM.
pub unsafe fn open() -> Areas {
    let psram = &raw const PSRAM as *mut u8;
    let mark = psram.cast::<u32>();
    // SAFETY: the PSRAM is there, aligned, and nobody else's.
    unsafe {
        if mark.read_volatile() != FLASH {
            // New memory, or an empty file.
            ptr::write_bytes(psram.add(JOURNAL_AT), ERASED, END - JOURNAL_AT);
            mark.write_volatile(FLASH);
        }
        let region = |at: usize, geometry| Region {
            start: psram.add(at),
            geometry,
        };
        Areas {
            journal: region(JOURNAL_AT, JOURNAL),
            settings: region(SETTINGS_AT, SETTINGS),
            programs: region(PROGRAMS_AT, PROGRAMS),
            evidence: region(EVIDENCE_AT, EVIDENCE),
            custody: region(CUSTODY_AT, SMALL),
            access: region(ACCESS_AT, SMALL),
            key: region(KEY_AT, SMALL),
            entropy: psram.add(ENTROPY_AT).cast::<[u8; 32]>().read_volatile(),
            images: SlotRegions {
                state: region(STATE_AT, SMALL),
                slots: SLOTS_AT.map(|at| region(at, SLOT)),
                maker: psram.add(MAKER_AT).cast::<[u8; 32]>().read_volatile(),
            },
        }
    }
}

impl Region {
    /// These bytes of the region.
    fn cells(&mut self, at: usize, length: usize) -> Result<&mut [u8], Refusal> {
        let end = at.checked_add(length).ok_or(Refusal::Outside)?;
        if end > size(self.geometry) {
            return Err(Refusal::Outside);
        }
        // SAFETY: inside of the region, which is this value's alone.
        Ok(unsafe { core::slice::from_raw_parts_mut(self.start.add(at), length) })
    }
}

impl Flash for Region {
    type Error = Refusal;

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Refusal> {
        let cells = self.cells(addr as usize, into.len())?;
        into.copy_from_slice(cells);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Refusal> {
        let cells = self.cells(addr as usize, bytes.len())?;
        if cells.iter().any(|cell| *cell != ERASED) {
            return Err(Refusal::NotErased);
        }
        cells.copy_from_slice(bytes);
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), Refusal> {
        let size = self.geometry.sector_size as usize;
        let at = (sector as usize)
            .checked_mul(size)
            .ok_or(Refusal::Outside)?;
        self.cells(at, size)?.fill(ERASED);
        Ok(())
    }
}
