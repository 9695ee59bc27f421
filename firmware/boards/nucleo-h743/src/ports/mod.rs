//! What hangs on wires: the control, a distance sensor, the host.

pub mod control;
pub mod sensor;
pub mod usb;
