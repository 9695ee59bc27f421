//! The UARTs and what is on them: the control, the host, a distance sensor, the bench.

pub mod bench;
pub mod control;
pub mod link;
pub mod sensor;
pub mod uart;
