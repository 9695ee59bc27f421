//! Pin numbers, as wired in the table of this board's README.
//!
//! # Design
//!
//! The two signals of an axis stand side by side, because the decoder reads them as a
//! number of two bits. The inputs whose edges are looked for in the samples stand side
//! by side for the same reason: index marks, laser and the trigger output, whose own
//! level is read back.
//!
//! # Limitations
//!
//! Four axes: the RP2040 has eight state machines, and every axis takes one.

pub mod mux;

/// Axes.
pub const AXES: usize = 4;
/// Axes with an index mark.
pub const INDEXED: usize = 3;

/// To the control.
pub const CNC_TX: u8 = 0;
/// From the control.
pub const CNC_RX: u8 = 1;
/// The control's readiness, where it tells it by a line.
pub const CNC_CTS: u8 = 2;
/// Our readiness.
pub const CNC_RTS: u8 = 3;

/// Signal A of each axis; B is the pin above it.
pub const AXIS_A: [u8; AXES] = [8, 10, 12, 14];

/// The probe's skip signal: captures at both edges.
pub const SKIP: u8 = 16;
/// A scanner's trigger: captures at its rising edge.
pub const TRIGGER_IN: u8 = 17;
/// Index mark of the first axis; those of the others are above it.
pub const INDEX: u8 = 18;
/// Enables a scanner's laser. High is on.
pub const LASER: u8 = 21;
/// Trigger pulses to a scanner. High is a pulse.
pub const TRIGGER_OUT: u8 = 22;

/// High while the USB plug has 5 V: on the module, not brought out.
pub const VBUS: u8 = 24;

/// Laser, and the outputs OK, NG and busy: what is off whenever the board cannot go on. One bit
/// each.
pub const SWITCHED: u32 = 1 << LASER | 1 << 26 | 1 << 27 | 1 << 28;

/// First of the pins that are sampled for edges.
pub const WATCHED: u8 = INDEX;
/// So many pins.
pub const WATCHED_COUNT: u8 = TRIGGER_OUT - INDEX + 1;

/// Pins of outputs and of the journal's memory, which the drivers are given by name.
const NAMED: [u8; 8] = [4, 5, 6, 7, 25, 26, 27, 28];

#[allow(
    clippy::indexing_slicing,
    reason = "by the compiler: an index out of bounds does not compile"
)]
const _: () = {
    let mut used = 0_u32;
    let mut axis = 0;
    while axis < AXES {
        assert!(
            AXIS_A[axis].is_multiple_of(2),
            "a decoder reads an even pin and the one above"
        );
        used = take(used, AXIS_A[axis]);
        used = take(used, AXIS_A[axis] + 1);
        axis += 1;
    }
    let mut index = 0;
    while index < INDEXED {
        used = take(used, INDEX + index as u8);
        index += 1;
    }
    let mut named = 0;
    while named < NAMED.len() {
        used = take(used, NAMED[named]);
        named += 1;
    }
    used = take(used, CNC_TX);
    used = take(used, CNC_RX);
    used = take(used, CNC_CTS);
    used = take(used, CNC_RTS);
    used = take(used, SKIP);
    used = take(used, TRIGGER_IN);
    used = take(used, LASER);
    used = take(used, TRIGGER_OUT);
    used = take(used, VBUS);
    assert!(
        used & 0b1111_1111 == 0b1111_1111,
        "UART0 and SPI0 fill the first eight"
    );
    assert!(
        WATCHED_COUNT == 5,
        "the program that looks for edges takes five bits"
    );
};

/// Adds a pin to those in use.
const fn take(used: u32, pin: u8) -> u32 {
    assert!(pin < 30, "the package has 30");
    assert!(used & (1 << pin) == 0, "a pin is used twice");
    used | 1 << pin
}

/// Whether the bit of this pin is set; of a pin from 32 on, that of another. No interrupt has a
/// way to a panic by it.
pub const fn is_among(pin: u8, pins: u32) -> bool {
    pins.wrapping_shr(pin as u32) & 1 == 1
}
