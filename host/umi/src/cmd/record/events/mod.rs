//! `umi events`

mod scan;
mod sink;

use std::path::PathBuf;
use std::time::Duration;

use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{BAD, GOOD, count, paint, print, print_error, print_json};
use clap::{Args, ValueEnum};
use serde_json::json;
use umi_client::axes::Scale;
use umi_client::journal::guarding::Guarding;
use umi_client::journal::{self, FileItem, PullRequest};
use umi_client::timeline::{Follower, LatchTally, TimelineEntry};
use umi_core::journal::Entry;
use umi_protocol::message::Record;

use crate::cmd::{Board, Format};
pub(in crate::cmd) use scan::{Following, Rhythm, Scan};
pub(in crate::cmd) use sink::Sink;

/// Show or record what happens on a board; run a scan
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Events {
    /// What happened according to this pulled journal, instead of what happens
    #[arg(value_name = "FILE.umij", conflicts_with = "Scan")]
    file: Option<PathBuf>,
    #[command(flatten)]
    board: Board,
    /// What happened according to the board's journal, instead of what happens
    #[arg(long, conflicts_with_all = ["file", "Scan"])]
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
axis5_counts, axis6_counts, x_mm, y_mm, z_mm, lost, what. `what` says what a loss is of:
`motion` or `transitions`, and counts are wrong from t_ns on; `edges`, `latches`, `counted`
or `events`, and only a message is missing. What a board has not or nobody knows is empty. Millimetres need the job's witness section; they are the control's coordinates
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

pub(in crate::cmd) fn seconds(text: &str) -> Result<Duration, String> {
    let wrong = || format!("`{text}` is no time: give seconds above 0, as 2.5");
    let seconds: f64 = text.parse().map_err(|_| wrong())?;
    let lasting = Duration::try_from_secs_f64(seconds).map_err(|_| wrong())?;
    (!lasting.is_zero()).then_some(lasting).ok_or_else(wrong)
}

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
        let bytes = journal::load(path)?;
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
        sink.guarding = Guarding::of(board.status()?.access);
        let following = Following {
            scan: &self.scan,
            lasting: self.lasting,
            rhythm: Rhythm::Even,
        };
        following.run(&mut board, sink, follower, &mut |_, _| Ok(()))
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
        if let Record::JobSet { job, .. } = &record {
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

impl Kind {
    /// What kind a record is.
    pub fn of(record: &Record) -> Self {
        match record {
            Record::Feature(_) => Self::Features,
            Record::Verdict(_) => Self::Verdicts,
            Record::Fault(_) | Record::FaultsAgain { .. } => Self::Faults,
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
