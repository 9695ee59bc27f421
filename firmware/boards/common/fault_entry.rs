//! What the core runs first at any fault, on every board: with a stack of its own.
//!
//! # Design
//!
//! A stack that overflows is a fault, too, and then there is no stack for the handler: a function of Rust begins by
//! saving registers, which is a fault within a fault, and the core stops with the laser on. So the vector is assembly
//! that reads and writes nothing by the stack's pointer until that has been set to the stack's top. What was there is
//! over: nothing returns from here.
//!
//! Every stack is at the beginning of its memory (`memory.x` of each board), where an overflow is a fault at once, and not
//! at a variable.
//!
//! # Limitations
//!
//! The core saves eight words before it comes here. Where these have no memory, an Armv7-M and an Armv8-M come here all the
//! same. Whether a Cortex-M0+ does, or stops, is not said clearly enough to rest on: where it stops, the watchdog of the board ends it.

use core::arch::naked_asm;

unsafe extern "C" {
    /// The image's own: outputs low first, then a note, then a reset. With the address of the instruction that the
    /// core could not do, or zero where the stack has overflowed.
    fn on_fault(address: u32) -> !;
}

/// Of every fault.
///
/// # Safety
/// The processor calls it.
#[unsafe(naked)]
#[unsafe(no_mangle)]
#[unsafe(link_section = ".HardFault.user")]
unsafe extern "C" fn HardFault() {
    naked_asm!(
        // A frame is whole where all of it is in the stack. At its very end it is none: there an Armv8-M leaves the
        // pointer that its limit has stopped.
        "movs r0, #0",
        "mrs r2, msp",
        "ldr r1, 3f",
        "cmp r2, r1",
        "bls 2f",
        "ldr r1, 4f",
        "mov r3, r1",
        "subs r3, #32",
        "cmp r2, r3",
        "bhi 2f",
        "ldr r0, [r2, #24]",
        "2:",
        "ldr r1, 4f",
        "msr msp, r1",
        // FPCCR: registers of the floating point that were to be saved later would go to where there is no stack.
        ".if {has_fpu}",
        "ldr r1, 5f",
        "movs r2, #0",
        "str r2, [r1]",
        ".endif",
        "bl {on_fault}",
        ".balign 4",
        "3: .word _stack_end",
        "4: .word _stack_start",
        "5: .word 0xE000EF34",
        on_fault = sym on_fault,
        has_fpu = const cfg!(target_abi = "eabihf") as u32,
    )
}
