//! What the board does for a scanner while it is followed.

use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use umi_client::axes::{self, Scale};
use umi_client::board::link::Client;
use umi_client::timeline::{Follower, LatchTally};
use umi_desk::pulsed::{SIGNATURE_TENTHS, STRETCH_PULSES};
use umi_protocol::latch::{SignalLevel, TriggerOut, TriggerPulse, TriggerRefusal};

use super::Sink;
use crate::failure::Failure;
use crate::interrupt;

/// What the board does for a scanner while the connection lasts.
#[derive(Args)]
#[group(multiple = true)]
#[command(next_help_heading = "A scan, as long as this runs")]
pub(crate) struct Scan {
    /// A trigger pulse each so many millimetres along an axis; the job's witness section
    /// says how many counts that is
    #[arg(long, value_name = "MM", requires = "axis",
          conflicts_with_all = ["trigger_every_counts", "trigger_every_us"])]
    trigger_every_mm: Option<f64>,
    /// A trigger pulse each so many encoder counts along an axis
    #[arg(long, value_name = "N", requires = "axis", conflicts_with = "trigger_every_us",
          value_parser = clap::value_parser!(u32).range(1..))]
    trigger_every_counts: Option<u32>,
    /// A trigger pulse each so many microseconds
    #[arg(long, value_name = "US", conflicts_with = "axis",
          value_parser = clap::value_parser!(u32).range(1..))]
    trigger_every_us: Option<u32>,
    /// The axis of the trigger pulses: x, y, z, w, axis5 or axis6
    #[arg(long, value_parser = axis)]
    axis: Option<u8>,
    /// How long each trigger pulse is, 1 to 1000 us. Without, 20 us: what a Gocator needs
    #[arg(long, value_name = "US", value_parser = clap::value_parser!(u16)
          .range(i64::from(TriggerPulse::LEAST_US)..=i64::from(TriggerPulse::MOST_US)))]
    trigger_width_us: Option<u16>,
    /// The level of the trigger output between pulses. Without, low; it stays after the scan
    #[arg(long, value_name = "LEVEL")]
    trigger_rests: Option<Rest>,
    /// Enable the scanner's laser
    #[arg(long)]
    laser: bool,
}

/// The level of the output between pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Rest {
    /// A pulse is high
    Low,
    /// A pulse is low
    High,
}

fn axis(text: &str) -> Result<u8, String> {
    let place = axes::NAMES
        .iter()
        .position(|name| name.eq_ignore_ascii_case(text));
    place
        .and_then(|place| u8::try_from(place).ok())
        .ok_or_else(|| format!("`{text}` is no axis: give {}", axes::NAMES.join(", ")))
}

/// How long nothing must come after the end of a scan: what is under way arrives.
const QUIET: Duration = Duration::from_millis(150);
/// And how long is waited for that, at most.
const LONGEST_END: Duration = Duration::from_secs(2);
/// How often it is looked whether to stop.
const TURN: Duration = Duration::from_millis(100);
/// How often the board hears of us while it sends pulses or a laser is on; after five seconds
/// without, it switches them off.
const BEAT: Duration = Duration::from_secs(1);
const LONGEST_BEAT: Duration = Duration::from_secs(4);

/// How pulses at a time interval begin.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rhythm {
    /// All alike.
    Even,
    /// With a signature: some stretches of other intervals, so that nothing that is lost at the
    /// beginning can shift the train.
    Signed,
}

/// A stretch takes no less time than this: the link's turns are slower than pulses.
const LEAST_STRETCH: Duration = Duration::from_millis(8);

/// A board that is followed, with what it does for a scanner meanwhile.
pub(crate) struct Following<'a> {
    /// Pulses and laser.
    pub scan: &'a Scan,
    /// How long; without, until an interrupt.
    pub lasting: Option<Duration>,
    /// How pulses in time begin.
    pub rhythm: Rhythm,
}

impl Following<'_> {
    /// Follows it. `turn` is called now and then, with what was lost so far.
    ///
    /// # Errors
    /// The board cannot do the scan, the link's, the sink's, or what `turn` returns.
    pub fn run(
        &self,
        board: &mut Client,
        sink: &mut Sink,
        follower: &mut Follower,
        turn: &mut dyn FnMut(&mut Sink, &LatchTally) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        sink.scale = Scale::of(board.job()?.job.as_ref());
        let pulses = self.scan.pulses(&sink.scale)?;
        let (before, from) = (board.status()?, board.positions()?);
        // Positions that were wrong before are wrong from the beginning on.
        let mut good_ns = if from.lost_samples > 0 { 0 } else { from.t_ns };
        board.live(true)?;
        // From when the board may have heard us: before it is asked.
        let mut beat = Instant::now();
        self.scan.begin(board, pulses, self.rhythm)?;
        let deadline = self.lasting.map(|lasting| Instant::now() + lasting);
        let is_lit = self.scan.laser || pulses.is_some();
        interrupt::watch();
        while !sink.full() && !interrupt::came() {
            let silent = beat.elapsed();
            if is_lit && silent >= LONGEST_BEAT {
                return Err(Failure::trouble(
                    "stood_still",
                    format!(
                        "this program stood still for {:.0} s, and the board switches laser and \
                     trigger pulses off then: begin the scan again",
                        silent.as_secs_f64()
                    ),
                ));
            }
            if is_lit && silent >= BEAT {
                let now = Instant::now();
                let positions = board.positions()?;
                if positions.illegal == from.illegal && positions.lost_samples == 0 {
                    good_ns = positions.t_ns;
                }
                beat = now;
            }
            turn(sink, &follower.tally)?;
            let left = deadline.map_or(TURN, |at| at.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                break;
            }
            if let Some(event) = board.next_event(left.min(TURN))? {
                sink.take(|tell| follower.event(event, tell))?;
            } else {
                sink.flush()?;
            }
        }
        self.scan.end(board, pulses)?;
        let (after, to) = (board.status()?, board.positions()?);
        let deadline = Instant::now() + LONGEST_END;
        while !sink.full() && Instant::now() < deadline {
            let Some(event) = board.next_event(QUIET)? else {
                break;
            };
            sink.take(|tell| follower.event(event, tell))?;
        }
        sink.take(|mut tell| {
            follower.settle(&before, &after, &mut tell);
            follower.moved(&from, &to, good_ns, tell);
        })
    }
}

