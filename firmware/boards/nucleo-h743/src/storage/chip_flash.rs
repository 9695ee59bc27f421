//! Parts of the flash that the code runs from: the board's own key, and the images of a boot loader.
//!
//! # Design
//!
//! ```text
//! 0800 0000  128 KB  boot loader; its last 32 bytes: the key of who makes images
//! 0802 0000  896 KB  image A
//! 0810 0000  768 KB  image B
//! 081C 0000  256 KB  the board's own key, and which image counts
//! ```
//!
//! Without a boot loader one image has all but the last part. That has two sectors, as many as a journal must have, so that
//! one is erased while the other has the newest entry; a second journal would cost image B its room.
//!
//! This flash has words of 32 bytes, each with a check value (ECC). A word is programmed once behind an erasure: the
//! journal's promise ([`Flash`]). What a power cut has torn may have a wrong check value, and to read that is a fault of the
//! bus. So a word is read with such faults ignored (Armv7-M, B3.2.8: BFHFNMIGN, with FAULTMASK set), and then the flash
//! is asked whether the word was damaged (RM0433, FLASH, error code correction: DBECCERR). **A damaged word reads as zeros**, which no
//! entry's, header's or image's own check takes for right. One whose single wrong bit was mended is read as it was.
//!
//! The flash has two banks of eight sectors, and one can be read while the other is written: either image goes on, and
//! interrupts come, while the other one is. The last part is of image B's bank: that one stands still for the
//! milliseconds in which an image is marked for trial or confirmed, and once in some 800 starts while that erases a sector. A sector
//! is erased in one second, two at most (DS12110, flash memory).
//!
//! # Limitations
//!
//! It has never been run. The debug port reads and replaces all of this flash, unless its owner has set the chip's
//! read-out protection: nothing here does.

use core::arch::asm;

use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::Bank;
use umi_core::journal::{Flash, Geometry};

/// Where the flash begins.
pub const BASE: u32 = 0x0800_0000;
/// What is erased at once.
pub const SECTOR_BYTES: u32 = 128 * 1024;
/// Sectors of a bank, of which there are two.
const BANK_SECTORS: u32 = 8;
/// What is programmed at once.
const WORD: usize = 32;

/// The board's key, and which image counts: what the linker keeps free (flash-*.x).
pub const KEPT: FlashPlace = FlashPlace {
    first: 14,
    sectors: 2,
};
const _: () = assert!(KEPT.end() == 2 * BANK_SECTORS);

/// Some sectors.
#[derive(Clone, Copy)]
pub struct FlashPlace {
    /// The first of them, from the start of the flash.
    pub first: u32,
    /// How many.
    pub sectors: u16,
}

impl FlashPlace {
    /// The first sector behind it.
    pub const fn end(self) -> u32 {
        self.first + self.sectors as u32
    }
}

/// Why the flash refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipFault {
    /// The address is outside of the place, or not that of a word.
    Outside,
    /// The flash reports that it was not done, or does not end.
    Failed,
}

/// Sectors of the chip's flash. Who has several uses one at a time.
pub struct ChipFlash {
    place: FlashPlace,
}

impl ChipFlash {
    /// Takes them.
    pub const fn new(place: FlashPlace) -> Self {
        Self { place }
    }

    /// The address of so many bytes of this place.
    fn at(&self, addr: u32, count: usize) -> Result<u32, ChipFault> {
        let size = u64::from(self.place.sectors) * u64::from(SECTOR_BYTES);
        if u64::from(addr) + count as u64 > size {
            return Err(ChipFault::Outside);
        }
        Ok(BASE + self.place.first * SECTOR_BYTES + addr)
    }
}

impl Flash for ChipFlash {
    type Error = ChipFault;

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: self.place.sectors,
            sector_size: SECTOR_BYTES,
            write_size: WORD as u32,
            page_size: WORD as u32,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), ChipFault> {
        let mut at = self.at(addr, into.len())?;
        let mut rest = into;
        while !rest.is_empty() {
            let skipped = at % WORD as u32;
            let word = read_word(at - skipped);
            let behind = word.iter().skip(skipped as usize);
            let count = rest.len().min(behind.len());
            let (piece, later) = rest.split_at_mut(count);
            for (byte, is) in piece.iter_mut().zip(behind) {
                *byte = *is;
            }
            at += count as u32;
            rest = later;
        }
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), ChipFault> {
        let at = self.at(addr, bytes.len())?;
        let words = bytes.as_chunks::<WORD>();
        if !words.1.is_empty() || !addr.is_multiple_of(WORD as u32) {
            return Err(ChipFault::Outside);
        }
        for (word, at) in words.0.iter().zip((at..).step_by(WORD)) {
            program_word(at, word)?;
        }
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), ChipFault> {
        let from = sector.checked_mul(SECTOR_BYTES).ok_or(ChipFault::Outside)?;
        self.at(from, SECTOR_BYTES as usize)?;
        erase_sector(self.place.first + sector)
    }
}

/// The bank of an address, and where in it that is.
fn bank_of(at: u32) -> (Bank, u32) {
    let bank_bytes = BANK_SECTORS * SECTOR_BYTES;
    let from_start = at - BASE;
    let bank = FLASH.bank((from_start / bank_bytes) as usize);
    (bank, from_start % bank_bytes)
}

