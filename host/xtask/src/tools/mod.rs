//! Programs of others that several tasks use.

pub mod browser;
pub mod emulators;
pub mod python;
pub mod readers;
pub mod referee;
pub mod spelling;