impl Scan {
    /// Whether the board is to send pulses.
    pub const fn has_pulses(&self) -> bool {
        self.trigger_every_us.is_some() || self.axis.is_some()
    }

    /// The pulses that are asked for.
    pub fn pulses(&self, scale: &Scale) -> Result<Option<TriggerOut>, Failure> {
        let usage = |message: String| Failure::trouble("usage", message);
        let pulse = self.pulse();
        if let Some(interval_us) = self.trigger_every_us {
            return Ok(Some(TriggerOut::Time { interval_us, pulse }));
        }
        let Some(axis) = self.axis else {
            if self.trigger_width_us.is_some() || self.trigger_rests.is_some() {
                return Err(usage(
                    "--trigger-width-us and --trigger-rests are of trigger pulses: give \
                     --trigger-every-us, or --axis and a distance"
                        .into(),
                ));
            }
            return Ok(None);
        };
        let interval_counts = match (self.trigger_every_counts, self.trigger_every_mm) {
            (Some(counts), _) => counts,
            (None, Some(mm)) => {
                let Some(per_mm) = scale.counts_per_mm(axis.into()) else {
                    return Err(usage(
                        "the board's job does not say how many counts of that axis are a millimetre: \
                         give --trigger-every-counts, or a job with a [witness] section"
                            .into(),
                    ));
                };
                if !(mm.is_finite() && mm > 0.0) {
                    return Err(usage(format!(
                        "{mm} mm is no interval: give one above 0, as 0.1"
                    )));
                }
                let counts = (mm * per_mm.abs()).round();
                if !(1.0..=f64::from(u32::MAX)).contains(&counts) {
                    return Err(usage(format!(
                        "{mm} mm are {counts} counts of that axis ({per_mm} per mm): give an \
                         interval of 1 to {} counts",
                        u32::MAX
                    )));
                }
                counts as u32
            }
            (None, None) => {
                return Err(usage(
                    "--axis is that of trigger pulses: give --trigger-every-mm or \
                     --trigger-every-counts too"
                        .into(),
                ));
            }
        };
        Ok(Some(TriggerOut::Distance {
            axis,
            interval_counts,
            pulse,
        }))
    }

    /// Each pulse.
    fn pulse(&self) -> TriggerPulse {
        let usual = TriggerPulse::default();
        TriggerPulse {
            width_us: self.trigger_width_us.unwrap_or(usual.width_us),
            rests: match self.trigger_rests {
                Some(Rest::Low) => SignalLevel::Low,
                Some(Rest::High) => SignalLevel::High,
                None => usual.rests,
            },
        }
    }

    fn begin(
        &self,
        board: &mut Client,
        pulses: Option<TriggerOut>,
        rhythm: Rhythm,
    ) -> Result<(), Failure> {
        if self.laser && !board.laser(true)? {
            let what = "this board has no output for a laser";
            return Err(Failure::refused("not_on_this_board", what));
        }
        if let (Some(TriggerOut::Time { interval_us, pulse }), Rhythm::Signed) = (pulses, rhythm) {
            for tenths in SIGNATURE_TENTHS {
                let interval_us = u64::from(interval_us) * u64::from(tenths) / 10;
                let Ok(interval_us) = u32::try_from(interval_us) else {
                    break;
                };
                let stretch = TriggerOut::Time { interval_us, pulse };
                if board.trigger_out(stretch)?.is_err() {
                    break; // What is wanted is refused below.
                }
                let stretch = Duration::from_micros(interval_us.into()) * STRETCH_PULSES;
                std::thread::sleep(stretch.max(LEAST_STRETCH));
            }
        }
        match pulses {
            Some(pulses) => board.trigger_out(pulses)?.map_err(refused),
            None => Ok(()),
        }
    }

    fn end(&self, board: &mut Client, pulses: Option<TriggerOut>) -> Result<(), Failure> {
        if pulses.is_some() {
            board.trigger_out(TriggerOut::Off)?.map_err(refused)?;
        }
        if self.laser {
            board.laser(false)?;
        }
        Ok(())
    }
}

/// Why the board does not send such pulses.
fn refused(why: TriggerRefusal) -> Failure {
    Failure::refused(why.into(), why.to_string())
}
