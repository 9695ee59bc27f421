//! The emulated Pico as a rig: the board's image on an emulated RP2040, in a process of
//! its own, with real waveforms at its pins, real bytes on its serial line and a real
//! host on its USB.
//!
//! # Design
//! [`Emulator`] speaks the bench protocol of `tests/rp2040/main.js`; [`PicoRig`] is a
//! rig with it. Stimuli are made in the emulator: a test says what an axis does, and
//! asks later where it truly was.
//!
//! # Limitations
//! Emulated time falls behind that of the wall: what can, waits by [`Rig::time`]. The
//! host's library waits by the wall, and has [`Rig::slowness`].

mod bridge;
mod emulator;

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use umi_app::board::Lights;
use umi_client::board::link::{self, Client, Patience, Transport};
use umi_protocol::serial::LineSettings;

use super::{Rig, skip_without};

pub use bridge::pty;
pub use emulator::{
    EmulatedAxis, EmulatedInterrupt, EmulatedOutput, EmulatedPulses, Emulator, EmulatorState,
    EmulatorTruth, Segment, Start, Time,
};

/// The probe's line to the control, which the board listens to.
pub const SKIP_PIN: u8 = 16;
/// The scanner's trigger.
pub const TRIGGER_PIN: u8 = 17;
/// Axes with encoders.
pub const AXES: usize = 4;
/// Cycles of the board's clock in a microsecond.
pub const CYCLES_PER_US: u64 = 125;

/// A move of the rig: 6.25 million counts a second.
const CYCLES_PER_COUNT: f64 = 20.0;
/// A pulse of the rig.
const PULSE_CYCLES: u64 = 100 * CYCLES_PER_US;
/// How long the rig waits for what takes emulated time, before it says what is wrong.
const PATIENCE: Duration = Duration::from_secs(600);
/// What the golden session may need of the stack: a tenth more than it does.
const STACK_BYTES: u32 = 41_000;
/// A head is begun after 0.3 s of quiet, and takes less than that again.
const QUIET_CYCLES: u64 = 700_000 * CYCLES_PER_US;
/// For so many cycles the core sleeps when the first start is over.
const FIRST_START_TURN: u64 = 100_000 * CYCLES_PER_US;
/// How often it looks.
const TURN: Duration = Duration::from_millis(2);

/// An emulated Pico whose time goes on by itself.
pub struct PicoRig {
    emulator: Emulator,
    control: TcpStream,
}

impl PicoRig {
    /// A board that was on once before, and nothing more, switched on: it has its key, and its journal is
    /// begun. Its first start, which looks at all of the journal's flash, takes the emulator five times as
    /// long as another.
    ///
    /// # Errors
    /// Why there is no emulator: no image, no `node`, or what `node` said.
    pub fn start() -> Result<Self, String> {
        Self::begun(Emulator::start(Start::Paused)?)
    }

