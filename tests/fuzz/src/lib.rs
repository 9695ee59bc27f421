//! Fuzz targets: everything that reads bytes from outside.
//!
//! `cargo xtask fuzz` lets libFuzzer look for inputs by what they reach; what is worth keeping of these is in
//! `corpus`. The tests here try what is kept, and changes of it, without looking where they lead.

mod board;
pub mod targets;

#[cfg(test)]
mod tests;
