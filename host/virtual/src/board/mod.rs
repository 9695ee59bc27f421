//! A virtual openumi board: the application of the firmware images, unchanged,
//! in a thread of a host process.
//!
//! ```
//! use std::time::Duration;
//! use umi_virtual::board::{Config, VirtualBoard};
//!
//! let board = VirtualBoard::start(Config::default())?;
//! board.control_sends(b"POINT: -135.5105 -136.3415 72.0620\r\n");
//! let mut host = board.connect();
//! host.write(&[0])?;
//! assert_eq!(host.read(Duration::ZERO)?, None);
//! # Ok::<(), std::io::Error>(())
//! ```

mod clock;
mod flash;
mod host;
mod images;
mod key;
mod ports;
mod power;
mod pulses;
pub mod serve;
mod waker;
mod wire;

use std::cell::Cell;
use std::io;
use std::rc::Rc;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::mpsc::{self, Sender, UnboundedSender};
use tokio::sync::{oneshot, watch};
use umi_app::board::{Clock as _, Lights, SensorLines};
use umi_core::journal::Geometry;
use umi_core::units::Micros;
use umi_protocol::latch::{LatchReport, Positions};
use umi_protocol::serial::LineSettings;

pub use clock::VirtualClock;
pub use flash::{VirtualFlash, Wear};
pub use host::HostEnd;
pub use images::{ImageAreas, SLOT, SLOTS};
pub use pulses::SentPulses;

use host::Waiter;
use ports::{
    FromControl, FromHost, Lamps, Latched, SensorEnd, SensorLamps, Station, TeachButton, Wire,
};
use power::{Plugs, Power};

/// The journal: 4 MiB of NOR flash as the boards carry it.
pub const JOURNAL: Geometry = Geometry {
    sectors: 64,
    sector_size: 65_536,
    write_size: 1,
    page_size: 256,
};

/// Verdicts and other evidence, apart from the noise: 1 MiB.
pub const EVIDENCE: Geometry = Geometry {
    sectors: 16,
    sector_size: 65_536,
    write_size: 1,
    page_size: 256,
};

