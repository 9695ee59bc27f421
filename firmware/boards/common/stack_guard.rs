//! The addresses below the stack of an Armv7-M: no access, by a region of the MPU.
//!
//! # Design
//!
//! The stack is at the beginning of its memory, at 0x2000_0000. What is below it answers as it likes: late, or as if all
//! were well. With the region a stack that overflows is a fault of the instruction that does it. It is longer than
//! any function's frame, so that none steps over it.
//!
//! The MPU is off while a fault is handled (HFNMIENA is 0), so it holds up nobody then.

use cortex_m::peripheral::MPU;

const STACK_END: u32 = 0x2000_0000;
/// 128 KB.
const BYTES_LOG2: u32 = 17;
/// Where the region begins.
const BEGIN: u32 = STACK_END - (1 << BYTES_LOG2);
/// MPU_RASR (Armv7-M, B3.5.9): enabled, so long, never executed; no access is AP = 0.
const ATTRIBUTES: u32 = 1 | (BYTES_LOG2 - 1) << 1 | 1 << 28;
/// MPU_CTRL: enabled, and what has no region stays as it is without an MPU (PRIVDEFENA).
pub const CONTROL: u32 = 0b101;

// A region begins at a multiple of its length. Below it ends the loader in the H743's own memory (RM0433, 2.3.2).
const _: () = assert!(BEGIN.is_multiple_of(1 << BYTES_LOG2) && BEGIN > 0x1FF1_FFFF);

/// Makes this region of the MPU the one below the stack. [`CONTROL`] has to follow, and barriers.
pub fn forbid_below_stack(mpu: &MPU, region: u32) {
    // SAFETY: nothing of an image is there, and outside of it all stays as it was.
    unsafe {
        mpu.rnr.write(region);
        mpu.rbar.write(BEGIN);
        mpu.rasr.write(ATTRIBUTES);
    }
}
