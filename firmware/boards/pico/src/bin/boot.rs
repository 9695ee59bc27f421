//! The boot loader of a Pico: it verifies an image and starts it.
//!
//! ```text
//! reset ─► which image counts ─► verified by the maker's key: its SHA-512, signature, version, counter
//!                                  ├── right ─► it runs; on trial with the watchdog before it
//!                                  └── wrong ─► the other one, if that is right and not older; else blink
//! ```
//!
//! What it decides stands in [`umi_core::trust::access::update::slots`], which images and virtual boards share. It writes
//! only which image counts, never an image.
#![no_std]
#![no_main]

// The HAL looks at the clock.
#[path = "../time/alarms.rs"]
mod alarms;
#[path = "../safety/before_main.rs"]
mod before_main;
#[path = "../storage/chip_flash.rs"]
mod chip_flash;
#[path = "../../../common/fault_entry.rs"]
mod fault_entry;
#[path = "../storage/images.rs"]
mod images;

use core::panic::PanicInfo;

use embassy_rp::gpio::{Level, Output};
use embassy_rp::watchdog::Watchdog;
use embassy_time::Duration;
use portable_atomic as _;
use rp_pac as _;

/// An image on trial that does not take up the watchdog within this resets the board, which goes back: as long as
/// the chip can count.
const TRIAL: Duration = Duration::from_millis(8_000);

#[cortex_m_rt::entry]
fn main() -> ! {
    let chip = embassy_rp::init(Default::default());
    let mut light = Output::new(chip.PIN_25, Level::High);
    let mut slots =
        images::open(&chip.FLASH, |area| area).unwrap_or_else(|_| images::stateless(&chip.FLASH));
    // Where a trial cannot be kept it would never end: none begins.
    let started = slots.start().unwrap_or_else(|_| slots.start_confirmed());
    let Some(vectors) = images::vectors(started.place) else {
        loop {
            // Three short ones: nothing here may run.
            for _ in 0..6 {
                light.toggle();
                cortex_m::asm::delay(12_000_000);
            }
            cortex_m::asm::delay(125_000_000);
        }
    };
    images::leave_reverted(started.reverted);
    light.set_low();
    if started.on_trial {
        Watchdog::new(chip.WATCHDOG).start(TRIAL);
    }
    // SAFETY: an image that the maker has signed for this place, as it is at a reset: nothing here has let an
    // interrupt, and its vectors are the table of the next one.
    unsafe {
        (*cortex_m::peripheral::SCB::PTR).vtor.write(vectors);
        cortex_m::asm::bootload(core::ptr::with_exposed_provenance(vectors as usize))
    }
}

/// The next start tries again: from `fault_entry`.
#[unsafe(no_mangle)]
extern "C" fn on_fault(_: u32) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

/// The next start tries again.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}
