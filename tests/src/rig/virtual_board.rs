//! The virtual board as a rig.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use umi_app::board::{Lights, SensorLines};
use umi_client::board::link::Transport;
use umi_core::units::Micros;
use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_protocol::serial::LineSettings;
use umi_virtual::board::BoardTime;
use umi_virtual::{Config, VirtualBoard};

use super::Rig;

/// A virtual board whose time is that of the wall, or goes on faster.
pub struct VirtualRig {
    config: Config,
    board: Option<Arc<VirtualBoard>>,
    /// Where the board's time is its own.
    clock: Option<Clock>,
    /// Of that time, in the starts that have ended.
    passed: Duration,
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
        Self::of(Config {
            time: BoardTime::Real,
            control: Some(LineSettings::DEFAULT),
            ..Config::default()
        })
    }

    /// This board, switched on. Where its time is given to it, that goes on a hundred times as fast as the wall's.
    ///
    /// # Errors
    /// As [`VirtualBoard::start`].
    pub fn of(config: Config) -> io::Result<Self> {
        let board = Arc::new(VirtualBoard::start(config.clone())?);
        let mut rig = Self {
            clock: Clock::of(&config, &board),
            board: Some(board),
            config,
            passed: Duration::ZERO,
            counts: Vec::new(),
            skips: 0,
            triggers: 0,
        };
        rig.move_to(&[0; 3]);
        Ok(rig)
    }

    /// Closes the owner's jumper, or opens it: the board sees it at its next start.
    pub fn close_jumper(&mut self, is_closed: bool) {
        self.config.jumper = is_closed;
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

/// How far the board's clock goes on in a millisecond of the wall's.
const TURN_US: u64 = 100_000;

/// What lets a board's time go on.
struct Clock {
    ends: Arc<AtomicBool>,
    turns: Option<JoinHandle<()>>,
}

impl Clock {
    fn of(config: &Config, board: &Arc<VirtualBoard>) -> Option<Self> {
        if config.time == BoardTime::Real {
            return None;
        }
        let ends = Arc::new(AtomicBool::new(false));
        let (board, its_end) = (Arc::clone(board), Arc::clone(&ends));
        let turns = std::thread::spawn(move || {
            while !its_end.load(Ordering::Relaxed) {
                board.advance(Micros(board.now().0 + TURN_US));
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        Some(Self {
            ends,
            turns: Some(turns),
        })
    }
}

impl Drop for Clock {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(turns) = self.turns.take() {
            let _ = turns.join();
        }
    }
}

impl Rig for VirtualRig {
    fn name(&self) -> &'static str {
        "virtual"
    }

    fn slowness(&self) -> u32 {
        1
    }

    fn time(&mut self) -> Duration {
        match self.clock {
            Some(_) => self.passed + Duration::from_micros(self.board().now().0),
            None => super::BEGUN.elapsed(),
        }
    }

    fn has_own_time(&self) -> bool {
        self.clock.is_some()
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
        self.passed = self.time();
        // It holds the board, too.
        self.clock = None;
        self.board = None;
        let board = VirtualBoard::start(self.config.clone()).expect("it has started before");
        let board = Arc::new(board);
        self.clock = Clock::of(&self.config, &board);
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
