//! A desk in real time: a virtual board that another program can be the host of, as
//! `umi watch` and `umi events`.
//!
//! The virtual machine computes a motion at once, with a time for each event. This desk waits
//! for those times.

use std::sync::Arc;
use std::time::Duration;

use umi_core::units::Micros;
use umi_protocol::job::Job;
use umi_protocol::latch::LatchCause;
use umi_virtual::board::BoardTime;
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{Config, VirtualBoard};

use umi_client::problem::Problem;

use crate::AxisCounts;
use crate::line_scan::LineScan;

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
    counts: Option<AxisCounts>,
    /// Counts of the rotary axes.
    turned: Vec<i64>,
    skips: u32,
    skip_ends: u32,
    scan: Option<LineScan>,
    /// What the board was told last, and when.
    told: Option<(u64, AxisCounts)>,
}

impl Live {
    /// Switches a new board on, gives it a job and opens a port for its host.
    ///
    /// # Errors
    /// The board cannot be started or refuses the job; the port cannot be opened.
    pub fn new(job: &Job, character: Duration, usb: &PortPlace) -> Result<Self, Problem> {
        let trouble = |error| Problem::trouble("virtual_board", error);
        let config = Config {
            time: BoardTime::Real,
            character,
            ..Config::default()
        };
        let (board, _) = crate::start(config, job)?;
        let board = Arc::new(board);
        let port = Port::open(usb).map_err(trouble)?;
        let address = port.address.clone();
        port.serve_host(&board);
        Ok(Self {
            offset_us: board.now().0,
            board,
            address,
            counts: None,
            turned: Vec::new(),
            skips: 0,
            skip_ends: 0,
            scan: None,
            told: None,
        })
    }

    /// A laser line scanner goes with the axes.
    #[must_use]
    pub fn with_scanner(mut self, scan: LineScan) -> Self {
        self.scan = Some(scan);
        self
    }

    /// The scanner, if there is one.
    #[must_use]
    pub const fn scanner(&self) -> Option<&LineScan> {
        self.scan.as_ref()
    }

    /// The board itself.
    #[must_use]
    pub fn board(&self) -> &VirtualBoard {
        &self.board
    }

    /// The axes are there at this time of the machine.
    pub fn moved(&mut self, at: Micros, counts: [i64; 3]) {
        let at_us = self.wait_until(at);
        self.counts = Some(AxisCounts::new(counts, &self.turned));
        self.tell(at_us);
    }

    /// The rotary axes show these counts from now on.
    pub fn turned(&mut self, counts: &[i64]) {
        self.turned = counts.to_vec();
    }

    /// The control sends bytes, the last of which has gone at this time.
    pub fn serial(&mut self, at: Micros, bytes: &[u8]) {
        self.wait_until(at);
        self.board.control_sends(bytes);
    }

    /// The skip line rises, or falls.
    pub fn skip(&mut self, at: Micros, cause: LatchCause, counts: [i64; 3]) {
        let at_us = self.wait_until(at);
        let counts = AxisCounts::new(counts, &self.turned);
        let edges = match cause {
            LatchCause::SkipEnd => &mut self.skip_ends,
            _ => &mut self.skips,
        };
        let edge = crate::skip_edge(edges, cause, at_us, counts);
        self.board.latch(edge);
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

    fn tell(&mut self, at_us: u64) {
        let Some(counts) = self.counts else { return };
        let sent = self.board.passes(crate::axes(at_us, counts));
        let before = self.told.replace((at_us, counts));
        if let (Some(scan), Some(before)) = (&mut self.scan, before) {
            for latch in scan.moved(before, (at_us, counts), &sent) {
                self.board.latch(latch);
            }
        }
    }
}
