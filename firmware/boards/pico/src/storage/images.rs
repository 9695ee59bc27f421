//! Where the images of a Pico with a boot loader stand, and whose images it takes.
//!
//! Boot loader and image share this file: what one has written the other reads.

use embassy_rp::flash::FLASH_BASE;
use embassy_rp::peripherals::FLASH;
use embassy_rp::{Peri, pac};
use umi_core::journal::Flash;
use umi_core::trust::access::update::slots::{ImageKind, Maker, Slots, UpdateError};
use umi_protocol::update::{ImagePlace, ImageVersion};

use super::chip_flash::{self, ChipFlash, FlashPlace, KEY, SECTOR_BYTES};

/// The boot loader.
const LOADER: FlashPlace = FlashPlace {
    from: 0,
    sectors: 16,
};
/// Which image counts.
const STATE: FlashPlace = FlashPlace {
    from: LOADER.end(),
    sectors: 4,
};
/// The images, each with its header: link/flash-slot-a.x and link/flash-slot-b.x.
const IMAGES: [FlashPlace; 2] = [
    FlashPlace {
        from: STATE.end(),
        sectors: 244,
    },
    FlashPlace {
        from: STATE.end() + 244 * SECTOR_BYTES,
        sectors: 244,
    },
];
const _: () = assert!(IMAGES[1].end() == KEY.from && KEY.end() == 2 * 1024 * 1024);

/// Nothing is built in; an image runs where it is linked for.
const KIND: ImageKind = ImageKind {
    boards: ["pico-a", "pico-b"],
    built_in: None,
};

/// The key of who makes images, which stands in the boot loader's last bytes.
fn maker() -> Maker {
    chip_flash::maker(FLASH_BASE.addr() as u32 + LOADER.end() - 32)
}

/// The flash of an area. Whoever has several uses one at a time.
fn area(flash: &Peri<'static, FLASH>, place: FlashPlace) -> ChipFlash {
    // SAFETY: each call waits for its end, with interrupts off while it writes.
    ChipFlash::new(unsafe { flash.clone_unchecked() }, place)
}

/// The images where what counts cannot be read.
#[allow(dead_code, reason = "only the boot loader goes on then")]
pub fn stateless(flash: &Peri<'static, FLASH>) -> Slots<ChipFlash> {
    let slots = IMAGES.map(|place| area(flash, place));
    Slots::stateless(slots, KIND, maker())
}

/// Where the vectors of an image are; none: nothing is built in.
#[allow(dead_code, reason = "only the boot loader goes there")]
pub fn vectors(place: ImagePlace) -> Option<u32> {
    let [a, b] = IMAGES;
    let place = match place {
        ImagePlace::BuiltIn => return None,
        ImagePlace::A => a,
        ImagePlace::B => b,
    };
    Some(FLASH_BASE.addr() as u32 + place.from + VECTORS)
}

/// From the start of an image's place to its vectors, whose table wants an address that is a multiple of 256:
/// the header, and bytes of the payload that nothing runs (link/flash-slot-a.x).
const VECTORS: u32 = 256;

/// Opens the images, each area as flash of this kind.
///
/// # Errors
/// [`UpdateError::Flash`]: what counts cannot be read.
pub fn open<F: Flash>(
    flash: &Peri<'static, FLASH>,
    of: impl Fn(ChipFlash) -> F,
) -> Result<Slots<F>, UpdateError> {
    let slots = IMAGES.map(|place| of(area(flash, place)));
    Slots::open(of(area(flash, STATE)), slots, KIND, maker())
}

/// Says in the watchdog's registers, which a reset of the core leaves, that a trial was given up.
const REVERTED: u32 = 0x7265_7674;

/// Leaves the version of an image whose trial was given up to the image that runs now; none: there was none.
#[allow(dead_code, reason = "only the boot loader does")]
pub fn leave_reverted(version: Option<ImageVersion>) {
    let [major, minor, patch] = version.unwrap_or_default().map(u32::from);
    let mark = if version.is_some() { REVERTED } else { 0 };
    let dog = pac::WATCHDOG;
    dog.scratch0().write_value(mark);
    dog.scratch1().write_value(major << 16 | minor);
    dog.scratch2().write_value(patch);
}

/// Takes what [`leave_reverted`] has left.
#[allow(dead_code, reason = "only an image does")]
pub fn take_reverted() -> Option<ImageVersion> {
    let dog = pac::WATCHDOG;
    let was = (dog.scratch0().read() == REVERTED).then(|| {
        let first = dog.scratch1().read();
        [
            (first >> 16) as u16,
            first as u16,
            dog.scratch2().read() as u16,
        ]
    });
    leave_reverted(None);
    was
}