    /// This board, as if it had been on once before.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn begun(mut emulator: Emulator) -> Result<Self, String> {
        emulator.ask(&json!({ "do": "flashes", "put": flashes()? }));
        Self::of(emulator)
    }

    /// As [`Self::start`], but without a key, and with something done before its first cycle.
    ///
    /// # Errors
    /// As there.
    pub fn without_key(prepare: impl FnOnce(&mut Emulator)) -> Result<Self, String> {
        let mut emulator = Emulator::start(Start::Paused)?;
        let only = json!({ "nor": flashes()?["nor"], "code": [] });
        emulator.ask(&json!({ "do": "flashes", "put": only }));
        prepare(&mut emulator);
        Self::of(emulator)
    }

    /// A board with empty flash, switched on for the first time.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn first_start() -> Result<Self, String> {
        Self::of(Emulator::start(Start::Paused)?)
    }

    /// This board, as fast as it can go.
    ///
    /// # Errors
    /// The system's.
    pub fn of(mut emulator: Emulator) -> Result<Self, String> {
        // As fast as it can: it is seldom faster than real time.
        emulator.ask(&json!({ "do": "free", "speed": 0 }));
        let control = emulator
            .control()
            .map_err(|error| format!("no way to the control's port of the emulator: {error}"))?;
        Ok(Self { emulator, control })
    }

    /// As [`Self::start`]; says why and returns none where a board may be missing: it
    /// may not when `UMI_EMULATORS` is 1.
    ///
    /// # Panics
    /// Without an emulator, when `UMI_EMULATORS` is 1.
    #[must_use]
    pub fn start_or_skip() -> Option<Self> {
        skip_without(Self::start())
    }

    /// Erases take a fiftieth of the data sheets' time: where they are many, and how long each takes is not
    /// what is looked at.
    pub fn erase_quickly(&mut self) {
        self.emulator
            .ask(&json!({ "do": "erase_share", "share": 0.02 }));
    }

    /// Closes the owner's jumper, or opens it.
    pub fn close_jumper(&mut self, is_closed: bool) {
        self.emulator
            .ask(&json!({ "do": "jumper", "closed": is_closed }));
    }

    /// What is beyond a rig.
    pub const fn emulator(&mut self) -> &mut Emulator {
        &mut self.emulator
    }

    /// A host that has the board's patience.
    ///
    /// # Panics
    /// If the board does not answer.
    pub fn client(&mut self) -> Client {
        let patience = Patience {
            answer: Duration::from_secs(60),
            tries: 3,
        };
        Client::with_patience(self.connect(), patience).expect("the board answers")
    }

    /// Moves all axes for so long, odd ones down, none in step with another or with the
    /// board's samples.
    pub fn move_all(&mut self, cycles: u64, cycles_per_count: f64) {
        for axis in 0..AXES {
            let pace = cycles_per_count * (1.0 + 0.0037 * axis as f64);
            let counts = (cycles as f64 / pace) as i64;
            let way = if axis % 2 == 0 { counts } else { -counts };
            self.emulator
                .start_axis(axis, &[Segment::steady(way, pace)], &json!({}));
        }
    }

    /// Waits until a head is signed, which a board does in the quiet behind its start and behind the
    /// last line: a host waits meanwhile (the board's README).
    ///
    /// # Panics
    /// If that takes too long.
    pub fn wait_for_quiet(&mut self) {
        let now = self.emulator.state().cycle;
        self.wait_for_cycle(now + QUIET_CYCLES);
    }

    /// Waits until this cycle is over.
    pub fn wait_for_cycle(&mut self, cycle: u64) {
        self.wait_until("its time", |emulator| emulator.state().cycle > cycle);
    }

    /// Waits until the emulated board is so far.
    ///
    /// # Panics
    /// If that takes too long.
    pub fn wait_until(&mut self, what: &str, mut done: impl FnMut(&mut Emulator) -> bool) {
        let start = Instant::now();
        while !done(&mut self.emulator) {
            assert!(
                start.elapsed() < PATIENCE,
                "the emulated board: {what} takes too long; {:?}",
                self.emulator.state()
            );
            thread::sleep(TURN);
        }
    }

    fn pulse(&mut self, pin: u8) {
        let start = self.emulator.pulses(&EmulatedPulses {
            pin,
            count: 1,
            width: PULSE_CYCLES,
            ..EmulatedPulses::default()
        });
        let end = start + 2 * PULSE_CYCLES;
        self.wait_until("a pulse", |emulator| emulator.state().cycle > end);
    }
}

