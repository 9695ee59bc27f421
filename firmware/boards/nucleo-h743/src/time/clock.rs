//! Time for the application: the clock that latches are captured with.

use embassy_time::Timer;
use umi_app::board::Clock;
use umi_core::units::Micros;

use crate::axes;

/// The longest wait at once, as nobody waits for the end of time.
const LONGEST_US: u64 = 60_000_000;

/// The application's clock.
pub struct BoardClock;

impl Clock for BoardClock {
    fn now(&self) -> Micros {
        Micros(axes::now_ns() / 1_000)
    }

    async fn wait_until(&self, time: Micros) {
        loop {
            let left = time.0.saturating_sub(self.now().0);
            if left == 0 {
                return;
            }
            Timer::after_micros(left.min(LONGEST_US)).await;
        }
    }
}
