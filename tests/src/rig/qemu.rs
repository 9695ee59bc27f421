//! The image of the board `mps2-an500` in QEMU as a rig.
//!
//! The image's UARTs are sockets: the control's line, the host's cable, the bench
//! ([`umi_stimuli`]) and what the board prints when it starts. The board's flash is a
//! file, which outlives QEMU: to take the power away is to end QEMU.
//!
//! `cargo xtask firmware mps2-an500` makes the image, `cargo xtask set-up` brings QEMU.

use std::env;
use std::fs::{self, File};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use umi_app::board::{Lights, SensorLines};
use umi_client::board::link::Transport;
use umi_protocol::latch::LatchCause;
use umi_protocol::message::ResetReason;
use umi_protocol::serial::LineSettings;
use umi_stimuli::{
    BenchState, MAX_FRAME, SensorTriggers, Stimulus, StimulusDecoder, decode, encode,
};

use super::{Rig, image, is_installed, skip_without};

const QEMU: &str = "qemu-system-arm";

/// The PSRAM of the machine, in which the board has its flash.
const FLASH_BYTES: u64 = 16 << 20;

/// In that file, what the machine has no hardware for: entropy, and the jumper
/// (`firmware/boards/mps2-an500/src/storage/mod.rs`).
const ENTROPY_AT: u64 = 16;
const JUMPER_AT: u64 = ENTROPY_AT + 32;
const MAKER_AT: u64 = JUMPER_AT + 1;

/// Bytes that the control sends at once, at most.
const PIECE: usize = 64;

/// The divider of the control's UART in its fifth register, and what it divides.
const DIVIDER: u32 = 0x4000_4010;
const CLOCK_HZ: f64 = 25e6;

/// An instruction takes 2 to the power of this many nanoseconds: 31 million in a second,
/// about as many as the machine's 25 MHz allow for. So the board's time is that of its
/// work, and does not run away from it while the host's processors do something else.
const NS_PER_INSTRUCTION_LOG2: u32 = 5;

/// A machine that is busy with other things may let QEMU wait as long.
const PATIENCE: Duration = Duration::from_secs(60);

/// How long the axes move, in the board's time.
const MOVE_NS: u64 = 2_000_000;

/// A board in QEMU.
pub struct QemuRig {
    image: PathBuf,
    folder: Folder,
    /// None but while the power is off.
    machine: Option<Machine>,
    /// How the control's port is set.
    line: LineSettings,
}

/// QEMU at work, and what is plugged into it.
struct Machine {
    qemu: Child,
    control: UnixStream,
    bench: UnixStream,
    monitor: UnixStream,
    sensor: UnixStream,
    /// The host's end of the cable, if one is plugged in.
    host: Option<UnixStream>,
    decoder: StimulusDecoder,
    /// The latest that the board told.
    state: BenchState,
    /// Stimuli sent since it started.
    sent: u32,
    /// Bytes sent by the control since it started.
    from_control: u32,
}

impl QemuRig {
    /// The board with empty flash, switched on.
    ///
    /// # Errors
    /// What is missing, or why QEMU does not run the image.
    pub fn start() -> Result<Self, String> {
        let image = image("UMI_MPS2_IMAGE", "mps2-an500.elf")?;
        if !is_installed(QEMU) {
            return Err(format!(
                "there is no {QEMU}; `cargo xtask set-up` brings it"
            ));
        }
        Self::with(image).map_err(|error| format!("{QEMU} does not run the board: {error}"))
    }

    /// As [`Self::start`]; says why and returns none where a board may be missing.
    ///
    /// # Panics
    /// Without a board, when `UMI_EMULATORS` is 1.
    #[must_use]
    pub fn start_or_skip() -> Option<Self> {
        skip_without(Self::start())
    }

