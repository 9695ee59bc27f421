//! The level of priority that measures: below the host's, above the thread, which proves sessions.
//!
//! # Design
//!
//! The RP2350 has an interrupt's priority left for it. The RP2040 has four, and all are taken. There
//! this level is made of the lowest: its interrupt does nothing but return to the thread, by a frame of
//! its own making and into the executor. So measuring goes on in the thread's mode, where every interrupt
//! comes as before, on top of whatever the thread was doing, whose own frame stays below. When nothing is
//! left to measure, a supervisor call drops what it has saved itself and returns by that frame. (The
//! kernel QK of the QP framework does so.) Meanwhile the interrupt is disabled: what wakes a task of this
//! level then stays pending, and comes behind the return.

use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_rp::interrupt;

static TASKS: InterruptExecutor = InterruptExecutor::new();

/// Starts the level; its priority is set.
pub fn start() -> SendSpawner {
    TASKS.start(interrupt::SWI_IRQ_4)
}

/// The RP2350's.
#[cfg(feature = "rp2350")]
#[cortex_m_rt::interrupt]
unsafe fn SWI_IRQ_4() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { TASKS.on_interrupt() }
}

#[cfg(not(feature = "rp2350"))]
mod of_the_thread {
    use core::arch::naked_asm;

    use embassy_rp::interrupt::Interrupt;

    use super::TASKS;

    /// The interrupt's bit in the registers that enable and disable.
    const BIT: u32 = 1 << Interrupt::SWI_IRQ_4 as u32;

    extern "C" fn measure() {
        // SAFETY: only by the interrupt that the executor was started with, and never while it is here: the
        // interrupt is disabled until this has returned.
        unsafe { TASKS.on_interrupt() }
    }

    /// Of the lowest priority, so what it has come upon is the thread, on the main stack.
    ///
    /// # Safety
    /// The processor calls it.
    #[unsafe(naked)]
    #[unsafe(no_mangle)]
    unsafe extern "C" fn SWI_IRQ_4() {
        naked_asm!(
            // NVIC_ICER: not again.
            "ldr r0, 3f",
            "ldr r1, 4f",
            "str r1, [r0]",
            // Before the return: one that waits is not taken there (Arm application note 321).
            "dsb",
            "isb",
            // A frame of eight words, of which only where to go on and the state count.
            "sub sp, #32",
            "ldr r0, 5f",
            "str r0, [sp, #24]",
            "ldr r0, 6f",
            "str r0, [sp, #28]",
            "bx lr",
            "2:",
            "bl {measure}",
            "svc 0",
            ".balign 4",
            "3: .word 0xE000E180",
            "4: .word {bit}",
            "5: .word 2b",
            // Thumb.
            "6: .word 0x01000000",
            measure = sym measure,
            bit = const BIT,
        )
    }

    /// The end of measuring.
    ///
    /// # Safety
    /// The processor calls it.
    #[unsafe(naked)]
    #[unsafe(no_mangle)]
    unsafe extern "C" fn SVCall() {
        naked_asm!(
            // What the call has saved: the thread's own frame is below.
            "add sp, #32",
            // NVIC_ISER.
            "ldr r0, 2f",
            "ldr r1, 3f",
            "str r1, [r0]",
            "bx lr",
            ".balign 4",
            "2: .word 0xE000E100",
            "3: .word {bit}",
            bit = const BIT,
        )
    }
}
