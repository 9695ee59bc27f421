//! The control's port.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use umi_app::board::{Broken, CncInput, CncRx, CncTx, LineAbilities};
use umi_protocol::serial::{LEAST_BAUD, LineSettings, MOST_BAUD};

use crate::CONTROL;

/// How the line can be set: this UART sends one stop bit, always. The bench has the CTS.
pub const ABILITIES: LineAbilities = LineAbilities {
    least_baud: LEAST_BAUD,
    most_baud: MOST_BAUD,
    two_stop_bits: false,
    cts: true,
};

/// As many characters as come.
const ALL: u32 = u32::MAX;
/// So many characters does the control take yet, by its CTS line.
static CLEAR: AtomicU32 = AtomicU32::new(ALL);
static CHANGED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The CTS line is clear for so many characters; none: as many as come.
pub fn clear(characters: Option<u32>) {
    CLEAR.store(characters.unwrap_or(ALL), Ordering::Relaxed);
    CHANGED.signal(());
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
        while CLEAR.load(Ordering::Relaxed) == 0 {
            CHANGED.wait().await;
        }
        CONTROL.write(byte).await;
        let left = CLEAR.load(Ordering::Relaxed);
        if left != ALL {
            CLEAR.store(left.saturating_sub(1), Ordering::Relaxed);
        }
        Ok(())
    }
    async fn set_line(&mut self, line: LineSettings) {
        CONTROL.set_baud(line.baud);
    }
}
