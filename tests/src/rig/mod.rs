//! A board under test, whichever it is: what the conformance suite needs of it.

pub mod pico;
mod qemu;
mod virtual_board;

use std::env;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use umi_app::board::{Lights, SensorLines};
use umi_client::board::link::Transport;
use umi_protocol::serial::LineSettings;

pub use pico::PicoRig;
pub use qemu::QemuRig;
pub use virtual_board::VirtualRig;

/// Where time on the wall is counted from.
static BEGUN: LazyLock<Instant> = LazyLock::new(Instant::now);

/// A board with all that stands around it on a machine: the control, a host, encoders,
/// a probe, a scanner, and the power switch.
pub trait Rig {
    /// The kind of board, as it calls itself.
    fn name(&self) -> &'static str;

    /// How much longer things may take than on a real board: who waits a second for it
    /// by a clock on the wall, waits this many seconds at most.
    fn slowness(&self) -> u32;

    /// The board's time since some instant. Where time is emulated it is that time: what
    /// waits by it gives the board the same chance on any machine. It stands still while
    /// an emulated board has no power.
    fn time(&mut self) -> Duration {
        BEGUN.elapsed() / self.slowness()
    }

    /// Whether that time is the board's own, and does not run on while nobody lets it run.
    fn has_own_time(&self) -> bool {
        false
    }

    /// Plugs the host's cable in. What was plugged in before is not any more.
    fn connect(&mut self) -> Box<dyn Transport>;

    /// Pulls the host's cable out.
    fn unplug(&mut self);

    /// The control sends bytes, as fast as its line takes them.
    fn control_sends(&mut self, bytes: &[u8]);

    /// The control's port is set like this from now on. Until then as a board begins.
    fn control_line(&mut self, line: LineSettings);

    /// The speed that the board's port to the control is really set to, by its registers; none
    /// where they cannot be seen.
    fn board_baud(&mut self) -> Option<f64> {
        None
    }

    /// How many bits the shortest character was long that went to the control and that came from it since
    /// this was asked last, by the ends of two that followed each other; none where that cannot be seen.
    fn frame_bits(&mut self) -> Option<[f64; 2]> {
        None
    }

    /// Whether what is read from the control's line is what is on it now: only then it can
    /// be said how many bytes come after something.
    fn line_takes_time(&self) -> bool {
        true
    }

    /// The control takes so many more characters and then holds the board by CTS; none: it
    /// takes what comes. False: it has no such line here, and takes what comes.
    fn control_takes(&mut self, characters: Option<u32>) -> bool {
        let _ = characters;
        false
    }

    /// The next byte for the control; none if there is none in this time of the board's.
    fn control_receives(&mut self, patience: Duration) -> Option<u8>;

    /// Moves the axes until their encoders have counted to here, faster than any
    /// machine but no faster than the board promises to follow.
    fn move_to(&mut self, counts: &[i64]);

    /// The probe's skip line rises and falls while the axes stand.
    fn skip(&mut self);

    /// The scanner's trigger line rises and falls while the axes stand.
    fn trigger(&mut self);

    /// What the outputs show.
    fn lights(&mut self) -> Lights;

    /// Whether the board enables a scanner's laser.
    fn laser_is_on(&mut self) -> bool;

    /// Takes the power away and gives it back. What is in flash stays.
    fn power_cycle(&mut self);

    /// How many bytes of its stack the board has needed since its power came, and how many
    /// it may need; none where that cannot be seen.
    fn stack_bytes(&mut self) -> Option<(u32, u32)> {
        None
    }
}

/// A board with a distance sensor at a second port. The sensor is triggered by the board and answers
/// at the trigger input: [`Rig::trigger`] is its capture.
pub trait SensorRig: Rig {
    /// The board's clock goes on while the machine that runs the tests is busy: a reading may come
    /// later than the board waits for one.
    const CLOCK_RUNS_ON: bool;

    /// The sensor sends bytes.
    fn sensor_sends(&mut self, bytes: &[u8]);

    /// What the station shows to the control, and whether it triggers the sensor.
    fn sensor_lines(&mut self) -> (SensorLines, bool);
}

/// The image of a board: the file that `variable` names, or else the one that `cargo xtask
/// firmware` has made. None if `UMI_EMULATORS` is 0: then images are not run.
///
/// # Errors
/// What to type.
pub fn image(variable: &str, file: &str) -> Result<PathBuf, String> {
    if env::var("UMI_EMULATORS").is_ok_and(|value| value == "0") {
        return Err("UMI_EMULATORS is 0".to_owned());
    }
    let image = env::var_os(variable).map_or_else(
        || {
            let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
            let target = env::var_os("CARGO_TARGET_DIR");
            let target = target.map_or_else(|| tests.join("../target"), PathBuf::from);
            target.join("firmware").join(file)
        },
        PathBuf::from,
    );
    if image.is_file() {
        return Ok(image);
    }
    let image = image.display();
    Err(format!(
        "there is no image {image}; `cargo xtask firmware` makes it, or set {variable}"
    ))
}

/// Whether a program is there to be run.
#[must_use]
pub fn is_installed(program: &str) -> bool {
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

/// What was asked for; or none, with a printed reason, unless emulators must be there.
///
/// # Panics
/// When `UMI_EMULATORS` is 1 and there is none.
pub fn skip_without<T>(wanted: Result<T, String>) -> Option<T> {
    match wanted {
        Ok(it) => Some(it),
        Err(why) => {
            let must = env::var("UMI_EMULATORS").is_ok_and(|value| value == "1");
            assert!(!must, "UMI_EMULATORS is 1, but {why}");
            // Not `eprintln!`: that is not shown for a test that passes.
            let _ = std::io::Write::write_all(
                &mut std::io::stderr(),
                format!("skipped: {why}\n").as_bytes(),
            );
            None
        }
    }
}
