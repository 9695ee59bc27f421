//! What comes and goes at the pins of the emulated Pico: encoders, latches, pulses, and a scan of them all.

mod captures;
mod counts;
mod overload;
mod pulses;
mod scan;
