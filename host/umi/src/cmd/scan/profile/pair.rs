//! `umi scan pair`

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::failure::Failure;
use clap::{Args, ValueEnum};
use umi_scan::ScanError;
use umi_scan::format::profiles;
use umi_scan::format::triggers::{self, LatchSignal, Triggers};
use umi_scan::pair::{PairOptions, ScanPairing, pair};
use umi_scan::profile::frames::FrameCounter;

use crate::cmd::Format;
use crate::cmd::scan::answer::answer;
use crate::cmd::scan::triple::at_least_0;

/// Which profile belongs to which latch of the board
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Pair {
    #[command(flatten)]
    streams: Streams,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
The clocks of sensor and board may differ by any offset and a small drift. The right
pairing is that of the shift that explains most profiles; a tie is never guessed. Where
profiles and latches are both left over, a shift is a tie, too, if chance (1 in 10^9) or runs of
losses that the board told could have put it behind. A shift that drifts by more than --drift-ppm
is refused, and the drift that was seen is named.
Lost, repeated and extra profiles, lost triggers and missed latches are named and counted.

A tie is decided where one shift alone explains as many within a narrower jitter, by more than chance (1 in
10^6), and a warning says so (`jitter`). Where that is not enough the refusal says which --jitter-us leaves one
shift alone, or how close the triggers come.

The sensor's frame counter sorts out what came twice and counts what is lost. It pairs nothing:
nobody knows to which pulse its first frame belongs. Without a clock that can be used (it stands, or
its steps are wider than half an interval) a scan is refused.

Examples:
  umi scan pair profiles.csv scan.csv
  umi scan pair part.gocator scan.csv --encoder x
  umi scan pair profiles.csv scan.csv --frame-bits 16 --strict --json

A profile or a latch whose time is wild stands apart from all others: it is left out and told
(`misplaced`). Times in another unit than their column says are refused (no_match), with `factor`.
Of a frame that came again the first message counts, unless its time is wild. A profile within the
jitter of two latches is left unpaired (`doubtful`), and so are two profiles within that of one.

In a train as even as a clock, of one or two pairs, or whose rhythm repeats or drifts steadily, nothing
tells where it begins (`even_train`; --strict refuses it), nor triggers that the sensor missed from a jump of its
clock by whole intervals (`skipped`): uneven pulses, an encoder or changes of speed tell.

Refused (status 2): ambiguous_pairing, no_match, no_triggers, no_profiles, which_cause,
board_restarted, missing_axis, no_encoder, frame_bits, faults. Not understood (status 1): truncated,
corrupt.";

/// What the sensor and the board told, and what their pairing must keep to.
#[derive(Args)]
pub(crate) struct Streams {
    /// Profiles: CSV (profile,frame,t_us,encoder,index,x_mm,z_mm; and intensity), a .gocator capture, or a table of
    /// three lines a profile: time in ms, places along the line, distances (mm)
    #[arg(value_name = "PROFILES")]
    pub profiles: PathBuf,
    /// The board's latches, as `umi events --csv` writes them
    #[arg(value_name = "TRIGGERS.csv")]
    pub triggers: PathBuf,
    /// Whose pulses are meant; needed only if the table has both
    #[arg(long, value_enum)]
    cause: Option<CauseName>,
    #[command(flatten)]
    tolerances: Tolerances,
    /// Refuse a scan with any loss, duplicate or extra, and one whose ends nothing tells (`even_train`)
    #[arg(long)]
    strict: bool,
}

/// What is known of the two streams before they are paired.
#[derive(Args)]
pub(crate) struct Tolerances {
    /// The axis that the sensor's own encoder counts, too
    #[arg(long, value_name = "COLUMN", value_parser = axis)]
    encoder: Option<usize>,
    /// What belongs together agrees within this, in microseconds
    #[arg(long, value_name = "US", default_value_t = 20.0, value_parser = at_least_0)]
    jitter_us: f64,
    /// The most by which the two clocks drift, in parts per million
    #[arg(long, value_name = "PPM", default_value_t = 200.0, value_parser = drift)]
    drift_ppm: f64,
    /// The sensor's frame counter starts at 0 again after so many bits
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    frame_bits: Option<u32>,
    /// The sensor's frame counter may have started anew in the scan, while its clock went on: a number that was there
    /// before at another time is a profile of its own
    #[arg(long, conflicts_with = "frame_bits")]
    counter_restarts: bool,
}

/// When the sensor sees, beside its edge; for the commands that take positions from latches.
#[derive(Args)]
pub(crate) struct Latency {
    /// The sensor sees so many microseconds after the edge; before it, if negative
    #[arg(
        long,
        value_name = "US",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub latency_us: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum CauseName {
    /// The board's pulses trigger the sensor
    Output,
    /// The sensor's pulses latch the board
    Trigger,
}

impl Streams {
    /// The latches of the cause.
    pub fn read_triggers(&self) -> Result<Triggers, ScanError> {
        let cause = self.cause.map(|cause| match cause {
            CauseName::Output => LatchSignal::Output,
            CauseName::Trigger => LatchSignal::Trigger,
        });
        triggers::read(&self.triggers, cause)
    }

    /// What a pairing must keep to.
    pub fn options(&self) -> PairOptions {
        self.tolerances.options(self.strict)
    }
}

impl Tolerances {
    /// What a pairing must keep to.
    pub fn options(&self, strict: bool) -> PairOptions {
        PairOptions {
            jitter_us: self.jitter_us,
            drift_ppm: self.drift_ppm,
            counter: match self.frame_bits {
                Some(bits) => FrameCounter::Bits(bits),
                None if self.counter_restarts => FrameCounter::Restarts,
                None => FrameCounter::Rises,
            },
            encoder: self.encoder,
            strict,
        }
    }
}

impl Pair {
    pub fn run(self) -> Result<(), Failure> {
        answer(self.find(), self.format.json, text)
    }

    fn find(&self) -> Result<ScanPairing, ScanError> {
        let triggers = self.streams.read_triggers()?;
        let came = profiles::stamps(&self.streams.profiles)?;
        let mut pairing = pair(&came.stamps, &triggers, &self.streams.options())?;
        pairing.warnings.extend(came.warning());
        Ok(pairing)
    }
}

/// An axis of the board, as its column `x_counts` or as `x`.
fn axis(text: &str) -> Result<usize, String> {
    let name = text.strip_suffix("_counts").unwrap_or(text);
    let known = umi_kinematics::COLUMNS;
    known
        .iter()
        .position(|axis| *axis == name)
        .ok_or_else(|| format!("`{text}` is no axis of a board: {}", known.join(", ")))
}
/// No two clocks drift by more than this; what looks like more is another unit of time.
const MOST_DRIFT_PPM: f64 = 10_000.0;

fn drift(text: &str) -> Result<f64, String> {
    at_least_0(text).and_then(|ppm| {
        if ppm <= MOST_DRIFT_PPM {
            return Ok(ppm);
        }
        Err(format!(
            "`{text}` ppm is no drift of a clock: at most {MOST_DRIFT_PPM}"
        ))
    })
}

/// What was paired and what was not, as a few lines.
pub fn text(pairing: &ScanPairing) -> String {
    let mut text = format!(
        "{} profiles have their latch\nclock: board = {:.3} µs + (1 {:+.3} ppm) sensor\n",
        pairing.pairs.len(),
        pairing.clock.offset_us,
        pairing.clock.drift_ppm
    );
    for (what, numbers) in [
        ("profiles without latch", &pairing.unpaired_profiles),
        (
            "of these with another latch or profile as near",
            &pairing.doubtful,
        ),
        ("profiles that came again", &pairing.duplicates),
        (
            "of these profiles of their own, by the sensor's clock",
            &pairing.renumbered,
        ),
        ("latches without profile", &pairing.unpaired_triggers),
    ] {
        if !numbers.is_empty() {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{what}: {} ({})", numbers.len(), listed(numbers));
        }
    }
    for (what, count) in [
        ("frames lost by the sensor's counter", pairing.lost_frames),
        (
            "latches that the board missed or did not tell",
            pairing.missed_latches,
        ),
    ] {
        if count > 0 {
            let _ = writeln!(text, "{what}: {count}");
        }
    }
    for warning in &pairing.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// The first of some numbers.
pub fn listed(numbers: &[u64]) -> String {
    const MOST: usize = 12;
    let first: Vec<String> = numbers.iter().take(MOST).map(u64::to_string).collect();
    let more = if numbers.len() > MOST { ", …" } else { "" };
    first.join(", ") + more
}
