//! `umi teach`

use crate::failure::Failure;
use crate::show::terminal::{GOOD, count, paint, print, print_json};
use clap::Args;
use serde_json::json;
use umi_protocol::job::Doubt;
use umi_protocol::message::TeachWhat;

use crate::cmd::{Board, Format};

/// Make the clamping that is probed next the reference
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Teach {
    #[command(flatten)]
    board: Board,
    /// Replace the reference that there is: it is forgotten at once
    #[arg(long)]
    again: bool,
    /// Keep the reference, and widen the limits on radius, rms and centring by what the next
    /// clamping shows: it counts if it is OK without them
    #[arg(long, conflicts_with = "again")]
    more: bool,
    /// Keep the reference that this run has taught: it is the run that was meant, and no old text
    #[arg(long, value_name = "RUN", conflicts_with_all = ["again", "more"])]
    keep: Option<u32>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi teach                             then clamp the part as programmed, and probe it
  umi teach --again --port /dev/ttyACM0
  umi teach --more                      then probe, as often as you like: each time once
  umi teach --keep 17                   run 17 has taught, and it is the one that was meant

A job with `teach = \"asked\"` teaches nothing by itself. If the clamping is NG, nothing is
taught: ask again. A checked line asks as well: `G65 P8811 T1.` (T2. replaces), for its own run
alone. `umi teach` and the button cannot name a run: text of an old one that comes late may teach in
place of the one that is meant. So other runs are NG (taught_unread) until something says which run
that was: `umi teach --keep RUN`, or the control, where it asks for the correction in the run that
taught and gets the program by which it compares the runs (in another run it stops with UMI TAUGHT BY
RUN: then `umi teach --again`; a READ before the meant run begins counts, too). Only --keep says it on
Siemens and Heidenhain, which stop with that alarm and compare nothing, in EIA, by XMODEM, without
`run_variable`, with `send = \"never\"`, and for programs that are read. umi info and umi watch say what was
asked for and has not happened yet, by whom and since when. A board that starts anew has not been
asked. A clamping under way is given up by --again, and is NG.

What a job holds against the taught clamping (`[guards.learned]`) is one sample of what probe and
balls do. With --more each further clamping that is OK without those limits moves them to the
smallest and the largest that was taught. umi job show says what was learned.

Exit status: 0 the next clamping teaches, 1 usage or connection, 2 the board refuses.";

impl Teach {
    pub fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let what = match (self.again, self.more, self.keep) {
            (.., Some(_)) => TeachWhat::Keep,
            (_, true, _) => TeachWhat::More,
            (true, ..) => TeachWhat::Again,
            _ => TeachWhat::Reference,
        };
        if let Some(run) = self.keep {
            let learned = board.job()?.learned;
            let taught = learned.run;
            let message = match learned.doubt {
                Doubt::None | Doubt::Unread if taught == run || learned.smallest.is_empty() => None,
                Doubt::None | Doubt::Unread => Some(format!(
                    "run {taught} has taught, not run {run}: if run {run} was meant, teach again (umi teach --again)"
                )),
                // Of two setups that lines teach, --keep says nothing.
                Doubt::First | Doubt::Again => Some(format!(
                    "a line (T1. or T2.) of run {taught} has taught: probe once without it, or teach again (umi teach --again)"
                )),
            };
            if let Some(message) = message {
                return Err(Failure::refused("other_run", message));
            }
        }
        if let Err(refusal) = board.teach(what)? {
            return Err(Failure::refused(refusal.code(), refusal));
        }
        let taught = 1 + u32::from(board.job()?.learned.further);
        if self.format.json {
            let teachings = self.more.then_some(taught);
            return print_json(&json!({ "status": "ok", "teachings_so_far": teachings }));
        }
        let said = match what {
            TeachWhat::More => format!(
                "the clamping that is probed next is to widen what {} taught",
                count(taught.into(), "clamping")
            ),
            TeachWhat::Keep => "the reference holds: other runs are measured by it".to_owned(),
            _ => "the clamping that is probed next is to be the reference".to_owned(),
        };
        print(&format!("{}\n", paint(GOOD, said)))
    }
}
