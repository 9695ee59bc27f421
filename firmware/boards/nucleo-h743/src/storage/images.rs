//! Where the images of a board with a boot loader stand, and whose images it takes.
//!
//! Boot loader and image share this file: what one has written the other reads.

use umi_core::journal::Flash;
use umi_core::trust::access::update::slots::{ImageKind, Maker, Slots, UpdateError};
use umi_protocol::update::{ImagePlace, ImageVersion};

use super::chip_flash::{BASE, ChipFlash, FlashPlace, KEPT, SECTOR_BYTES};
use crate::ram_note::{self, RamNote};

/// The boot loader.
const LOADER: FlashPlace = FlashPlace {
    first: 0,
    sectors: 1,
};
/// The images, each with its header: flash-slot-a.x and flash-slot-b.x. Each has a bank of its own, so that one is read while
/// the other one is written.
const IMAGES: [FlashPlace; 2] = [
    FlashPlace {
        first: 1,
        sectors: 7,
    },
    FlashPlace {
        first: 8,
        sectors: 6,
    },
];
const _: () = assert!(LOADER.end() == IMAGES[0].first);
const _: () = assert!(IMAGES[0].end() == IMAGES[1].first && IMAGES[1].end() == KEPT.first);

/// Nothing is built in; an image runs where it is linked for.
const KIND: ImageKind = ImageKind {
    boards: ["nucleo-h743-a", "nucleo-h743-b"],
    built_in: None,
};

/// The key of who makes images, which stands in the boot loader's last bytes; none: nothing is taken.
fn maker() -> Maker {
    let mut key = [0; 32];
    let at = SECTOR_BYTES - key.len() as u32;
    // The place has these bytes.
    let read = ChipFlash::new(LOADER).read(at, &mut key);
    match read.is_err() || key.iter().all(|byte| *byte == 0xFF) {
        true => Maker::First(None),
        false => Maker::Fixed(key),
    }
}

/// The images where what counts cannot be read.
#[allow(dead_code, reason = "only the boot loader goes on then")]
pub fn stateless() -> Slots<ChipFlash> {
    Slots::stateless(IMAGES.map(ChipFlash::new), KIND, maker())
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
    Some(BASE + place.first * SECTOR_BYTES + VECTORS)
}

/// From the start of an image's place to its vectors, whose table of 166 wants an address that is a multiple of
/// 1024: the header, and bytes of the payload that nothing runs (flash-slot-a.x).
const VECTORS: u32 = 1024;

/// Opens the images, each area as flash of this kind. The board's key, which stands beside what counts, is opened before.
///
/// # Errors
/// [`UpdateError::Flash`]: what counts cannot be read.
pub fn open<F: Flash>(of: impl Fn(ChipFlash) -> F) -> Result<Slots<F>, UpdateError> {
    let slots = IMAGES.map(|place| of(ChipFlash::new(place)));
    Slots::open_behind_key(of(ChipFlash::new(KEPT)), slots, KIND, maker())
}

unsafe extern "C" {
    /// At the end of the DTCM, which a reset of the core leaves (memory.x).
    #[link_name = "_reverted"]
    static REVERTED: RamNote;
}

/// Says that a trial was given up, beside three numbers of 16 bits.
const WAS_REVERTED: u64 = 0x7265;

/// Leaves the version of an image whose trial was given up to the image that runs now; none: there was none.
#[allow(dead_code, reason = "only the boot loader does")]
pub fn leave_reverted(version: Option<ImageVersion>) {
    let number = version.map_or(0, |version| {
        let add = |sum: u64, part: u16| sum << 16 | u64::from(part);
        version.into_iter().fold(WAS_REVERTED, add)
    });
    // SAFETY: the place is in RAM, and nobody else's.
    ram_note::keep(unsafe { &REVERTED }, number);
}

/// Takes what [`leave_reverted`] has left.
#[allow(dead_code, reason = "only an image does")]
pub fn take_reverted() -> Option<ImageVersion> {
    // SAFETY: as above; any bits are a number.
    let number = ram_note::kept(unsafe { &REVERTED });
    leave_reverted(None);
    let version = [32, 16, 0].map(|shift| (number >> shift) as u16);
    (number >> 48 == WAS_REVERTED).then_some(version)
}
