//! Reset: its cause, and the board's last act when it cannot go on.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use embassy_stm32::pac::RCC;
use umi_protocol::message::ResetReason;

/// Says that a panic was the reason. Any other value, as RAM has after power-up, does not.
const PANICKED: u32 = 0x554D_4921;

/// Outside of what is cleared at the start.
#[unsafe(link_section = ".uninit.panicked")]
static NOTE: AtomicU32 = AtomicU32::new(0);

/// Why the board started, by the flags of RM0433, 8.7.37 (RCC_RSR), of which several are
/// set at once: the pin is pulled by every reset. Once: the flags are cleared.
pub fn reason() -> ResetReason {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    let panicked = NOTE.swap(0, Ordering::Relaxed) == PANICKED;
    if flags.porrstf() {
        ResetReason::PowerOn
    } else if flags.borrstf() {
        ResetReason::BrownOut
    } else if flags.iwdg1rstf() || flags.wwdg1rstf() {
        ResetReason::Watchdog
    } else if flags.sftrstf() && panicked {
        ResetReason::Panic
    } else if flags.sftrstf() {
        ResetReason::Software
    } else if flags.pinrstf() {
        ResetReason::Pin
    } else {
        ResetReason::Unknown
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {}:{}", place.file(), place.line());
    }
    NOTE.store(PANICKED, Ordering::Relaxed);
    SCB::sys_reset()
}
