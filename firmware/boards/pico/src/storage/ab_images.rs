//! Where the images of a Pico 2 stand that its boot ROM starts, and what the ROM is asked for.
//!
//! # Design
//!
//! ```text
//! 1000 0000    4 KB  partition table: tells the ROM of the two places
//! 1000 1000    4 KB  erased: where the ROM looks for a second table
//! 1000 2000   16 KB  which image counts
//! 1000 6000 2028 KB  image A
//! 1020 1000 2028 KB  image B
//! 103F C000   16 KB  the board's own key
//! ```
//!
//! The ROM shows the place that it has chosen from 1000 0000 on, whichever it is: one image runs in both. There stand the
//! header, the ROM's seal, the maker's key, and from 512 on the code. What is not shown is read and written by its own
//! address. What the image does with the ROM's choice stands in [`umi_core::trust::access::update::slots::boot_rom`].
//!
//! # Limitations
//!
//! It has never run. Without the chip's fuses the ROM finds damage, but starts whoever's image.

use embassy_rp::flash::FLASH_BASE;
use embassy_rp::peripherals::FLASH;
use embassy_rp::{Peri, pac, rom_data};
use umi_core::trust::access::update::slots::boot_rom::{Onwards, RomStart};
use umi_core::trust::access::update::slots::{ImageKind, Slots, UpdateError};
use umi_protocol::update::{ImagePlace, ImageVersion};

use super::Part;
use super::chip_flash::{ChipFlash, FlashPlace, KEY, SECTOR_BYTES, maker};
use crate::safety::guard;

/// The partition table, and room for a second one.
const TABLES: FlashPlace = FlashPlace {
    from: 0,
    sectors: 2,
};
/// Which image counts.
const STATE: FlashPlace = FlashPlace {
    from: TABLES.end(),
    sectors: 4,
};
/// The images, each with its header.
const IMAGES: [FlashPlace; 2] = [
    FlashPlace {
        from: STATE.end(),
        sectors: 507,
    },
    FlashPlace {
        from: STATE.end() + 507 * SECTOR_BYTES,
        sectors: 507,
    },
];
const _: () = assert!(IMAGES[1].end() == KEY.from && KEY.end() == 4 * 1024 * 1024);

/// The same image runs at either place.
const KIND: ImageKind = ImageKind {
    boards: ["pico2"; 2],
    built_in: None,
};

/// Where the maker's key stands in an image: within what the ROM's seal covers, before the code (link/flash-rp2350-ab.x).
const MAKER: u32 = 0x200 - 32;

/// The images, with the version of one whose trial was given up.
type FoundImages = (Result<Slots<Part>, UpdateError>, Option<ImageVersion>);

/// The images; none: this one may not run here.
pub fn take_over(flash: &Peri<'static, FLASH>) -> Option<FoundImages> {
    let taken = started().and_then(|rom| {
        let mut slots = open(flash)?;
        let onwards = slots.take_over(rom)?;
        Ok((slots, onwards))
    });
    match taken {
        Ok((slots, Onwards::Runs { reverted })) => Some((Ok(slots), reverted)),
        Ok((_, Onwards::Try(place))) => start_on_trial(place),
        Ok((_, Onwards::Restart)) => guard::reset_now(),
        Ok((_, Onwards::Stop)) => None,
        Err(error) => Some((Err(error), None)),
    }
}

fn open(flash: &Peri<'static, FLASH>) -> Result<Slots<Part>, UpdateError> {
    let area = |place| {
        // SAFETY: each call waits for its end, with interrupts off while it writes.
        ChipFlash::new(unsafe { flash.clone_unchecked() }, place)
    };
    let slots = IMAGES.map(|place| Part::Chip(area(place).reads_as_signed()));
    let maker = maker(FLASH_BASE.addr() as u32 + MAKER);
    Ok(Slots::open(Part::Chip(area(STATE)), slots, KIND, maker)?.bought_by(buy))
}

/// What the ROM says of this start.
fn started() -> Result<RomStart, UpdateError> {
    /// Asks for the boot (data sheet, 5.5.9, get_sys_info), and is the first word of the answer.
    const BOOT: u32 = 0x40;
    /// In the second: the image was started on trial.
    const TO_BE_BOUGHT: u32 = 1 << 24;

    let shown = u32::from(pac::QMI.atrans(0).read().base()) * SECTOR_BYTES;
    let places = [ImagePlace::A, ImagePlace::B].into_iter().zip(IMAGES);
    let place = places
        .filter_map(|(place, of)| (of.from == shown).then_some(place))
        .next();
    let mut answer = [0; 5];
    // SAFETY: the ROM writes as many words as it is told that there are, at most.
    let words = unsafe { rom_data::get_sys_info(answer.as_mut_ptr(), answer.len(), BOOT) };
    match (place, answer) {
        (Some(place), [BOOT, boot, ..]) if words == 5 => Ok(RomStart {
            place,
            to_be_bought: boot & TO_BE_BOUGHT != 0,
        }),
        _ => Err(UpdateError::Flash),
    }
}

/// The ROM starts the image at this place, marked as it is. One that it finds damaged it does not: then this one again.
fn start_on_trial(place: ImagePlace) -> ! {
    /// A restart that names an image, and a call that does not come back (data sheet, 5.5.8, reboot).
    const UPDATE: u32 = 0x104;
    const DELAY_MS: u32 = 10;

    cortex_m::interrupt::disable();
    let [a, b] = IMAGES;
    let of = if place == ImagePlace::B { b } else { a };
    rom_data::reboot(UPDATE, DELAY_MS, FLASH_BASE.addr() as u32 + of.from, 0);
    // It has refused.
    guard::reset_now()
}

/// Takes the mark of a trial off: the ROM erases the image's first sector and writes it again, in 50 ms. Where the fuses ask
/// for it, the ROM burns the image's counter now; that may restart the board, and the trial goes on.
#[inline(never)]
fn buy() -> Result<(), UpdateError> {
    let mut sector = [0_u32; SECTOR_BYTES as usize / 4];
    let answer = critical_section::with(|_| {
        // SAFETY: the ROM has a sector's room; meanwhile nothing is fetched from the flash, as no interrupt comes.
        let answer = unsafe { rom_data::explicit_buy(sector.as_mut_ptr().cast(), SECTOR_BYTES) };
        guard::watch_on();
        answer
    });
    if answer == 0 {
        Ok(())
    } else {
        Err(UpdateError::Flash)
    }
}
