//! Boards: the same behaviour on the virtual one, in QEMU and on the emulated Pico.
//!
//! What all of them are asked is in [`conformance`]; the others are about one of them.

mod chatter;
mod conformance;
mod owner;
mod pico;
mod pico_cache;
mod pico_captures;
mod pico_faults;
mod pico_figures;
mod pico_load;
mod pico_owner;
mod pico_pulses;
mod pico_scan;
mod pico_selftest;
mod pico_serial;
mod pico_stack;
mod pico_update;
mod pico_usb;
mod pico_watchdog;
mod point_sensor;
mod qemu;
mod qemu_figures;
mod speeds;
mod virtual_board;
