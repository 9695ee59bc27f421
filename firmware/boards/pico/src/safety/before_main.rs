//! What must be done before any code of ours runs.
//!
//! `embassy-rp` does it in its feature `rt`, which brings interrupt handlers for pins and for the
//! second core too. Nothing here uses those, and they can panic: so the feature is off, and this
//! is what stays of it.

#![allow(
    deprecated,
    reason = "it touches registers only, and no variable, which is not set up yet"
)]

use embassy_rp::pac;

/// Frees the lock that the critical section takes, and stops the second core: a reset of the core
/// alone leaves both as they were (RP2040 data sheet, 2.13; as `embassy-rp` does it).
#[cortex_m_rt::pre_init]
unsafe fn free_what_a_reset_leaves() {
    #[cfg(not(feature = "rp2350"))]
    {
        use pac::psm::regs::{FrceOff, FrceOn};

        // A stage resets those behind it: SIO comes before this core, which is held up meanwhile.
        let mut on = FrceOn::default();
        on.set_proc0(true);
        let mut off = FrceOff::default();
        off.set_sio(true);
        off.set_proc1(true);
        force_on(on);
        force_off(off);
        // In this order: the other one would reset this core.
        force_off(FrceOff::default());
        force_on(FrceOn::default());
    }
    #[cfg(feature = "rp2350")]
    {
        use pac::psm::regs::FrceOff;

        // Its PSM cannot hold this core up: the lock is freed by itself.
        pac::SIO.spinlock(31).write_value(1);
        let mut off = FrceOff::default();
        off.set_proc1(true);
        force_off(off);
        force_off(FrceOff::default());
        // Memory is for both cores: atomics of one are seen by the other (ACTLR.EXTEXCLALL).
        // SAFETY: the register is there, and nothing else runs yet.
        unsafe {
            (*cortex_m::peripheral::ICB::PTR)
                .actlr
                .modify(|w| w | 1 << 29)
        };
        // Below the stack the flash's addresses end: a write there may be a fault that comes late. The core's own
        // limit is one at once (Armv8-M, B3.21).
        // SAFETY: the stack is at its top, far from its end.
        unsafe {
            core::arch::asm!(
                "ldr {end}, =_stack_end",
                "msr msplim, {end}",
                end = out(reg) _,
                options(nostack),
            );
        }
    }
}

#[cfg(not(feature = "rp2350"))]
fn force_on(stages: pac::psm::regs::FrceOn) {
    pac::PSM.frce_on().write_value(stages);
    while pac::PSM.frce_on().read() != stages {}
}

fn force_off(stages: pac::psm::regs::FrceOff) {
    pac::PSM.frce_off().write_value(stages);
    while pac::PSM.frce_off().read() != stages {}
}
