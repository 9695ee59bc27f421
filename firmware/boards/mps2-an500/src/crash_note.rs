//! Crash note: cause of the last reset and place of a panic, in RAM that a reset does not clear.
//!
//! # Design
//!
//! A word in RAM that power-up leaves at zero says that the rest is ours. Before every
//! reset that the firmware makes itself, its cause is noted; a start that finds the
//! word and no note was reset from outside.

use core::cell::UnsafeCell;
use core::fmt::Write as _;
use core::panic::PanicInfo;
use core::ptr;

use cortex_m::peripheral::SCB;
use heapless::String;

/// Longest text of a panic that is kept.
const TEXT: usize = 96;

/// Says that what stands behind it is ours.
const OURS: u32 = 0x554D_4931;

/// Why the firmware reset the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
enum Note {
    None = 0,
    Panic = 0x5041_4E49,
    Watchdog = 0x5744_4F47,
    Software = 0x534F_4654,
}

#[repr(C)]
struct Kept {
    ours: u32,
    note: u32,
    length: u32,
    text: [u8; TEXT],
}

unsafe extern "C" {
    #[link_name = "__kept"]
    static KEPT: UnsafeKept;
}

/// Memory that the linker script sets aside.
#[repr(transparent)]
struct UnsafeKept(UnsafeCell<Kept>);

// SAFETY: every access is volatile, of plain numbers, and there is one core; a note that an
// interrupt overwrites is followed by a reset.
unsafe impl Sync for UnsafeKept {}

/// Why the board started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The power came.
    Power,
    /// From outside: the debugger, or whoever runs the machine.
    External,
    /// Nothing fed the watchdog.
    Watchdog,
    /// The firmware wanted it: another image is to run.
    Software,
    /// A panic, and where.
    Panic(String<TEXT>),
}

/// Looks why the board started, and begins anew. Once, at the start.
pub fn take_cause() -> Cause {
    // SAFETY: the linker script keeps the place free of everything else.
    let kept = unsafe { KEPT.0.get() };
    // SAFETY: the place is in RAM and aligned; any bits are a Kept.
    let found = unsafe { kept.read_volatile() };
    // SAFETY: as above.
    unsafe {
        ptr::addr_of_mut!((*kept).ours).write_volatile(OURS);
        ptr::addr_of_mut!((*kept).note).write_volatile(Note::None as u32);
    }
    if found.ours != OURS {
        return Cause::Power;
    }
    match found.note {
        note if note == Note::Watchdog as u32 => Cause::Watchdog,
        note if note == Note::Software as u32 => Cause::Software,
        note if note == Note::Panic as u32 => {
            let length = (found.length as usize).min(TEXT);
            let text = found.text.get(..length).unwrap_or_default();
            let text = core::str::from_utf8(text).unwrap_or("?");
            Cause::Panic(String::try_from(text).unwrap_or_default())
        }
        _ => Cause::External,
    }
}

/// Notes that the watchdog is about to reset.
pub fn note_watchdog() {
    note(Note::Watchdog, "");
}

/// Starts the board anew because the firmware wants it.
pub fn restart() -> ! {
    note(Note::Software, "");
    SCB::sys_reset()
}

/// Notes where it happened.
pub fn note_panic(info: &PanicInfo<'_>) {
    let mut text = String::<TEXT>::new();
    if let Some(location) = info.location() {
        // The end of a path says more than its beginning.
        let file = location.file();
        let from = file.len().saturating_sub(TEXT - 12);
        let file = file.get(from..).unwrap_or(file);
        let _ = write!(text, "{file}:{}", location.line());
    }
    note(Note::Panic, &text);
}

/// Notes what the core could not do.
pub fn note_fault(what: &str) {
    note(Note::Panic, what);
}

fn note(note: Note, said: &str) {
    let mut text = [0; TEXT];
    for (place, byte) in text.iter_mut().zip(said.bytes()) {
        *place = byte;
    }
    let kept = Kept {
        ours: OURS,
        note: note as u32,
        length: said.len().min(TEXT) as u32,
        text,
    };
    // SAFETY: the linker script keeps the place free of everything else; see `Sync`.
    unsafe { KEPT.0.get().write_volatile(kept) };
}