/// Forgets what was wrong.
fn clear(bank: Bank) {
    bank.ccr().write(|w| {
        w.set_clr_eop(true);
        w.set_clr_wrperr(true);
        w.set_clr_pgserr(true);
        w.set_clr_strberr(true);
        w.set_clr_incerr(true);
        w.set_clr_operr(true);
        w.set_clr_sneccerr(true);
        w.set_clr_dbeccerr(true);
    });
}

/// Tries to read a word while the flash says that another one was damaged: the core reads ahead.
const MOST_TRIES: u32 = 4;

/// A word; zeros, if it is damaged.
fn read_word(at: u32) -> [u8; WORD] {
    let (bank, in_bank) = bank_of(at);
    for _ in 0..MOST_TRIES {
        clear(bank);
        let word = read_unfaulted(at);
        if !bank.sr().read().dbeccerr() {
            return word;
        }
        if u32::from(bank.far().read().fail_ecc_addr()) == in_bank / WORD as u32 {
            break;
        }
    }
    clear(bank);
    [0; WORD]
}

/// Reads a word, from the cells and not from a cache. Anything where that was a fault of the bus, which is ignored.
fn read_unfaulted(at: u32) -> [u8; WORD] {
    /// CCR (Armv7-M, B3.2.8), and its bit BFHFNMIGN.
    const CCR: u32 = 0xE000_ED14;
    const IGNORED: u32 = 1 << 8;
    let mut word = [0_u32; WORD / 4];
    // SAFETY: the cached line is this word's, which is never written as memory is: there is nothing to lose in it.
    unsafe {
        let mut core = cortex_m::Peripherals::steal();
        core.SCB.invalidate_dcache_by_address(at as usize, WORD);
    }
    // SAFETY: the word is one of the flash, and `word` has room for it. No interrupt comes meanwhile, and both
    // registers are afterwards as they were: nothing that comes here runs with FAULTMASK set.
    unsafe {
        asm!(
            "cpsid f",
            "ldr {was}, [{ccr}]",
            "orr {new}, {was}, #{ignored}",
            "str {new}, [{ccr}]",
            "dsb",
            "isb",
            "2: subs {n}, #4",
            "ldr {new}, [{from}, {n}]",
            "str {new}, [{to}, {n}]",
            "bne 2b",
            "dsb",
            "str {was}, [{ccr}]",
            "dsb",
            "isb",
            "cpsie f",
            ccr = in(reg) CCR,
            ignored = const IGNORED,
            was = out(reg) _,
            new = out(reg) _,
            n = inout(reg) WORD => _,
            from = in(reg) at,
            to = in(reg) word.as_mut_ptr(),
            options(nostack),
        );
    }
    let mut bytes = [0; WORD];
    for (place, part) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(word) {
        *place = part.to_le_bytes();
    }
    bytes
}

/// The longest that an operation takes: a sector's erasure by bytes, 4 s (DS12110, flash memory).
const MOST_US: u32 = 5_000_000;
/// Cycles from look to look: a microsecond, or longer where the core is slower.
const LOOK_CYCLES: u32 = 400;

/// Waits for the end of what a bank does, and says how it went.
fn wait(bank: Bank) -> Result<(), ChipFault> {
    let has_ended = |_: u32| {
        cortex_m::asm::delay(LOOK_CYCLES);
        let state = bank.sr().read();
        !state.bsy() && !state.qw()
    };
    let ended = (0..MOST_US).any(has_ended);
    let state = bank.sr().read();
    let went_wrong =
        state.wrperr() || state.pgserr() || state.strberr() || state.incerr() || state.operr();
    if ended && !went_wrong {
        Ok(())
    } else {
        Err(ChipFault::Failed)
    }
}

/// Opens a bank for what is done with it, and closes it again.
fn changing(
    bank: Bank,
    change: impl FnOnce(Bank) -> Result<(), ChipFault>,
) -> Result<(), ChipFault> {
    // The two keys (RM0433, FLASH, protection of its registers). A second pair in a bank that is open would close it until a reset.
    if bank.cr().read().lock() {
        bank.keyr().write_value(0x4567_0123);
        bank.keyr().write_value(0xCDEF_89AB);
    }
    clear(bank);
    let done = change(bank);
    clear(bank);
    bank.cr().modify(|w| {
        w.set_pg(false);
        w.set_ser(false);
        w.set_lock(true);
    });
    done
}

fn program_word(at: u32, word: &[u8; WORD]) -> Result<(), ChipFault> {
    let (bank, _) = bank_of(at);
    changing(bank, |bank| {
        bank.cr().modify(|w| w.set_pg(true));
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        for (part, at) in word.as_chunks::<4>().0.iter().zip((at..).step_by(4)) {
            let place = core::ptr::with_exposed_provenance_mut::<u32>(at as usize);
            // SAFETY: the address is one of a place of this flash, which takes a word in eight parts.
            unsafe { place.write_volatile(u32::from_le_bytes(*part)) };
        }
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        wait(bank)
    })
}

fn erase_sector(sector: u32) -> Result<(), ChipFault> {
    let (bank, _) = bank_of(BASE + sector * SECTOR_BYTES);
    changing(bank, |bank| {
        bank.cr().modify(|w| {
            w.set_ser(true);
            w.set_snb((sector % BANK_SECTORS) as u8);
        });
        bank.cr().modify(|w| w.set_start(true));
        cortex_m::asm::dsb();
        wait(bank)
    })
}
