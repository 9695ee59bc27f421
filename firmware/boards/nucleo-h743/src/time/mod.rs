//! Time: the application's clock, and who waits for it.

pub mod alarms;
pub mod clock;
