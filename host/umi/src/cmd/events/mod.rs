//! `umi events`

mod sink;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::failure::Failure;
use crate::interrupt;
use crate::output::Force;
use crate::show::terminal::{BAD, GOOD, count, paint, print, print_error, print_json};
use clap::{Args, ValueEnum};
use serde_json::json;
use umi_client::axes::{self, Scale};
use umi_client::journal::{self, FileItem, PullRequest};
use umi_client::link::Client;
use umi_client::timeline::{Follower, LatchTally, TimelineEntry};
use umi_core::journal::Entry;
use umi_protocol::latch::TriggerOut;
use umi_protocol::message::Record;

use super::{Board, Format};
use sink::Sink;

/// Show or record what happens on a board; run a scan
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Events {
    /// What happened according to this pulled journal, instead of what happens
    #[arg(value_name = "FILE.umij")]
    file: Option<PathBuf>,
    #[command(flatten)]
    board: Board,
    /// What happened according to the board's journal, instead of what happens
    #[arg(long, conflicts_with = "file")]
    journal: bool,
    /// Only these; losses are shown always
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    only: Vec<Kind>,
    /// Stop after this many seconds
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds,
          conflicts_with_all = ["file", "journal"])]
    lasting: Option<Duration>,
    /// Stop after this many; losses do not count
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Latches as a table for spreadsheets, one row each
    #[arg(long, conflicts_with_all = ["json", "only"])]
    csv: bool,
    /// Write to this file
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    scan: Scan,
    #[command(flatten)]
    pub format: Format,
}

/// What the board does for a scanner while the connection lasts.
#[derive(Args)]
#[group(multiple = true, conflicts_with_all = ["file", "journal"])]
#[command(next_help_heading = "A scan, as long as this runs")]
struct Scan {
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
    /// Enable the scanner's laser
    #[arg(long)]
    laser: bool,
}

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Lines from the control
    Lines,
    /// Hits as the control reported them
    Hits,
    /// Axes captured at an edge of probe, trigger, trigger pulse or index mark
    Latches,
    /// Fitted features
    Features,
    /// Verdicts
    Verdicts,
    /// What was damaged or not understood
    Faults,
    /// Everything else that goes into the journal
    Records,
}

const HELP: &str = "\
What was lost stands where it is missing, and is counted at the end. Ctrl-C ends it
properly. Trigger pulses and laser last as long as the connection: the board switches
them off when this command ends, however it ends, or stands still for five seconds.

Columns of --csv: event (latch or loss), number (of its cause), cause (skip, trigger,
output, index), t_ns (board's clock), x_counts, y_counts, z_counts, w_counts,
axis5_counts, axis6_counts, x_mm, y_mm, z_mm, lost. What a board has not or nobody knows
is empty. Millimetres need the job's witness section; they are the control's coordinates
if it has origin_counts, else they begin where the counter shows 0.

Examples:
  umi events                            what happens on the only board that is plugged in
  umi events --only hits,verdicts --port /dev/ttyACM0
  umi events --json --for 60 | jq 'select(.type==\"latch\")'
  umi events --csv -o scan.csv --trigger-every-mm 0.1 --axis x --laser
  umi events --csv -o scan.csv --trigger-every-us 100 --for 30
  umi events monday.umij --csv -o hits.csv
  umi events --journal --only faults

Exit status: 0 nothing was lost, 1 file, usage or connection, 2 something was lost, or
the board cannot do that scan.";

fn seconds(text: &str) -> Result<Duration, String> {
    let wrong = || format!("`{text}` is no time: give seconds above 0, as 2.5");
    let seconds: f64 = text.parse().map_err(|_| wrong())?;
    let lasting = Duration::try_from_secs_f64(seconds).map_err(|_| wrong())?;
    (!lasting.is_zero()).then_some(lasting).ok_or_else(wrong)
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

impl Events {
    pub fn run(self) -> Result<(), Failure> {
        let mut sink = Sink::open(&self)?;
        let mut follower = Follower::default();
        let ended = match &self.file {
            Some(path) => self.tell_file(path, &mut sink, &mut follower),
            None => self.tell_board(&mut sink, &mut follower),
        };
        let kept = sink.close();
        if self.format.json {
            self.end(&sink, &follower.tally, ended.is_ok())?;
        }
        ended.map_err(|failure| sink.kept(failure))?;
        kept?;
        self.sum_up(&sink, &follower.tally)
    }

    fn tell_file(
        &self,
        path: &std::path::Path,
        sink: &mut Sink,
        follower: &mut Follower,
    ) -> Result<(), Failure> {
        let bytes = std::fs::read(path).map_err(|error| Failure::file("read", path, &error))?;
        journal::read(&bytes, |item| match item {
            FileItem::Entry(entry) => self.entry(&entry, sink, follower),
            FileItem::Gap(gap) => sink.overwritten(gap),
        })?;
        journal::verify::verify(&bytes, None, None)?;
        Ok(())
    }

    fn tell_board(&self, sink: &mut Sink, follower: &mut Follower) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        if self.journal {
            journal::pull(&mut board, PullRequest::default(), |step| match step {
                journal::PullStep::Header(..) => Ok(()),
                journal::PullStep::Gap(gap) => sink.overwritten(gap),
                journal::PullStep::Entry(entry, _) => self.entry(&entry, sink, follower),
            })?;
            return Ok(());
        }
        sink.scale = Scale::of(board.job()?.job.as_ref());
        let pulses = self.scan.pulses(&sink.scale)?;
        let (before, from) = (board.status()?, board.positions()?);
        board.live(true)?;
        // From when the board may have heard us: before it is asked.
        let mut beat = Instant::now();
        self.scan.begin(&mut board, pulses)?;
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
                board.positions()?;
                beat = now;
            }
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
        self.scan.end(&mut board, pulses)?;
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
            follower.moved(&from, &to, tell);
        })
    }

    /// An entry of a journal.
    fn entry(
        &self,
        entry: &Entry<'_>,
        sink: &mut Sink,
        follower: &mut Follower,
    ) -> Result<(), Failure> {
        let (seq, t_us) = (entry.seq, entry.t.0);
        let record = match journal::record(entry) {
            Ok(record) => record,
            Err(unreadable) => return sink.unreadable(seq, t_us, unreadable),
        };
        if let Record::JobSet(job) = &record {
            sink.scale = Scale::of(Some(job));
        }
        sink.take(|mut tell| {
            follower.scan(&record, &mut tell);
            follower.record(seq, t_us, record, tell);
        })
    }

    /// The last line for machines, also where the connection was lost.
    fn end(&self, sink: &Sink, tally: &LatchTally, complete: bool) -> Result<(), Failure> {
        print_json(&json!({
            "type": "end",
            "complete": complete,
            "shown": sink.shown,
            "latches": tally.latches,
            "latches_lost": tally.latches_lost,
            "events_lost": tally.events_lost,
            "bytes_lost": tally.bytes_lost,
            "positions_lost": tally.positions_lost,
            "file": self.output.as_ref().map(|path| path.display().to_string()),
        }))
    }

    fn sum_up(&self, sink: &Sink, tally: &LatchTally) -> Result<(), Failure> {
        if !self.format.json {
            let text = format!("{}{}\n", said(sink.shown, tally), sink.where_to());
            if self.csv && self.output.is_none() {
                // Not among the rows.
                print_error(&text);
            } else {
                print(&text)?;
            }
        }
        if tally.lost() {
            Err(Failure::Negative)
        } else {
            Ok(())
        }
    }
}

