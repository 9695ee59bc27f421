//! The virtual board as a rig.

use std::io;
use std::time::Duration;

use umi_app::board::{Lights, SensorLines};
use umi_client::board::link::Transport;
use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_protocol::serial::LineSettings;
use umi_virtual::board::BoardTime;
use umi_virtual::{Config, VirtualBoard};

use super::Rig;

/// A virtual board whose time is that of the wall.
pub struct VirtualRig {
    config: Config,
    board: Option<VirtualBoard>,
    counts: Vec<i64>,
    skips: u32,
    triggers: u32,
}

impl VirtualRig {
    /// A board with empty flash, switched on.
    ///
    /// # Errors
    /// As [`VirtualBoard::start`].
    pub fn start() -> io::Result<Self> {
        let config = Config {
            time: BoardTime::Real,
            control: Some(LineSettings::DEFAULT),
            ..Config::default()
        };
        let mut rig = Self {
            board: Some(VirtualBoard::start(config.clone())?),
            config,
            counts: Vec::new(),
            skips: 0,
            triggers: 0,
        };
        rig.move_to(&[0; 3]);
        Ok(rig)
    }

    fn board(&self) -> &VirtualBoard {
        self.board
            .as_ref()
            .expect("the board is on but for an instant")
    }

    /// The board's time.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.board().now().0 * 1000
    }

    /// An edge at this instant, with the axes there.
    pub fn edge(&self, cause: LatchCause, t_ns: u64, counts: [i64; 3]) {
        self.board().latch(LatchReport {
            number: 0,
            cause,
            counts: counts.into_iter().collect(),
            t_ns,
            missed: 0,
        });
    }

    fn latch(&self, cause: LatchCause, number: u32) {
        self.board().latch(LatchReport {
            number,
            cause,
            counts: self.counts.iter().copied().collect(),
            t_ns: self.board().now().0 * 1000,
            missed: 0,
        });
    }
}

impl Rig for VirtualRig {
    fn name(&self) -> &'static str {
        "virtual"
    }

    fn slowness(&self) -> u32 {
        1
    }

    fn connect(&mut self) -> Box<dyn Transport> {
        umi_desk::link(self.board())
    }

    fn unplug(&mut self) {
        drop(self.board().connect());
    }

    fn control_sends(&mut self, bytes: &[u8]) {
        self.board().control_sends(bytes);
    }

    fn control_line(&mut self, line: LineSettings) {
        // What it hears of a board that is set otherwise is not what that has said.
        self.board().set_control(line);
        self.config.control = Some(line);
    }

    fn control_receives(&mut self, patience: Duration) -> Option<u8> {
        self.board().control_receives(patience)
    }

    fn move_to(&mut self, counts: &[i64]) {
        self.counts = counts.to_vec();
        // A move takes its time: pulses along it need theirs.
        std::thread::sleep(std::time::Duration::from_millis(2));
        self.board().move_to(Positions {
            counts: counts.iter().copied().collect(),
            t_ns: self.board().now().0 * 1000,
            ..Positions::default()
        });
    }

    fn skip(&mut self) {
        self.latch(LatchCause::Skip, self.skips);
        self.skips += 1;
    }

    fn trigger(&mut self) {
        self.latch(LatchCause::Trigger, self.triggers);
        self.triggers += 1;
    }

    fn lights(&mut self) -> Lights {
        self.board().lights()
    }

    fn laser_is_on(&mut self) -> bool {
        self.board().laser_is_on()
    }

    fn power_cycle(&mut self) {
        self.board = None;
        let board = VirtualBoard::start(self.config.clone()).expect("it has started before");
        self.board = Some(board);
        (self.skips, self.triggers) = (0, 0);
        // Its counters begin again.
        self.move_to(&[0; 3]);
    }
}

impl super::SensorRig for VirtualRig {
    const CLOCK_RUNS_ON: bool = false;

    fn sensor_sends(&mut self, bytes: &[u8]) {
        self.board().sensor_sends(bytes);
    }

    fn sensor_lines(&mut self) -> (SensorLines, bool) {
        self.board().sensor_lines()
    }
}