impl Rig for PicoRig {
    fn name(&self) -> &'static str {
        "pico"
    }

    fn slowness(&self) -> u32 {
        // A second is six of an idle machine's.
        60
    }

    fn line_takes_time(&self) -> bool {
        // The board runs on while the test looks.
        false
    }

    fn time(&mut self) -> Duration {
        let us = self.emulator.state().cycle / CYCLES_PER_US;
        Duration::from_micros(us)
    }

    fn connect(&mut self) -> Box<dyn Transport> {
        self.emulator.ask(&json!({ "do": "usb", "plugged": true }));
        self.wait_until("USB enumeration", |emulator| emulator.state().is_configured);
        link::open(&self.emulator.host_address()).expect("the emulator serves its host's port")
    }

    fn unplug(&mut self) {
        self.emulator.ask(&json!({ "do": "usb", "plugged": false }));
    }

    fn control_sends(&mut self, bytes: &[u8]) {
        self.control
            .write_all(bytes)
            .expect("the emulator takes what the control sends");
    }

    fn control_line(&mut self, line: LineSettings) {
        self.emulator
            .ask(&json!({ "do": "uart", "baud": line.baud, "stop_bits": line.stop_bits }));
    }

    fn frame_bits(&mut self) -> Option<[f64; 2]> {
        let state = self.emulator.state();
        let bit = CYCLES_PER_US as f64 * 1e6 / state.json["uart"]["baud"].as_f64()?;
        let answer = self.emulator.ask(&json!({ "do": "stamps" }));
        let shortest = |of: &str| {
            let ends = answer[of].as_array()?.iter().map(Value::as_f64);
            let ends = ends.collect::<Option<Vec<f64>>>()?;
            let lengths = ends.windows(2).map(|ends| ends[1] - ends[0]);
            lengths.reduce(f64::min)
        };
        Some([shortest("stamps")? / bit, shortest("came")? / bit])
    }

    fn board_baud(&mut self) -> Option<f64> {
        self.emulator.state().json["uart"]["baud"].as_f64()
    }

    fn has_own_time(&self) -> bool {
        true
    }

    fn control_receives(&mut self, patience: Duration) -> Option<u8> {
        // What is there needs no look at the clock, which costs a turn of the emulator.
        let mut byte = [0];
        self.control
            .set_read_timeout(Some(Duration::from_millis(1)))
            .ok()?;
        if let Ok(1) = self.control.read(&mut byte) {
            return Some(byte[0]);
        }
        let end = self.time() + patience;
        let begun = Instant::now();
        self.control.set_read_timeout(Some(TURN)).ok()?;
        loop {
            // What comes until then has been sent when the emulator tells the time.
            let is_last = self.time() > end || begun.elapsed() > PATIENCE;
            match self.control.read(&mut byte) {
                Ok(1) => return Some(byte[0]),
                Ok(_) => return None,
                Err(error) if is_patience(&error) && is_last => return None,
                Err(error) if is_patience(&error) => {}
                Err(error) => panic!("the emulator's control port: {error}"),
            }
        }
    }

    fn move_to(&mut self, counts: &[i64]) {
        let axes = self.emulator.axes();
        for (axis, (to, from)) in counts.iter().zip(&axes).enumerate() {
            let way = to - from.position;
            if way != 0 {
                self.emulator.start_axis(
                    axis,
                    &[Segment::steady(way, CYCLES_PER_COUNT)],
                    &json!({}),
                );
            }
        }
        // The last count is out at its cycle; what an input needs to be seen comes after it.
        let mut settled = None;
        self.wait_until("a move", |emulator| {
            let cycle = emulator.state().cycle;
            if settled.is_none() && !emulator.axes().iter().any(|axis| axis.is_moving) {
                settled = Some(cycle + 50 * CYCLES_PER_US);
            }
            settled.is_some_and(|settled| cycle > settled)
        });
    }

    fn skip(&mut self) {
        self.pulse(SKIP_PIN);
    }

    fn trigger(&mut self) {
        self.pulse(TRIGGER_PIN);
    }

    fn lights(&mut self) -> Lights {
        self.emulator.state().lights
    }

    fn laser_is_on(&mut self) -> bool {
        self.emulator.state().laser_is_on
    }

    fn power_cycle(&mut self) {
        self.emulator.power(false);
        self.emulator.power(true);
    }

    fn stack_bytes(&mut self) -> Option<(u32, u32)> {
        Some((self.emulator.stack_bytes(), STACK_BYTES))
    }
}

/// What a board's flashes hold when it has nothing more to do after its first start.
fn flashes() -> Result<&'static Value, String> {
    static FLASHES: OnceLock<Result<Value, String>> = OnceLock::new();
    let first_start = || {
        let mut emulator = Emulator::start(Start::Paused)?;
        let mut slept = 0;
        for _ in 0..100 {
            let now = emulator.run(FIRST_START_TURN).slept_cycles;
            if now - slept > FIRST_START_TURN * 9 / 10 {
                return Ok(emulator.ask(&json!({ "do": "flashes" })));
            }
            slept = now;
        }
        panic!("the first start does not end: {:?}", emulator.state());
    };
    FLASHES
        .get_or_init(first_start)
        .as_ref()
        .map_err(Clone::clone)
}

fn is_patience(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
    )
}
