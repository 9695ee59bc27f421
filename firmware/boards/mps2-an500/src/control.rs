//! The control's port.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use umi_app::board::{Broken, CncInput, CncRx, CncTx};

use crate::CONTROL;

/// The control holds the board with its CTS line.
static HELD: AtomicBool = AtomicBool::new(false);
static RELEASED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The CTS line has changed.
pub fn hold(on: bool) {
    HELD.store(on, Ordering::Relaxed);
    if !on {
        RELEASED.signal(());
    }
}

/// From the control.
pub struct Receiver;

impl CncRx for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        CONTROL.read(buffer).await
    }
}

/// To the control.
pub struct Transmitter;

impl CncTx for Transmitter {
    async fn write(&mut self, byte: u8) -> Result<(), Broken> {
        while HELD.load(Ordering::Relaxed) {
            RELEASED.wait().await;
        }
        CONTROL.write(byte).await;
        Ok(())
    }
}
