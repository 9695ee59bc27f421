//! A virtual machine tool.

mod wires;

pub use wires::{Unwired, Wires};
