//! The host's port: a UART with a cable that the bench can pull.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::watch::Watch;
use umi_app::board::{Broken, CncInput, LinkRx, LinkTx};

use crate::HOST;

/// A cable.
pub struct Link {
    /// Counts plugging and pulling; even: plugged in.
    now: AtomicU32,
    /// What it was when the connection began that is being served.
    served: AtomicU32,
    changes: Watch<CriticalSectionRawMutex, (), ENDS>,
}

/// Receiving and sending.
const ENDS: usize = 2;

/// The cable.
pub static LINK: Link = Link {
    now: AtomicU32::new(0),
    served: AtomicU32::new(0),
    changes: Watch::new(),
};

impl Link {
    /// Plugs it in, or pulls it out. What is in it is lost, as on a cable.
    pub fn plug(&self, plugged: bool) {
        let was = self.now.load(Ordering::Relaxed);
        let step = if is_plugged(was) == plugged { 2 } else { 1 };
        self.now.store(was.wrapping_add(step), Ordering::Relaxed);
        HOST.clear();
        self.changes.sender().send(());
    }

    fn holds(&self) -> bool {
        self.now.load(Ordering::Relaxed) == self.served.load(Ordering::Relaxed)
    }

    /// Waits for a change behind the one that `done` sees.
    async fn wait(&self, done: impl Fn() -> bool) {
        // There are no more than two ends.
        let Some(mut changes) = self.changes.receiver() else {
            return core::future::pending().await;
        };
        while !done() {
            changes.changed().await;
        }
    }

    /// Waits until the connection that is being served is over.
    async fn broken(&self) {
        self.wait(|| !self.holds()).await;
    }
}

const fn is_plugged(count: u32) -> bool {
    count.is_multiple_of(2)
}

/// From the host.
pub struct LinkReceiver;

impl LinkRx for LinkReceiver {
    async fn connected(&mut self) {
        LINK.wait(|| is_plugged(LINK.now.load(Ordering::Relaxed)))
            .await;
        let now = LINK.now.load(Ordering::Relaxed);
        LINK.served.store(now, Ordering::Relaxed);
    }

    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken> {
        match select(LINK.broken(), HOST.read(buffer)).await {
            Either::First(()) => Err(Broken),
            Either::Second(CncInput::Bytes(count)) => Ok(count),
            // The ring holds the host rather than lose anything.
            Either::Second(CncInput::Lost(_) | CncInput::End) => Err(Broken),
        }
    }

    async fn gone(&mut self) {
        LINK.broken().await;
    }
}

/// To the host.
pub struct LinkTransmitter;

impl LinkTx for LinkTransmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        let send = async {
            for byte in bytes {
                HOST.write(*byte).await;
            }
        };
        match select(LINK.broken(), send).await {
            Either::First(()) => Err(Broken),
            Either::Second(()) => Ok(()),
        }
    }
}
