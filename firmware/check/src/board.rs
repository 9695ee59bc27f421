//! A board without hardware. Its drivers answer at once, with what the compiler cannot
//! know: what comes out of a black box could be anything, and what goes in is used.

use core::convert::Infallible;
use core::hint::black_box;

use umi_app::board::{
    Axes, Broken, Clock, CncInput, CncRx, CncTx, LatchSource, Lights, LinkRx, LinkTx, Outputs,
    Scanner, Unsupported, Watchdog,
};
use umi_core::journal::{Flash, Geometry};
use umi_core::units::Micros;
use umi_protocol::latch::{LatchCause, LatchReport, Positions, TriggerOut};

/// The control's port.
pub struct Cnc;

impl CncRx for Cnc {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        black_box(buffer);
        black_box(CncInput::Bytes(0))
    }
}

impl CncTx for Cnc {
    async fn write(&mut self, byte: u8) -> Result<(), Broken> {
        black_box(byte);
        black_box(Ok(()))
    }
}

/// The host's port.
pub struct Link;

impl LinkRx for Link {
    async fn connected(&mut self) {}

    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Broken> {
        black_box(buffer);
        black_box(Ok(0))
    }
}

impl LinkTx for Link {
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        black_box(bytes);
        black_box(Ok(()))
    }
}

/// The latches of the axes.
pub struct Latches;

impl LatchSource for Latches {
    async fn next(&mut self) -> LatchReport {
        black_box(LatchReport {
            number: 0,
            cause: LatchCause::Skip,
            counts: Default::default(),
            t_ns: 0,
            missed: 0,
        })
    }
}

/// The axes and a scanner.
pub struct Station;

impl Axes for Station {
    fn positions(&mut self) -> Positions {
        black_box(Positions::default())
    }
}

impl Scanner for Station {
    fn trigger_out(&mut self, when: TriggerOut) -> Result<(), Unsupported> {
        black_box(when);
        black_box(Ok(()))
    }

    fn laser(&mut self, on: bool) -> Result<(), Unsupported> {
        black_box(on);
        black_box(Ok(()))
    }
}

/// The watchdog.
pub struct Dog;

impl Watchdog for Dog {
    fn feed(&mut self) {}
}

/// The outputs to the machine.
pub struct Lamps;

impl Outputs for Lamps {
    fn show(&mut self, lights: Lights) {
        black_box(lights);
    }
}

/// The clock.
pub struct Time;

impl Clock for Time {
    fn now(&self) -> Micros {
        Micros(black_box(0))
    }

    async fn wait_until(&self, time: Micros) {
        black_box(time);
    }
}

/// A storage area.
pub struct Memory;

impl Flash for Memory {
    type Error = Infallible;

    fn geometry(&self) -> Geometry {
        black_box(Geometry {
            sectors: 2,
            sector_size: 128 * 1024,
            write_size: 32,
            page_size: 32,
        })
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Infallible> {
        black_box((addr, into));
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Infallible> {
        black_box((addr, bytes));
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), Infallible> {
        black_box(sector);
        Ok(())
    }
}
