//! Time: the microsecond timer and its alarms, the clock of the application, the tick.

pub mod alarms;
pub mod clock;
pub mod tick;
