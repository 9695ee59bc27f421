//! Crash note: the place of a panic, in RAM that a reset does not clear.
//!
//! # Design
//!
//! A place in RAM that the start does not clear. After power-up anything may stand in
//! it: only the right mark makes it count, and it is wiped when it has been read.

use core::cell::UnsafeCell;
use core::fmt::Write as _;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use heapless::String;

/// What is noted of a stack that has overflowed.
pub const OVERFLOWED: &str = "the stack has overflowed";

/// Longest text that is kept.
pub const TEXT: usize = 96;

/// Says that what stands behind it is ours.
const OURS: [u32; 2] = [0x554D_4932, 0x6B65_7074];

#[derive(Clone, Copy)]
#[repr(C)]
struct Kept {
    ours: [u32; 2],
    length: u32,
    text: [u8; TEXT],
}

struct Place(UnsafeCell<MaybeUninit<Kept>>);

// SAFETY: every access is volatile and of plain numbers. There is one core; a note that an
// interrupt overwrites is followed by a reset.
unsafe impl Sync for Place {}

#[unsafe(link_section = ".uninit.KEPT")]
static KEPT: Place = Place(UnsafeCell::new(MaybeUninit::uninit()));

/// Where the firmware panicked, if that is why the board started. Once, at the start.
pub fn take() -> Option<String<TEXT>> {
    let place = KEPT.0.get().cast::<Kept>();
    // SAFETY: the place is in RAM and aligned, and any bits are a Kept.
    let found = unsafe { place.read_volatile() };
    write([0; 2], b"");
    if found.ours != OURS {
        return None;
    }
    let text = found.text.get(..found.length as usize).unwrap_or_default();
    let text = core::str::from_utf8(text).unwrap_or("?");
    Some(String::try_from(text).unwrap_or_default())
}

/// Notes where a panic happened.
pub fn note_panic(info: &PanicInfo<'_>) {
    let mut text = String::<TEXT>::new();
    if let Some(location) = info.location() {
        // The end of a path says more than its beginning.
        let file = location.file();
        let from = file.len().saturating_sub(TEXT - 12);
        let file = file.get(from..).unwrap_or(file);
        let _ = write!(text, "{file}:{}", location.line());
    }
    write(OURS, text.as_bytes());
}

/// Notes where the core could not go on. Without the library's formatting: it would want
/// five kilobytes of stack, and of a fault there may be little left. Without an address the stack
/// has overflowed.
pub fn note_fault(address: u32) {
    if address == 0 {
        return write(OURS, OVERFLOWED.as_bytes());
    }
    let mut text = *b"hard fault at 0x00000000";
    for (place, shift) in text.iter_mut().rev().zip((0..32).step_by(4)) {
        *place = match (address >> shift) as u8 & 15 {
            digit @ 0..10 => b'0' + digit,
            digit => b'a' - 10 + digit,
        };
    }
    write(OURS, &text);
}

fn write(ours: [u32; 2], said: &[u8]) {
    let mut text = [0; TEXT];
    for (place, byte) in text.iter_mut().zip(said) {
        *place = *byte;
    }
    let kept = Kept {
        ours,
        length: said.len().min(TEXT) as u32,
        text,
    };
    // SAFETY: the place is in RAM and aligned; see `Sync`.
    unsafe { KEPT.0.get().cast::<Kept>().write_volatile(kept) };
}
