//! What the tests of this crate need of a board.

extern crate std;

use core::cell::{Cell, RefCell};
use std::rc::Rc;
use std::vec::Vec;

use core::future::poll_fn;
use core::task::Poll;

use umi_core::journal::{Flash, Geometry};
use umi_core::units::Micros;
use umi_protocol::latch::{LatchCause, LatchReport};

use crate::board::Clock;

/// A clock that is set by hand. It wakes nobody: poll.
#[derive(Default)]
pub struct Hand(Cell<u64>);

impl Hand {
    pub fn set(&self, now_us: u64) {
        self.0.set(now_us);
    }
}

impl Clock for Hand {
    fn now(&self) -> Micros {
        Micros(self.0.get())
    }

    async fn wait_until(&self, time: Micros) {
        poll_fn(|_| match self.now() >= time {
            true => Poll::Ready(()),
            false => Poll::Pending,
        })
        .await;
    }
}

/// A storage that does not answer.
#[derive(Debug)]
pub struct NoFlash;

impl Flash for NoFlash {
    type Error = ();

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: 4,
            sector_size: 4096,
            write_size: 1,
            page_size: 1,
        }
    }

    fn read(&mut self, _: u32, _: &mut [u8]) -> Result<(), ()> {
        Err(())
    }

    fn program(&mut self, _: u32, _: &[u8]) -> Result<(), ()> {
        Err(())
    }

    fn erase(&mut self, _: u32) -> Result<(), ()> {
        Err(())
    }
}

/// A storage in memory. Clones share it: that is a restart.
#[derive(Clone, Debug)]
pub struct RamFlash(Rc<RefCell<Vec<u8>>>);

impl RamFlash {
    const GEOMETRY: Geometry = Geometry {
        sectors: 4,
        sector_size: 4096,
        write_size: 1,
        page_size: 256,
    };

    pub fn new() -> Self {
        Self(Rc::new(RefCell::new(std::vec![0xFF; 4 * 4096])))
    }

    /// What its cells read as.
    pub fn bytes(&self) -> Vec<u8> {
        self.0.borrow().clone()
    }

    /// One whose cells read so.
    pub fn of(bytes: &[u8]) -> Self {
        Self(Rc::new(RefCell::new(bytes.to_vec())))
    }
}

impl Flash for RamFlash {
    type Error = ();

    fn geometry(&self) -> Geometry {
        Self::GEOMETRY
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), ()> {
        into.copy_from_slice(&self.0.borrow()[addr as usize..][..into.len()]);
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), ()> {
        for (cell, byte) in self.0.borrow_mut()[addr as usize..].iter_mut().zip(bytes) {
            *cell &= byte;
        }
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), ()> {
        self.0.borrow_mut()[sector as usize * 4096..][..4096].fill(0xFF);
        Ok(())
    }
}

/// A capture of the probe.
pub fn skip(number: u32) -> LatchReport {
    report(LatchCause::Skip, number)
}

/// A capture of a scanner's trigger.
pub fn trigger(number: u32) -> LatchReport {
    report(LatchCause::Trigger, number)
}

/// The capture of this number, when they come every 0.1 ms and the axes move.
pub fn report(cause: LatchCause, number: u32) -> LatchReport {
    let n = i64::from(number);
    LatchReport {
        number,
        cause,
        counts: [10 * n, -3 * n].into_iter().collect(),
        t_ns: 100_000 * u64::from(number),
        missed: 0,
    }
}