/// What is kept for the owner.
pub const CUSTODY: Geometry = Geometry {
    sectors: 4,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// Job and taught reference.
pub const SETTINGS: Geometry = Geometry {
    sectors: 4,
    sector_size: 16_384,
    write_size: 1,
    page_size: 256,
};

/// Part programs.
pub const PROGRAMS: Geometry = Geometry {
    sectors: 1024,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// The board's key, and how often it has started.
pub const KEY: Geometry = Geometry {
    sectors: 2,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// The keys of people.
pub const ACCESS: Geometry = Geometry {
    sectors: 4,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// How time passes on a virtual board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardTime {
    /// As on a clock on the wall.
    Real,
    /// Only when [`VirtualBoard::advance`] says so.
    Steered,
}

/// A virtual board's hardware.
#[derive(Clone, Debug)]
pub struct Config {
    /// Serial number.
    pub serial: String,
    /// Flash of the journal.
    pub journal: VirtualFlash,
    /// Flash of the evidence; none: a board that keeps none apart.
    pub evidence: Option<VirtualFlash>,
    /// Flash of what is kept for the owner; none: a board that cannot be configured.
    pub custody: Option<VirtualFlash>,
    /// Flash of the settings.
    pub settings: VirtualFlash,
    /// Flash of the part programs.
    pub programs: VirtualFlash,
    /// Flash of the board's key; none: a board without a key, which signs nothing.
    pub key: Option<VirtualFlash>,
    /// Flash of the keys of people; none: a board that nobody can own.
    pub access: Option<VirtualFlash>,
    /// Flash of the images; none: a board that takes none.
    pub images: Option<ImageAreas>,
    /// The maker's public key, taken if the flash of the images holds none yet.
    pub firmware_key: Option<[u8; 32]>,
    /// Whether the jumper is closed.
    pub jumper: bool,
    /// How time passes.
    pub time: BoardTime,
    /// Time that a character takes on the control's line; zero: none.
    pub character: Duration,
    /// A character takes the time that the board's own settings give it, and `character` is not looked at: the
    /// pace is that of the job's line, as its pauses and its patience are.
    pub paced_by_job: bool,
    /// How the control's port is set: what the board hears of it when its own is set otherwise is
    /// what a UART would, and the line takes the time that it takes. None: both are set alike,
    /// always, and `character` is the time.
    pub control: Option<LineSettings>,
}

impl Default for Config {
    /// New flash in memory and no key, steered time, an infinitely fast line.
    fn default() -> Self {
        Self {
            serial: "VIRTUAL".into(),
            journal: VirtualFlash::in_memory(JOURNAL),
            evidence: Some(VirtualFlash::in_memory(EVIDENCE)),
            custody: Some(VirtualFlash::in_memory(CUSTODY)),
            settings: VirtualFlash::in_memory(SETTINGS),
            programs: VirtualFlash::in_memory(PROGRAMS),
            key: None,
            access: Some(VirtualFlash::in_memory(ACCESS)),
            images: Some(ImageAreas::in_memory()),
            firmware_key: None,
            jumper: false,
            time: BoardTime::Steered,
            character: Duration::ZERO,
            paced_by_job: false,
            control: None,
        }
    }
}

/// A virtual board at work. Dropping it switches it off.
#[derive(Debug)]
pub struct VirtualBoard {
    from_control: UnboundedSender<FromControl>,
    to_control: Mutex<Waiter<u8>>,
    from_host: UnboundedSender<FromHost>,
    latches: Sender<Latched>,
    time: watch::Sender<u64>,
    clock: VirtualClock,
    lamps: Lamps,
    button: TeachButton,
    station: Station,
    from_sensor: UnboundedSender<Vec<u8>>,
    sensor: SensorLamps,
    /// How the control's port is set.
    control: Arc<Mutex<Option<LineSettings>>>,
    off: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl VirtualBoard {
    /// Switches a board on.
    ///
    /// # Errors
    /// No thread can be had.
    pub fn start(config: Config) -> io::Result<Self> {
        let (from_control, control_in) = mpsc::unbounded_channel();
        // One byte behind the one on the line.
        let (control_out, to_control) = mpsc::channel(1);
        let (from_host, host_in) = mpsc::unbounded_channel();
        let (latches, latches_in) = mpsc::channel(64);
        let (time, steered) = watch::channel(0);
        let (off, switched_off) = oneshot::channel();
        let (started, start) = std::sync::mpsc::channel();
        let lamps = Lamps::default();
        let outputs = lamps.clone();
        let button = TeachButton::default();
        let own_button = button.clone();
        let clock = match config.time {
            BoardTime::Real => VirtualClock::Real(Instant::now()),
            BoardTime::Steered => VirtualClock::Steered(steered),
        };
        let own_clock = clock.clone();
        let station = Station::new(clock.clone());
        let own_station = station.clone();
        let (from_sensor, sensor_in) = mpsc::unbounded_channel();
        let sensor = SensorLamps::default();
        let sensor_end = SensorEnd {
            incoming: sensor_in,
            rest: Vec::new(),
            station: station.clone(),
            shown: sensor.clone(),
        };
        let control = Arc::new(Mutex::new(config.control));
        let own_control = Arc::clone(&control);
        let board = move || {
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_time()
                .build();
            let runtime = match runtime {
                Ok(runtime) => runtime,
                Err(error) => return drop(started.send(Err(error))),
            };
            let line = Wire {
                character: config.character,
                paced_by_job: config.paced_by_job,
                control,
                board: Rc::new(Cell::new(LineSettings::DEFAULT)),
            };
            let mut plugs = Plugs::new(
                control_in,
                control_out,
                host_in,
                latches_in,
                line,
                own_station,
                outputs,
                own_button,
                sensor_end,
            );
            // Nobody waits any more: then nobody wants the board either.
            let mut power = Power {
                started: Some(started),
                switched_off,
            };
            while power.cycle(&config, &runtime, &mut plugs, &own_clock) {}
        };
        let thread = std::thread::Builder::new()
            .name("virtual board".into())
            .stack_size(8 << 20)
            .spawn(board)?;
        start.recv().map_err(io::Error::other)??;
        Ok(Self {
            from_control,
            to_control: Mutex::new(Waiter::new(to_control)?),
            from_host,
            latches,
            time,
            clock,
            lamps,
            button,
            station,
            from_sensor,
            sensor,
            control: own_control,
            off: Some(off),
            thread: Some(thread),
        })
    }

    /// The control sends bytes.
    pub fn control_sends(&self, bytes: &[u8]) {
        // The board's thread ends only with this value.
        let _ = self.from_control.send(FromControl::Bytes(bytes.to_vec()));
    }

    /// The captured file that plays the control has ended.
    pub fn input_ends(&self) {
        let _ = self.from_control.send(FromControl::End);
    }

    /// The next byte for the control; none if there is none in this time.
    #[must_use]
    pub fn control_receives(&self, patience: Duration) -> Option<u8> {
        let mut waiter = self
            .to_control
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        waiter.next(patience).ok().flatten()
    }

    /// Connects a host; whoever was connected is not any more.
    #[must_use]
    pub fn connect(&self) -> HostEnd {
        HostEnd::new(self.from_host.clone())
    }

    /// An edge latches the axes. Returns when the board has taken it in: on a machine
    /// milliseconds pass before the control prints a line about it.
    pub fn latch(&self, latch: LatchReport) {
        let (waiting, taken) = std::sync::mpsc::channel();
        // The board's thread ends only with this value; its end is an answer too.
        let _ = self.latches.blocking_send((latch, waiting));
        let _ = taken.recv();
    }

    /// Moves a steered clock on; it never goes back.
    pub fn advance(&self, to: Micros) {
        self.time.send_if_modified(|now| {
            let forward = to.0 > *now;
            *now = to.0.max(*now);
            forward
        });
    }

    /// Time since the board was switched on.
    #[must_use]
    pub fn now(&self) -> Micros {
        self.clock.now()
    }

    /// A distance sensor at the second port sends bytes.
    pub fn sensor_sends(&self, bytes: &[u8]) {
        // The board's thread ends only with this value.
        let _ = self.from_sensor.send(bytes.to_vec());
    }

    /// What the station of a distance sensor shows to the control, and whether it triggers the
    /// sensor.
    #[must_use]
    pub fn sensor_lines(&self) -> (SensorLines, bool) {
        self.sensor.look()
    }

    /// The control's port is set like this from now on.
    pub fn set_control(&self, line: LineSettings) {
        *self.control.lock().unwrap_or_else(PoisonError::into_inner) = Some(line);
    }

    /// The axes are here from now on. Trigger pulses that were asked for and are due on
    /// the way are sent and latched: these.
    pub fn move_to(&self, positions: Positions) -> SentPulses {
        self.moved(positions, false)
    }

    /// As [`Self::move_to`], of axes that do not stand there: they were there at the
    /// positions' own instant, and until more is told that is all that is known.
    pub fn passes(&self, positions: Positions) -> SentPulses {
        self.moved(positions, true)
    }

    fn moved(&self, positions: Positions, passing: bool) -> SentPulses {
        let sent = self.station.move_to(positions, passing);
        for latch in &sent.latches {
            self.latch(latch.clone());
        }
        sent
    }

    /// Whether the board enables a scanner's laser.
    #[must_use]
    pub fn laser_is_on(&self) -> bool {
        self.station.laser_is_on()
    }

    /// Presses the teaching button, or releases it.
    pub fn press(&self, is_pressed: bool) {
        self.button.press(is_pressed);
    }

    /// What the outputs show.
    #[must_use]
    pub fn lights(&self) -> Lights {
        self.lamps.look()
    }
}

impl Drop for VirtualBoard {
    fn drop(&mut self) {
        if let Some(off) = self.off.take() {
            let _ = off.send(());
        }
        if let Some(thread) = self.thread.take() {
            // A panic in the board has been printed by its thread.
            let _ = thread.join();
        }
    }
}
