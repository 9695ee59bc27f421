//! What a board provides: small traits. A driver behind them is the only code that a
//! board adds.
//!
//! All futures must be safe to drop before they are done: what was not returned
//! is not lost. Storage is [`umi_core::journal::Flash`], which is synchronous: it
//! is used by the measuring task alone, and neither receiving nor latching waits
//! for that task.

use umi_core::units::Micros;
use umi_protocol::job_error::Field;
use umi_protocol::latch::{LatchReport, Positions, TriggerOut, TriggerPulse, TriggerRefusal};
use umi_protocol::serial::{Cts, LineSettings};

use crate::intake::PIECE;

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
/// The port is set to 8 data bits and no parity, which takes 7E1, 7E2 and 7O1 as well. The
/// driver must always drain it; only the application holds the control.
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

    /// Sets the line, both directions of it, as soon as the last character has left: one that
    /// [`LineAbilities::check`] lets pass. What comes in this instant may be damaged.
    async fn set_line(&mut self, line: LineSettings);
}

/// How a board's line to the control can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineAbilities {
    /// The slowest, baud.
    pub least_baud: u32,
    /// The fastest, baud.
    pub most_baud: u32,
    /// It can send two stop bits. Any board takes them.
    pub two_stop_bits: bool,
    /// It has a wire for the control's CTS.
    pub cts: bool,
}

impl LineAbilities {
    /// Whether the line can be set like this.
    ///
    /// # Errors
    /// What the board does not have.
    pub fn check(&self, line: &LineSettings) -> Result<(), Field> {
        let bauds = self.least_baud..=self.most_baud;
        if !bauds.contains(&line.baud) {
            return Err(Field::LineBaud);
        }
        if !matches!(line.data_bits, 7 | 8) {
            return Err(Field::LineDataBits);
        }
        match line.stop_bits {
            1 => {}
            2 if self.two_stop_bits => {}
            _ => return Err(Field::LineStopBits),
        }
        if line.cts == Cts::Followed && !self.cts {
            return Err(Field::LineRtsCts);
        }
        Ok(())
    }
}

/// How long a driver waits for more before it hands bytes on that no line end has ended: two
/// characters, and not less than its clock can tell, microseconds.
#[must_use]
pub fn pause_us(line: &LineSettings) -> u64 {
    (2 * line.character_us()).max(5_000)
}

/// How many bytes a driver hands on at once, at most: a piece of the intake, and what comes in
/// a quarter of a second, so that who waits for a byte is not kept waiting on a slow line.
#[must_use]
pub fn most_at_once(line: &LineSettings) -> usize {
    let come = 250_000 / line.character_us();
    usize::try_from(come).map_or(PIECE, |come| come.clamp(1, PIECE))
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
    /// [`TriggerRefusal`]: nothing has changed.
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), TriggerRefusal>;

    /// Enables the laser, or not.
    ///
    /// # Errors
    /// [`Unsupported`]: nothing has changed.
    fn laser(&mut self, on: bool) -> Result<(), Unsupported>;
}

/// When a distance sensor is triggered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorTrigger {
    /// Never.
    Off,
    /// At a time interval.
    Every {
        /// From pulse to pulse.
        interval_us: u32,
    },
    /// Where an axis crosses lines, in both directions.
    Lines {
        /// Which axis, from 0.
        axis: u8,
        /// A line.
        origin_counts: i64,
        /// From line to line, encoder counts.
        interval_counts: u32,
    },
}

/// Outputs of the board to a control's inputs, from the station of a distance sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SensorLines {
    /// The control's skip input.
    pub skip: bool,
    /// The number of the last line that was answered is odd.
    pub parity: bool,
    /// It was carried out; of a measurement: there is a reading.
    pub is_ok: bool,
    /// There was no signal to measure, or an edge.
    pub has_no_signal: bool,
}

impl SensorLines {
    /// All are low.
    pub const REST: Self = Self {
        skip: false,
        parity: false,
        is_ok: false,
        has_no_signal: false,
    };
}

/// A distance sensor's port: a second serial line, its trigger and the outputs that go with it. A
/// board need not have one: then [`crate::App::sense`] is not run.
pub trait SensorPort: Axes {
    /// Waits for what the sensor sends: 8 data bits, no parity. The driver must always drain it.
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput;

    /// Sets the line's speed, baud.
    fn set_baud(&mut self, baud: u32);

    /// Triggers the sensor from now on like this, and not otherwise. Each pulse, or what the sensor
    /// sends back for it, is captured as a latch.
    ///
    /// # Errors
    /// [`TriggerRefusal`]: no pulses from now on.
    fn trigger(&mut self, when: SensorTrigger, pulse: TriggerPulse) -> Result<(), TriggerRefusal>;

    /// Shows this at the outputs from now on. What raises the skip line is at work already: no wait.
    fn show(&mut self, lines: SensorLines);
}

/// The board cannot do that: it has no such output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unsupported;

/// A button to teach by. A board need not have one: then [`crate::App::button`] is not run.
pub trait Button {
    /// Whether it is pressed, as its contact says, bounces and all.
    fn is_pressed(&mut self) -> bool;
}

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

#[cfg(test)]
mod tests {
    use umi_protocol::serial::{LineFamily, LineSpec};

    use super::*;

    /// A board refuses by name what it does not have, and takes what every board has.
    #[test]
    fn what_a_board_does_not_have_is_named() {
        let bare = LineAbilities {
            least_baud: 1200,
            most_baud: 115_200,
            two_stop_bits: false,
            cts: false,
        };
        let of = |text: LineSpec| bare.check(&text.settings());
        let any = LineSpec::default();
        assert_eq!(of(any), Ok(()));
        let fanuc = LineSpec {
            control: LineFamily::Fanuc,
            ..any
        };
        assert_eq!(of(fanuc), Err(Field::LineStopBits));
        for baud in [300, 230_400] {
            let line = LineSpec {
                baud: Some(baud),
                ..any
            };
            assert_eq!(of(line), Err(Field::LineBaud));
        }
        for (rts_cts, expected) in [(true, Err(Field::LineRtsCts)), (false, Ok(()))] {
            let line = LineSpec {
                rts_cts: Some(rts_cts),
                ..any
            };
            assert_eq!(of(line), expected);
        }
    }

    /// Pauses follow the speed: two characters, and on a slow line a byte waits a quarter of a
    /// second for others, at most.
    #[test]
    fn pauses_follow_the_speed() {
        for (baud, pause, most) in [
            (300, 73_334, 6),
            (1200, 18_334, 27),
            (4800, 5_000, PIECE),
            (115_200, 5_000, PIECE),
        ] {
            let line = LineSettings {
                baud,
                ..LineSettings::DEFAULT
            };
            assert_eq!(
                (pause_us(&line), most_at_once(&line)),
                (pause, most),
                "{baud}"
            );
            let waits = most as u64 * line.character_us();
            assert!(waits <= 250_000, "{baud}: {waits}");
        }
    }
}