fn said(shown: u64, tally: &LatchTally) -> String {
    let lost: Vec<String> = [
        (tally.latches_lost, "edges and latches"),
        (tally.events_lost, "events"),
        (tally.bytes_lost, "bytes from the control"),
        (tally.positions_lost, "times the axes: positions are wrong"),
    ]
    .into_iter()
    .filter(|(n, _)| *n > 0)
    .map(|(n, what)| format!("{n} {what}"))
    .collect();
    let verdict = if lost.is_empty() {
        paint(GOOD, "nothing lost")
    } else {
        paint(BAD, format_args!("lost: {}", lost.join(", ")))
    };
    format!("{}, {verdict}", count(shown, "event"))
}

impl Scan {
    /// The pulses that are asked for.
    fn pulses(&self, scale: &Scale) -> Result<Option<TriggerOut>, Failure> {
        let usage = |message: String| Failure::trouble("usage", message);
        if let Some(interval_us) = self.trigger_every_us {
            return Ok(Some(TriggerOut::Time { interval_us }));
        }
        let Some(axis) = self.axis else {
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
        }))
    }

    fn begin(&self, board: &mut Client, pulses: Option<TriggerOut>) -> Result<(), Failure> {
        let refused = |what: &str| Failure::refused("not_on_this_board", what);
        if self.laser && !board.laser(true)? {
            return Err(refused("this board has no output for a laser"));
        }
        match pulses {
            Some(pulses) if !board.trigger_out(pulses)? => Err(refused(
                "this board cannot send such trigger pulses: it has no output for them, no \
                 such axis, or cannot keep that interval",
            )),
            _ => Ok(()),
        }
    }

    fn end(&self, board: &mut Client, pulses: Option<TriggerOut>) -> Result<(), Failure> {
        if pulses.is_some() {
            board.trigger_out(TriggerOut::Off)?;
        }
        if self.laser {
            board.laser(false)?;
        }
        Ok(())
    }
}

impl Kind {
    /// What kind a record is.
    pub fn of(record: &Record) -> Self {
        match record {
            Record::Feature(_) => Self::Features,
            Record::Verdict(_) => Self::Verdicts,
            Record::Fault(_) => Self::Faults,
            Record::Latch(_) => Self::Latches,
            _ => Self::Records,
        }
    }
}

/// What kind of happening it is; none: shown always.
fn kind(of: &TimelineEntry) -> Option<Kind> {
    match of {
        TimelineEntry::Line(_) => Some(Kind::Lines),
        TimelineEntry::Hit(_) => Some(Kind::Hits),
        TimelineEntry::Latch(..) => Some(Kind::Latches),
        TimelineEntry::Record { record, .. } => Some(Kind::of(record)),
        TimelineEntry::Loss(_) => None,
    }
}
