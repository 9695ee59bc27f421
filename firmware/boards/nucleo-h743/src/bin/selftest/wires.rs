//! The eight jumpers: from a pin of port E that the application leaves alone to an input.

use crate::resources::{ENCODERS, PLAIN, SIGNALS, SKIP, TAKEN, TRIGGER};

/// One wire.
pub struct Jumper {
    /// The pin of port E that drives.
    pub from: u8,
    /// The input.
    pub to: (char, u8),
}

const fn jumper(from: u8, to: (char, u8)) -> Jumper {
    Jumper { from, to }
}

/// Signals A and B of X, which is a timer of 16 bits on the faster bus, and of Z, on the slower one;
/// skip and trigger of X, and those of the clock, which must come with them.
pub const JUMPERS: [Jumper; 8] = [
    jumper(10, ENCODERS[0].pin),
    jumper(12, ENCODERS[1].pin),
    jumper(0, ENCODERS[4].pin),
    jumper(3, ENCODERS[5].pin),
    jumper(8, SKIP[0].pin),
    jumper(15, TRIGGER[0].pin),
    jumper(1, SKIP[5].pin),
    jumper(7, TRIGGER[5].pin),
];

/// As bits of port E: A of the wired axes, and B.
pub const WIRED_A: u32 = 1 << JUMPERS[0].from | 1 << JUMPERS[2].from;
pub const WIRED_B: u32 = 1 << JUMPERS[1].from | 1 << JUMPERS[3].from;
/// The axes that are wired.
pub const WIRED_AXES: [usize; 2] = [0, 2];

// No driver is a pin that the plan or the module uses, and none is used twice.
const _: () = {
    let mut used = 0_u32;
    let mut at = 0;
    while at < SIGNALS.len() {
        used = with(used, SIGNALS[at].pin);
        at += 1;
    }
    at = 0;
    while at < PLAIN.len() {
        used = with(used, PLAIN[at]);
        at += 1;
    }
    at = 0;
    while at < TAKEN.len() {
        used = with(used, TAKEN[at]);
        at += 1;
    }
    at = 0;
    while at < JUMPERS.len() {
        let bit = 1 << JUMPERS[at].from;
        assert!(used & bit == 0, "a pin of port E has two uses");
        used |= bit;
        at += 1;
    }
};

/// With this pin, if it is of port E.
const fn with(used: u32, pin: (char, u8)) -> u32 {
    if pin.0 as u32 == 'E' as u32 {
        used | 1 << pin.1
    } else {
        used
    }
}
