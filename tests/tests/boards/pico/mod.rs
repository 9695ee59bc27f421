//! The board's image on an emulated Pico, with real waveforms at its pins: what it promises beyond what
//! all boards have in common.
//!
//! The long forms are run by `cargo test -p umi-tests --test boards pico:: -- --ignored --nocapture`.

mod boot_loader;
mod cache;
mod faults;
mod figures;
mod inputs;
mod load;
mod owner;
mod pull;
mod selftest;
mod serial;
mod usb;
