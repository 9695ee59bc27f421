//! The board's own hand on its inputs: their pins are outputs here, which the machines read back.

use embassy_rp::pac;

use crate::pins::{AXES, AXIS_A, INDEX, INDEXED, SKIP, TRIGGER_IN};
use crate::resources::CYCLES_PER_US;

/// A and B of an axis that counts up.
const UP: [u32; 4] = [0b00, 0b01, 0b11, 0b10];

/// Lets the pins drive, low.
pub fn start() {
    let mut pins = 1 << SKIP | 1 << TRIGGER_IN;
    for a in AXIS_A {
        pins |= 0b11 << (a % 30);
    }
    for index in 0..INDEXED as u8 {
        pins |= 1 << ((INDEX + index) % 30);
    }
    pac::SIO.gpio_out(0).value_clr().write_value(pins);
    pac::SIO.gpio_oe(0).value_set().write_value(pins);
}

/// Sets the level of an input.
pub fn set(pin: u8, high: bool) {
    let bit = 1_u32.wrapping_shl(pin.into());
    let out = pac::SIO.gpio_out(0);
    match high {
        true => out.value_set().write_value(bit),
        false => out.value_clr().write_value(bit),
    }
}

/// So long that every machine has seen what was driven.
pub fn settle() {
    cortex_m::asm::delay(CYCLES_PER_US);
}

/// The encoders that are driven.
pub struct Encoders {
    phases: [u8; AXES],
}

impl Encoders {
    /// All pins are low.
    pub const fn new() -> Self {
        Self { phases: [0; AXES] }
    }

    /// One count of an axis, up or down.
    pub fn step(&mut self, axis: usize, up: bool) {
        let mut axes = self.phases.iter_mut().zip(AXIS_A);
        let Some((phase, a)) = axes.nth(axis) else {
            return;
        };
        let level = |phase: u8| UP.get(usize::from(phase % 4)).copied().unwrap_or(0);
        let before = level(*phase);
        *phase = match up {
            true => phase.wrapping_add(1),
            false => phase.wrapping_sub(1),
        };
        let changed = (before ^ level(*phase)).wrapping_shl(a.into());
        pac::SIO.gpio_out(0).value_xor().write_value(changed);
    }

    /// Twice so many counts of all axes at once, up, as fast as the loop is: all signals A change,
    /// then all B. Every axis must be where A and B are alike.
    #[inline(never)]
    pub fn run(&mut self, pairs: u32) {
        let a = AXIS_A.iter().fold(0, |pins, a| pins | 1 << (a % 30));
        let xor = pac::SIO.gpio_out(0).value_xor();
        for _ in 0..pairs {
            xor.write_value(a);
            wait();
            xor.write_value(a << 1);
            wait();
        }
        let turned = (pairs % 2 * 2) as u8;
        for phase in &mut self.phases {
            *phase = phase.wrapping_add(turned);
        }
    }
}

/// With what the loop takes itself, more than a sample's ten cycles from one change to the next.
#[inline(always)]
fn wait() {
    // SAFETY: it does nothing.
    unsafe {
        core::arch::asm!(
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            options(nomem, nostack, preserves_flags)
        );
    }
}
