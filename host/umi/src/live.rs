//! A virtual board in front of a virtual machine whose time is that of the wall, so
//! that others can be its host: `umi watch`, `umi events`.
//!
//! The machine computes a motion at once and tells of it with its times; here it is
//! made to wait for them.

use std::sync::Arc;
use std::time::Duration;

use umi_core::units::Micros;
use umi_protocol::job::Job;
use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_virtual::board::Time;
use umi_virtual::serve::{Place, Port};
use umi_virtual::{Config, VirtualBoard};

use crate::failure::Failure;
use crate::jobfile;
use crate::link::Client;

/// How often the board is told of its axes, at rest and in motion.
pub const SAMPLING: Duration = Duration::from_millis(5);

/// A machine that is late by more has been held up: its clock is put right.
const LATE_US: u64 = 100_000;

/// The board, and the machine's time against its clock.
pub struct Live {
    board: Arc<VirtualBoard>,
    /// Where its host's port is.
    pub address: String,
    /// The board's clock when the machine's shows 0.
    offset_us: u64,
    counts: Option<[i64; 3]>,
    skips: u32,
}

impl Live {
    /// Switches a new board on, gives it a job and opens a port for its host.
    ///
    /// # Errors
    /// The board cannot be started or refuses the job; the port cannot be opened.
    pub fn new(job: &Job, character: Duration, usb: &Place) -> Result<Self, Failure> {
        let trouble = |error| Failure::trouble("virtual_board", error);
        let config = Config {
            time: Time::Real,
            character,
            ..Config::default()
        };
        let board = Arc::new(VirtualBoard::start(config).map_err(trouble)?);
        Client::new(Box::new(board.connect()))?
            .set_job(job)?
            .map_err(|error| jobfile::refusal(&error))?;
        let port = Port::open(usb).map_err(trouble)?;
        let address = port.address.clone();
        port.serve_host(&board);
        Ok(Self {
            offset_us: board.now().0,
            board,
            address,
            counts: None,
            skips: 0,
        })
    }

    /// The board itself.
    #[must_use]
    pub fn board(&self) -> &VirtualBoard {
        &self.board
    }

    /// The axes are there at this time of the machine.
    pub fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        let at_us = self.wait_until(at);
        self.counts = Some(counts);
        self.tell(at_us);
    }

    /// The control sends bytes, the last of which has gone at this time.
    pub fn serial(&mut self, at: Micros, bytes: &[u8]) {
        self.wait_until(at);
        self.board.control_sends(bytes);
    }

    /// The skip line rises.
    pub fn skip(&mut self, at: Micros, counts: [i64; 3]) {
        let at_us = self.wait_until(at);
        let number = self.skips;
        self.skips = number.wrapping_add(1);
        self.board.latch(LatchReport {
            number,
            cause: LatchCause::Skip,
            counts: counts.into_iter().collect(),
            t_ns: at_us * 1000,
            missed: 0,
        });
    }

    /// Waits for a time of the machine; what it is on the board's clock.
    pub fn wait_until(&mut self, at: Micros) -> u64 {
        let at_us = at.0 + self.offset_us;
        loop {
            let now_us = self.board.now().0;
            let Some(left_us) = at_us.checked_sub(now_us).filter(|left_us| *left_us > 0) else {
                if now_us - at_us > LATE_US {
                    self.offset_us += now_us - at_us;
                    return now_us;
                }
                return at_us;
            };
            let left = Duration::from_micros(left_us);
            std::thread::sleep(left.min(SAMPLING));
            if left > SAMPLING {
                // At rest: the encoders are read all the same.
                self.tell(self.board.now().0);
            }
        }
    }

    fn tell(&self, at_us: u64) {
        if let Some(counts) = self.counts {
            self.board.passes(Positions {
                counts: counts.into_iter().collect(),
                t_ns: at_us * 1000,
                illegal: counts.iter().map(|_| 0).collect(),
                lost_samples: 0,
            });
        }
    }
}
