//! Pin multiplexing: the function of each pin, by number.

use embassy_rp::pac;

use crate::pins::{
    AXES, AXIS_A, CNC_CTS, CNC_RTS, CNC_RX, CNC_TX, INDEX, INDEXED, SKIP, TRIGGER_IN, TRIGGER_OUT,
    VBUS,
};

/// Numbers of functions, the same for all pins used here.
const UART: u8 = 2;
const SIO: u8 = 5;
const PIO1: u8 = 7;

/// What an input is if nobody drives it.
#[derive(Clone, Copy)]
enum Idle {
    Low,
    High,
    /// A divider on the module says it.
    Divided,
}

/// Connects all pins but those which drivers of the library are given.
pub fn connect() {
    for pin in AXIS_A {
        connected(pin, SIO, Idle::Low);
        connected(pin + 1, SIO, Idle::Low);
    }
    for axis in 0..INDEXED.min(AXES) {
        connected(INDEX + axis as u8, SIO, Idle::Low);
    }
    for pin in [SKIP, TRIGGER_IN] {
        connected(pin, SIO, Idle::Low);
    }
    // Read back too: the pulse is found in the samples of its pin.
    connected(TRIGGER_OUT, PIO1, Idle::Low);
    connected(VBUS, SIO, Idle::Divided);
    // A line that is not plugged in is idle, not broken.
    for pin in [CNC_TX, CNC_RX] {
        connected(pin, UART, Idle::High);
    }
    // Low is ready: a control without that line always is.
    connected(CNC_CTS, UART, Idle::Low);
    connected(CNC_RTS, UART, Idle::High);
}

/// Gives a pin its function; its input stays on.
fn connected(pin: u8, function: u8, idle: Idle) {
    pac::IO_BANK0
        .gpio(pin.into())
        .ctrl()
        .write(|w| w.set_funcsel(function));
    pac::PADS_BANK0.gpio(pin.into()).write(|w| {
        w.set_ie(true);
        w.set_schmitt(true);
        w.set_pde(matches!(idle, Idle::Low));
        w.set_pue(matches!(idle, Idle::High));
        #[cfg(feature = "rp2350")]
        w.set_iso(false);
    });
}