    /// As [`Self::start_or_skip`], with entropy for the board's key, and its jumper closed.
    ///
    /// # Panics
    /// As [`Self::start_or_skip`]; the file of the flash cannot be written.
    #[must_use]
    pub fn start_with_a_key(entropy: [u8; 32]) -> Option<Self> {
        let mut rig = Self::start_or_skip()?;
        rig.write_flash(ENTROPY_AT, &entropy);
        rig.close_jumper(true);
        rig.power_cycle();
        Some(rig)
    }

    /// As [`Self::start_with_a_key`], and with the public key of who makes images.
    ///
    /// # Panics
    /// As [`Self::start_with_a_key`].
    #[must_use]
    pub fn start_with_a_maker(entropy: [u8; 32], maker: [u8; 32]) -> Option<Self> {
        let mut rig = Self::start_with_a_key(entropy)?;
        rig.write_flash(MAKER_AT, &maker);
        rig.power_cycle();
        Some(rig)
    }

    /// The board starts anew by itself: waits until it has, and returns why it says so.
    pub fn starts_anew(&mut self) -> ResetReason {
        self.machine().restarted()
    }

    /// How often the board has started since the power came.
    #[must_use]
    pub fn starts(&self) -> usize {
        self.console().matches("umi-mps2-an500 ").count()
    }

    /// Waits until the board has started so often, by itself. Nobody asks it anything between two starts that
    /// follow each other: the second would find half of it.
    ///
    /// # Panics
    /// If that takes too long.
    pub fn wait_for_starts(&mut self, starts: usize) {
        let deadline = Instant::now() + PATIENCE;
        while self.starts() < starts {
            assert!(Instant::now() < deadline, "{}", self.console());
            thread::sleep(Duration::from_millis(20));
        }
        self.machine().begins_anew();
    }

    /// Closes the jumper, or opens it.
    ///
    /// # Panics
    /// The file of the flash cannot be written.
    pub fn close_jumper(&mut self, is_closed: bool) {
        self.write_flash(JUMPER_AT, &[u8::from(is_closed)]);
    }

    /// The board sees it at once: the file is its memory.
    fn write_flash(&self, at: u64, bytes: &[u8]) {
        let file = File::options().write(true).open(self.folder.file("flash"));
        let written = file.and_then(|mut file| {
            file.seek(io::SeekFrom::Start(at))?;
            file.write_all(bytes)
        });
        written.expect("the file of the flash is there");
    }

    fn with(image: PathBuf) -> io::Result<Self> {
        let folder = Folder::new()?;
        File::create(folder.file("flash"))?.set_len(FLASH_BYTES)?;
        let machine = Machine::start(&image, &folder).map_err(|error| {
            let said = fs::read_to_string(folder.file("said")).unwrap_or_default();
            io::Error::other(format!("{error}; {said}"))
        })?;
        let machine = Some(machine);
        Ok(Self {
            image,
            folder,
            machine,
            line: LineSettings::DEFAULT,
        })
    }

    fn machine(&mut self) -> &mut Machine {
        self.machine
            .as_mut()
            .expect("the power is off for an instant only")
    }

    /// Does this to the board and waits until it is done. For what [`Rig`] has no word for.
    pub fn stimulate(&mut self, stimulus: &Stimulus) -> BenchState {
        self.machine().stimulate(stimulus)
    }

    /// Does all this to the board and waits only at the end.
    pub fn stimulate_all(&mut self, stimuli: &[Stimulus]) -> BenchState {
        let machine = self.machine();
        stimuli.iter().for_each(|stimulus| machine.send(stimulus));
        machine.settle()
    }

    /// Does this to the board, waits until it has started anew, and returns why it says it
    /// has.
    pub fn restart_by(&mut self, stimulus: &Stimulus) -> ResetReason {
        self.machine().send(stimulus);
        self.machine().restarted()
    }

    /// Resets the board from outside, as its button does.
    pub fn reset(&mut self) -> ResetReason {
        let machine = self.machine();
        let asked = machine.monitor.write_all(b"system_reset\n");
        asked.expect("QEMU listens to its monitor");
        machine.restarted()
    }

