//! The virtual board's clock: the real one, or one that moves only when told.

use std::time::{Duration, Instant};

use tokio::sync::watch;
use umi_app::board::Clock;
use umi_core::units::Micros;

/// Time as the virtual board sees it.
#[derive(Clone, Debug)]
pub enum VirtualClock {
    /// Real time since the start.
    Real(Instant),
    /// Moves when [`crate::VirtualBoard::advance`] says so.
    Steered(watch::Receiver<u64>),
}

impl Clock for VirtualClock {
    fn now(&self) -> Micros {
        match self {
            Self::Real(start) => {
                Micros(u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX))
            }
            Self::Steered(time) => Micros(*time.borrow()),
        }
    }

    async fn wait_until(&self, time: Micros) {
        match self {
            Self::Real(start) => match start.checked_add(Duration::from_micros(time.0)) {
                Some(moment) if time.0 != u64::MAX => {
                    tokio::time::sleep_until(moment.into()).await;
                }
                _ => std::future::pending().await,
            },
            Self::Steered(now) => {
                let reached = now.clone().wait_for(|now| *now >= time.0).await.is_ok();
                if !reached {
                    // Nobody moves the clock any more.
                    std::future::pending::<()>().await;
                }
            }
        }
    }
}
