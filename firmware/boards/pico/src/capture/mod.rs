//! Captures: from an edge's stamp to a latch, and from a pulse's order to the pin.

pub mod edge_pins;
pub mod latch;
pub mod pio;
pub mod quadrature;
pub mod rate_limit;
pub mod rings;
pub mod stamps;
pub mod trigger_out;
