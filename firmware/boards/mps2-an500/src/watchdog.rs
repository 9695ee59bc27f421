//! The watchdog: unfed it raises the NMI, which notes it and resets; if even that does not
//! run, the watchdog resets by itself as long after.

use umi_app::board;

use crate::chip::{CLOCK_HZ, Register, peripheral};

/// How long it waits: the application feeds it every 0.25 s, but QEMU's idle time runs on
/// while its machine does something else.
const PATIENCE_S: u32 = 20;
const _: () = assert!(PATIENCE_S as u64 * 1_000_000 > 4 * umi_app::FEED_INTERVAL_US);

const LOAD: Register = Register::new(peripheral::WATCHDOG, 0x000);
const CONTROL: Register = Register::new(peripheral::WATCHDOG, 0x008);
const LOCK: Register = Register::new(peripheral::WATCHDOG, 0xC00);

const UNLOCK: u32 = 0x1ACC_E551;
/// Interrupt, which also counts, and reset.
const ENABLE: u32 = 0b11;

/// The watchdog at work.
pub struct WatchdogTimer(());

impl WatchdogTimer {
    /// Starts it. It cannot be stopped by accident.
    pub fn start() -> Self {
        LOCK.write(UNLOCK);
        LOAD.write(PATIENCE_S * CLOCK_HZ);
        CONTROL.write(ENABLE);
        LOCK.write(0);
        Self(())
    }
}

impl board::Watchdog for WatchdogTimer {
    fn feed(&mut self) {
        LOCK.write(UNLOCK);
        // Counts down from there anew.
        LOAD.write(PATIENCE_S * CLOCK_HZ);
        LOCK.write(0);
    }
}