    /// What the board has printed at its starts since the power came.
    #[must_use]
    pub fn console(&self) -> String {
        fs::read_to_string(self.folder.file("console")).unwrap_or_default()
    }
}

impl Machine {
    fn start(image: &Path, folder: &Folder) -> io::Result<Self> {
        let socket = |name: &str| format!("unix:{},server=on,wait=off", folder.path(name));
        let flash = format!(
            "memory-backend-file,id=psram,size={FLASH_BYTES},mem-path={},share=on",
            folder.path("flash")
        );
        for left in ["control", "host", "bench", "monitor", "sensor", "console"] {
            let _ = fs::remove_file(folder.file(left));
        }
        let qemu = Command::new(QEMU)
            .args(["-M", "mps2-an500,memory-backend=psram", "-object", &flash])
            .arg("-icount")
            .arg(format!("shift={NS_PER_INSTRUCTION_LOG2}"))
            .args(["-display", "none", "-nodefaults", "-kernel"])
            .arg(image)
            .args(["-serial", &socket("control"), "-serial", &socket("host")])
            .args(["-serial", &socket("bench"), "-serial"])
            .arg(format!("file:{}", folder.path("console")))
            .args(["-serial", &socket("sensor")])
            .args(["-monitor", &socket("monitor")])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(folder.file("said"))?)
            .spawn()?;
        let mut qemu = Ended(Some(qemu));
        let [control, bench, monitor, sensor] =
            ["control", "bench", "monitor", "sensor"].map(|name| plug_in(&folder.file(name)));
        let (control, bench, monitor, sensor) = (control?, bench?, monitor?, sensor?);
        let mut machine = Self {
            // From here on the machine ends it.
            qemu: qemu.0.take().ok_or(io::ErrorKind::NotFound)?,
            control,
            bench,
            monitor,
            sensor,
            host: None,
            decoder: StimulusDecoder::new(),
            state: BenchState::default(),
            sent: 0,
            from_control: 0,
        };
        // It starts with a cable that nobody holds the other end of.
        machine.stimulate(&Stimulus::Host { connected: false });
        Ok(machine)
    }

    fn send(&mut self, stimulus: &Stimulus) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(stimulus, &mut buffer).expect("every stimulus finds room");
        self.bench.write_all(frame).expect("QEMU runs");
        self.sent += 1;
    }

    fn stimulate(&mut self, stimulus: &Stimulus) -> BenchState {
        self.send(stimulus);
        self.settle()
    }

    /// Waits until everything that was sent has been taken in.
    fn settle(&mut self) -> BenchState {
        let sent = self.sent;
        self.wait_for("it takes the stimuli in", |state, _| state.taken == sent);
        self.state
    }

    /// Waits until the board has started anew.
    fn restarted(&mut self) -> ResetReason {
        // It has taken in one at least before.
        self.wait_for("it starts anew", |state, before| state.taken < before.taken);
        let reset = self.state.reset;
        self.begins_anew();
        reset
    }

    /// The board counts from nothing, and no cable is plugged in.
    fn begins_anew(&mut self) {
        (self.sent, self.from_control) = (0, 0);
        self.stimulate(&Stimulus::Host { connected: false });
    }

    /// Waits for a state of the board that is as it should be, given the one before it.
    fn wait_for(&mut self, what: &str, is_so: impl Fn(&BenchState, &BenchState) -> bool) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let mut bytes = [0; 256];
            let count = match self.bench.read(&mut bytes) {
                Ok(0) => panic!("QEMU has ended"),
                Ok(count) => count,
                Err(_) => 0,
            };
            let (mut held, mut latest) = (false, self.state);
            let came = bytes.get(..count).unwrap_or_default();
            decode(&mut self.decoder, came, |state: BenchState| {
                held |= is_so(&state, &latest);
                latest = state;
            });
            self.state = latest;
            if held {
                return;
            }
            assert!(
                Instant::now() < deadline,
                "the board does not come to where {what}: {latest:?}"
            );
        }
    }

    /// The board's time now.
    fn now_ns(&mut self) -> u64 {
        self.stimulate(&Stimulus::Look).t_ns
    }

    /// Waits until it is so late for the board; returns how late it is.
    fn wait_until(&mut self, until_ns: u64) -> u64 {
        self.send(&Stimulus::Wait { until_ns });
        self.wait_for("the time has come", |state, _| state.t_ns >= until_ns);
        self.state.t_ns
    }

    /// An edge while the axes stand.
    fn edge(&mut self, cause: LatchCause) {
        let t_ns = self.now_ns();
        self.stimulate(&Stimulus::Edge { cause, t_ns });
    }

    fn unplug(&mut self) {
        self.stimulate(&Stimulus::Host { connected: false });
        if let Some(host) = self.host.take() {
            // Whoever still holds the cable's end reads that it is over.
            let _ = host.shutdown(Shutdown::Both);
        }
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
    }
}

