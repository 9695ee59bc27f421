//! What a board provides: small traits. A driver behind them is the only code that a
//! board adds.
//!
//! All futures must be safe to drop before they are done: what was not returned
//! is not lost. Storage is [`umi_core::journal::Flash`], which is synchronous: it
//! is used by the measuring task alone, and neither receiving nor latching waits
//! for that task.

use umi_core::units::Micros;
use umi_protocol::latch::{LatchReport, Positions, TriggerOut};

/// What came in on the control's port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CncInput {
    /// This many bytes are in the buffer: 8 data bits each, parity not removed.
    Bytes(usize),
    /// The driver lost this many bytes, at least, before it could store them.
    Lost(u32),
    /// The input has ended: a captured file. Never on a machine.
    End,
}

/// Receives from the control.
///
/// The port is set to 8 data bits, no parity, 1 stop bit, which takes 7E1, 7E2 and
/// 7O1 as well. The driver must always drain it; only the application holds the control.
pub trait CncRx {
    /// Waits for input.
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput;
}

/// Sends to the control.
pub trait CncTx {
    /// Sends one byte and returns when it has left for the line, with at most one
    /// more behind it. A control that says XOFF takes ten characters after it at
    /// most, so nothing may wait in a deeper FIFO or a DMA buffer.
    ///
    /// # Errors
    /// [`Broken`]: the byte will never leave.
    async fn write(&mut self, byte: u8) -> Result<(), Broken>;
}

/// The line is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Broken;

/// Receives from the host.
pub trait LinkRx {
    /// Waits until a host is connected.
    async fn connected(&mut self);

    /// Waits for bytes and returns how many came, at least one.
    ///
    /// # Errors
    /// [`Broken`]: the host is gone.
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken>;

    /// Waits until the host is gone. What it has sent before is kept for [`Self::read`].
    async fn gone(&mut self);
}

/// Sends to the host.
pub trait LinkTx {
    /// Sends all bytes. May wait as long as the host does not read.
    ///
    /// # Errors
    /// [`Broken`]: the host is gone.
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken>;
}

/// Captures the axes and the clock at an edge, in hardware.
pub trait LatchSource {
    /// Waits for the next capture. Captures that come while nobody waits are kept by the
    /// driver; what it cannot keep is counted in `missed` of the next one, or told by one
    /// without counts if there is no next.
    async fn next(&mut self) -> LatchReport;
}

/// The axes' encoders.
pub trait Axes {
    /// Where the axes are at one instant, which is now.
    fn positions(&mut self) -> Positions;
}

/// Outputs to a scanner. Off until asked for.
pub trait Scanner {
    /// Sends trigger pulses from now on as asked, and no others. Every pulse is
    /// captured as a latch.
    ///
    /// # Errors
    /// [`Unsupported`]: nothing has changed.
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), Unsupported>;

    /// Enables the laser, or not.
    ///
    /// # Errors
    /// [`Unsupported`]: nothing has changed.
    fn laser(&mut self, on: bool) -> Result<(), Unsupported>;
}

/// The board cannot do that: it has no such output or axis, or cannot keep that
/// interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unsupported;

/// Resets the board unless it is fed often enough: at least every
/// [`crate::FEED_INTERVAL_US`] and whatever an erasure of the storage takes.
pub trait Watchdog {
    /// All is well.
    fn feed(&mut self);
}

/// What the board shows at its outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lights {
    /// A setup is under way.
    pub busy: bool,
    /// The latest verdict is OK. Off while a setup is under way.
    pub ok: bool,
    /// The latest verdict is NG. Off while a setup is under way.
    pub ng: bool,
    /// The storage has refused something: no correction until it works again. For the
    /// status light.
    pub trouble: bool,
}

/// Outputs to the machine: verdict and activity.
pub trait Outputs {
    /// Shows this from now on.
    fn show(&mut self, lights: Lights);
}

/// The board's clock.
pub trait Clock {
    /// Time since the board started; never goes back.
    fn now(&self) -> Micros;

    /// Waits until it is at least this time.
    async fn wait_until(&self, time: Micros);
}
