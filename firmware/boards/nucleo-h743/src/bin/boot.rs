//! The boot loader of a Nucleo-H743: it verifies an image and starts it. **It has never been run.**
//!
//! ```text
//! reset ─► which image counts ─► verified by the maker's key: its SHA-512, signature, version, counter
//!                                  ├── right ─► it runs; on trial with the watchdog before it
//!                                  └── wrong ─► the other one, if that is right and not older; else blink
//! ```
//!
//! What it decides stands in [`umi_core::trust::access::update::slots`], which images and virtual boards share. It writes
//! only which image counts, never an image. The clock stays as it is behind a reset, 64 MHz: the image sets it.
#![no_std]
#![no_main]

#[path = "../storage/chip_flash.rs"]
mod chip_flash;
#[path = "../../../common/fault_entry.rs"]
mod fault_entry;
#[path = "../storage/images.rs"]
mod images;
#[path = "../memory.rs"]
mod memory;
#[path = "../ram_note.rs"]
mod ram_note;
#[path = "../resources.rs"]
#[allow(
    dead_code,
    clippy::indexing_slicing,
    reason = "the application uses the rest; in a constant the compiler finds what is outside"
)]
mod resources;
#[path = "../../../common/stack_guard.rs"]
mod stack_guard;

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{GPIOB, RCC};
use embassy_stm32::peripherals::IWDG1;
use embassy_stm32::wdg::IndependentWatchdog;

/// An image on trial that does not take up the watchdog within this resets the board, which goes back. It looks through
/// the journal and may erase a sector before: as long as the chip can count, nearly.
const TRIAL_US: u32 = 30_000_000;

/// LD3, the red one: PB14.
const LIGHT: usize = 14;

#[cortex_m_rt::entry]
fn main() -> ! {
    // It is the first time.
    let Some(mut core) = cortex_m::Peripherals::take() else {
        SCB::sys_reset()
    };
    memory::cache(&core.MPU, &mut core.SCB, &mut core.CPUID);
    let mut slots = images::open(|area| area).unwrap_or_else(|_| images::stateless());
    // Where a trial cannot be kept it would never end: none begins.
    let started = slots.start().unwrap_or_else(|_| slots.start_confirmed());
    let Some(vectors) = images::vectors(started.place) else {
        blink()
    };
    images::leave_reverted(started.reverted);
    if started.on_trial {
        // SAFETY: nobody else has it here.
        IndependentWatchdog::new(unsafe { IWDG1::steal() }, TRIAL_US).unleash();
    }
    // As behind a reset: the image enables its own.
    core.SCB.disable_dcache(&mut core.CPUID);
    core.SCB.disable_icache();
    // SAFETY: an image that the maker has signed for this place, as it is at a reset: nothing here has let an
    // interrupt, and its vectors are the table of the next one.
    unsafe {
        core.SCB.vtor.write(vectors);
        cortex_m::asm::bootload(core::ptr::with_exposed_provenance(vectors as usize))
    }
}

/// Three short ones, again and again: nothing here may run.
fn blink() -> ! {
    RCC.ahb4enr().modify(|w| w.set_gpioben(true));
    // The clock is there two cycles later (RM0433, RCC): a look takes them.
    let _ = RCC.ahb4enr().read();
    GPIOB.moder().modify(|w| w.set_moder(LIGHT, Moder::OUTPUT));
    let set = |is_on: bool| {
        GPIOB.bsrr().write(|w| match is_on {
            true => w.set_bs(LIGHT, true),
            false => w.set_br(LIGHT, true),
        });
    };
    loop {
        for _ in 0..3 {
            set(true);
            cortex_m::asm::delay(12_000_000);
            set(false);
            cortex_m::asm::delay(12_000_000);
        }
        cortex_m::asm::delay(64_000_000);
    }
}

/// The next start tries again: from `fault_entry`.
#[unsafe(no_mangle)]
extern "C" fn on_fault(_: u32) -> ! {
    SCB::sys_reset()
}

/// The next start tries again.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    SCB::sys_reset()
}