/// Ends QEMU if it does not come to a [`Machine`].
struct Ended(Option<Child>);

impl Drop for Ended {
    fn drop(&mut self) {
        if let Some(qemu) = &mut self.0 {
            let _ = qemu.kill();
            let _ = qemu.wait();
        }
    }
}

/// Connects to a socket of QEMU, which needs a moment to make it.
fn plug_in(socket: &Path) -> io::Result<UnixStream> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        match UnixStream::connect(socket) {
            Ok(stream) => {
                stream.set_read_timeout(Some(Duration::from_millis(100)))?;
                return Ok(stream);
            }
            Err(error) if Instant::now() > deadline => return Err(error),
            Err(_) => thread::sleep(Duration::from_millis(5)),
        }
    }
}

impl Rig for QemuRig {
    fn name(&self) -> &'static str {
        "mps2-an500"
    }

    fn slowness(&self) -> u32 {
        // As fast as a real one, unless the machine has other things to do.
        4
    }

    fn connect(&mut self) -> Box<dyn Transport> {
        let socket = self.folder.file("host");
        let machine = self.machine();
        machine.unplug();
        let host = plug_in(&socket).expect("QEMU takes a new connection");
        let end = host.try_clone().expect("a socket can be shared");
        machine.host = Some(host);
        machine.stimulate(&Stimulus::Host { connected: true });
        Box::new(Cable(end))
    }

    fn unplug(&mut self) {
        self.machine().unplug();
    }

    fn control_sends(&mut self, bytes: &[u8]) {
        let LineSettings { baud, .. } = self.line;
        let byte_ns = 1_000_000_000 * u64::from(self.line.bits()) / u64::from(baud);
        // A slow line does not give many at once: a tenth of a second of it.
        let piece = usize::try_from(baud / 100).map_or(PIECE, |bytes| bytes.clamp(1, PIECE));
        let machine = self.machine();
        let mut t_ns = machine.now_ns();
        for piece in bytes.chunks(piece) {
            let begun = Instant::now();
            machine.control.write_all(piece).expect("QEMU runs");
            machine.from_control += piece.len() as u32;
            // The line's rate is one in the board's time.
            t_ns = machine.wait_until(t_ns + piece.len() as u64 * byte_ns);
            while machine.state.from_control != machine.from_control {
                assert!(begun.elapsed() < PATIENCE, "the board does not receive");
                t_ns = machine.now_ns();
            }
        }
    }

    fn control_line(&mut self, line: LineSettings) {
        self.line = line;
    }

    fn board_baud(&mut self) -> Option<f64> {
        let monitor = &mut self.machine().monitor;
        monitor
            .write_all(format!("xp /1wx {DIVIDER:#x}\n").as_bytes())
            .ok()?;
        let mut said = String::new();
        let deadline = Instant::now() + PATIENCE;
        while Instant::now() < deadline {
            let mut bytes = [0; 256];
            let count = monitor.read(&mut bytes).unwrap_or(0);
            said.push_str(&String::from_utf8_lossy(bytes.get(..count)?));
            // `0000000040004010: 0x000000d9`
            let words = said.rsplit_once(&format!("{DIVIDER:016x}: 0x"));
            if let Some(word) = words.and_then(|(_, word)| word.get(..8)) {
                let divider = u32::from_str_radix(word, 16).ok()?;
                return Some(CLOCK_HZ / f64::from(divider));
            }
        }
        panic!("QEMU's monitor does not say the divider: {said:?}")
    }

    fn line_takes_time(&self) -> bool {
        // QEMU's UARTs send as fast as they are written.
        false
    }

    fn control_takes(&mut self, characters: Option<u32>) -> bool {
        self.machine().stimulate(&Stimulus::Clear { characters });
        true
    }

    fn control_receives(&mut self, patience: Duration) -> Option<u8> {
        let patience = patience * self.slowness();
        let control = &mut self.machine().control;
        let mut byte = [0];
        // Zero would mean for ever.
        let patience = patience.max(Duration::from_millis(1));
        control.set_read_timeout(Some(patience)).ok()?;
        match control.read(&mut byte) {
            Ok(1) => Some(byte[0]),
            _ => None,
        }
    }

    fn move_to(&mut self, counts: &[i64]) {
        let machine = self.machine();
        // A little ahead, so that nobody has looked there yet.
        let from_ns = machine.now_ns() + MOVE_NS;
        let to_ns = from_ns + MOVE_NS;
        let state = machine.stimulate(&Stimulus::Path {
            from_ns,
            to_ns,
            counts: counts.iter().copied().collect(),
        });
        assert_eq!(state.refused, 0, "the path is one");
        machine.wait_until(to_ns);
    }

    fn skip(&mut self) {
        self.machine().edge(LatchCause::Skip);
    }

    fn trigger(&mut self) {
        self.machine().edge(LatchCause::Trigger);
    }

    fn lights(&mut self) -> Lights {
        let state = self.stimulate(&Stimulus::Look);
        Lights {
            busy: state.busy,
            ok: state.ok,
            ng: state.ng,
            trouble: state.trouble,
        }
    }

    fn laser_is_on(&mut self) -> bool {
        self.stimulate(&Stimulus::Look).laser
    }

    fn power_cycle(&mut self) {
        // QEMU has ended before another one takes the file.
        self.machine = None;
        let machine = Machine::start(&self.image, &self.folder);
        self.machine = Some(machine.unwrap_or_else(|error| panic!("{QEMU}: {error}")));
    }
}

