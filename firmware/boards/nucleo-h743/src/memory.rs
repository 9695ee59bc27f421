//! What is in which memory (`memory.x`), and which of it the core caches.

#![allow(
    deprecated,
    reason = "what runs before `main` is in assembly, as no variable is there yet"
)]

use cortex_m::peripheral::{CPUID, MPU, SCB};

use crate::resources::MPU_NOTHING_THERE;
use crate::stack_guard;

/// What is in the DTCM gets its first values, as `cortex-m-rt` gives `.data` its own.
#[cortex_m_rt::pre_init]
unsafe fn fill_dtcm() {
    // SAFETY: the linker's script says where it is and where it comes from, in whole words.
    unsafe {
        core::arch::asm!(
            "ldr {to}, =__sdtcm",
            "ldr {end}, =__edtcm",
            "ldr {from}, =__sidtcm",
            "2: cmp {to}, {end}",
            "beq 3f",
            "ldr {word}, [{from}], #4",
            "str {word}, [{to}], #4",
            "b 2b",
            "3:",
            to = out(reg) _,
            end = out(reg) _,
            from = out(reg) _,
            word = out(reg) _,
            options(nostack),
        );
    }
}

/// Caches on, when nothing is read ahead where nothing is; and what the stack overflows is a fault from here on.
pub fn cache(mpu: &MPU, scb: &mut SCB, cpuid: &mut CPUID) {
    cortex_m::asm::dmb();
    // SAFETY: nothing of this image is in the regions, and outside of them all stays as it was.
    unsafe {
        mpu.rnr.write(0);
        mpu.rbar.write(0);
        mpu.rasr.write(MPU_NOTHING_THERE);
        stack_guard::forbid_below_stack(mpu, 1);
        mpu.ctrl.write(stack_guard::CONTROL);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    scb.enable_icache();
    scb.enable_dcache(cpuid);
}
