//! The board's clock: the microsecond timer.

use embassy_time::{Instant, Timer};
use umi_app::board::Clock;
use umi_core::units::{Cycles, Micros};

use crate::resources::CYCLES_PER_US;

/// Microseconds since the chip started.
#[inline(always)]
pub fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// The same in cycles of the system clock: up to a microsecond behind.
#[inline(always)]
pub fn now_cycles() -> Cycles {
    // Four thousand years fit in.
    Cycles(now_us().wrapping_mul(CYCLES_PER_US.into()))
}

/// For the application.
pub struct BoardClock;

impl Clock for BoardClock {
    fn now(&self) -> Micros {
        Micros(now_us())
    }

    async fn wait_until(&self, time: Micros) {
        Timer::at(Instant::from_micros(time.0)).await;
    }
}
