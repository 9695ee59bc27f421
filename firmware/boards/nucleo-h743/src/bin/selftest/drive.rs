//! The board's own hand on its inputs: by the jumpers, and where there is none, by the pins' pulls.

use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr, Pupdr};
use embassy_stm32::pac::{GPIOA, GPIOB, GPIOC, GPIOD, GPIOE};

use crate::resources::{AXES, CORE_HZ, ENCODERS, Signal};
use crate::wires::{JUMPERS, WIRED_A, WIRED_AXES, WIRED_B};

/// A and B of an axis that counts up.
const UP: [(bool, bool); 4] = [(false, false), (true, false), (true, true), (false, true)];

/// Lets the jumpers' pins drive, and all inputs be low.
pub fn start() {
    for jumper in &JUMPERS {
        let pin = usize::from(jumper.from % 16);
        GPIOE.bsrr().write(|w| w.set_br(pin, true));
        GPIOE
            .ospeedr()
            .modify(|w| w.set_ospeedr(pin, Ospeedr::HIGH_SPEED));
        GPIOE.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
    }
    for signal in &ENCODERS {
        set(signal, false);
    }
}

/// Sets the level of an input. One that has no jumper takes microseconds for it.
pub fn set(input: &Signal, high: bool) {
    match bit(input) {
        Some(bit) => wires(bit, high),
        None => pull(input.pin, high),
    }
}

/// The jumper's bit of port E, of an input that has one.
pub fn bit(input: &Signal) -> Option<u32> {
    let (port, number) = input.pin;
    let jumper = JUMPERS.iter().find(|jumper| jumper.to == (port, number))?;
    Some(1_u32.wrapping_shl(jumper.from.into()))
}

/// Sets the levels of these jumpers in the same cycle.
pub fn wires(bits: u32, high: bool) {
    let shift = if high { 0 } else { 16 };
    GPIOE.bsrr().write(|w| w.0 = bits.wrapping_shl(shift));
}

fn pull((port, number): (char, u8), high: bool) {
    let Some(port) = port_of(port) else { return };
    let pull = if high {
        Pupdr::PULL_UP
    } else {
        Pupdr::PULL_DOWN
    };
    port.pupdr()
        .modify(|w| w.set_pupdr(usize::from(number % 16), pull));
}

fn port_of(letter: char) -> Option<Gpio> {
    match letter {
        'A' => Some(GPIOA),
        'B' => Some(GPIOB),
        'C' => Some(GPIOC),
        'D' => Some(GPIOD),
        'E' => Some(GPIOE),
        _ => None,
    }
}

/// So long that a pull (50 kΩ at most) has moved a pin with 40 pF, and every filter has seen it.
pub fn settle() {
    const US: u32 = 15;
    // The core may take half as long as it is told.
    cortex_m::asm::delay(2 * US * (CORE_HZ / 1_000_000));
}

/// The encoders that are driven.
pub struct Encoders {
    phases: [u8; AXES],
}

impl Encoders {
    /// All inputs are low.
    pub const fn new() -> Self {
        Self { phases: [0; AXES] }
    }

    /// One count of an axis, up or down.
    pub fn step(&mut self, axis: usize, up: bool) {
        let mut axes = self.phases.iter_mut().zip(ENCODERS.as_chunks::<2>().0);
        let Some((phase, [a, b])) = axes.nth(axis) else {
            return;
        };
        let level = |phase: u8| UP.get(usize::from(phase % 4)).copied().unwrap_or_default();
        let before = level(*phase);
        *phase = match up {
            true => phase.wrapping_add(1),
            false => phase.wrapping_sub(1),
        };
        let after = level(*phase);
        if before.0 != after.0 {
            set(a, after.0);
        } else {
            set(b, after.1);
        }
    }

    /// So many turns of four counts of the wired axes at once, up. Both must be where A and B are low.
    #[inline(never)]
    pub fn run(&mut self, turns: u32) {
        for _ in 0..turns {
            wires(WIRED_A, true);
            wait();
            wires(WIRED_B, true);
            wait();
            wires(WIRED_A, false);
            wait();
            wires(WIRED_B, false);
            wait();
        }
    }

    /// Moves the wired axes up until A and B are low. Returns how far each has gone.
    pub fn align(&mut self) -> [u8; 2] {
        WIRED_AXES.map(|axis| {
            let phase = self.phases.get(axis).copied().unwrap_or(0) % 4;
            let left = (4 - phase) % 4;
            for _ in 0..left {
                self.step(axis, true);
                settle();
            }
            left
        })
    }
}

/// From one change to the next: at least twice what the filter and the decoder need.
fn wait() {
    cortex_m::asm::delay(2 * CORE_HZ / 10_000_000);
}