/// The host's end of the cable.
struct Cable(UnixStream);

impl Transport for Cable {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        use io::ErrorKind::{TimedOut, UnexpectedEof, WouldBlock};
        self.0
            .set_read_timeout(Some(timeout.max(Duration::from_millis(1))))?;
        match self.0.read(buffer) {
            Ok(0) => Err(UnexpectedEof.into()),
            Err(error) if matches!(error.kind(), TimedOut | WouldBlock) => Ok(0),
            other => other,
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }
}

/// A folder that goes with its value.
struct Folder(PathBuf);

impl Folder {
    fn new() -> io::Result<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        // Short: the path of a socket has a hundred characters.
        let name = format!("umi-qemu-{}-{count}", std::process::id());
        let folder = env::temp_dir().join(name);
        fs::create_dir_all(&folder)?;
        Ok(Self(folder))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn path(&self, name: &str) -> String {
        self.file(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl super::SensorRig for QemuRig {
    const CLOCK_RUNS_ON: bool = true;

    fn sensor_sends(&mut self, bytes: &[u8]) {
        let sensor = &mut self.machine().sensor;
        sensor.write_all(bytes).expect("QEMU runs");
    }

    fn sensor_lines(&mut self) -> (SensorLines, bool) {
        let state = self.stimulate(&Stimulus::Look);
        let [skip, parity, is_ok, has_no_signal] = state.sensor;
        let lines = SensorLines {
            skip,
            parity,
            is_ok,
            has_no_signal,
        };
        (lines, state.triggers != SensorTriggers::Off)
    }
}
