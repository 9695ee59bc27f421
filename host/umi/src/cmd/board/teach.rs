//! `umi teach`

use crate::failure::Failure;
use crate::show::terminal::{GOOD, count, paint, print, print_json};
use clap::Args;
use serde_json::json;
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
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi teach                             then clamp the part as programmed, and probe it
  umi teach --again --port /dev/ttyACM0
  umi teach --more                      then probe, as often as you like: each time once

A job with `teach = \"asked\"` teaches nothing by itself. If the clamping is NG, nothing is
taught: ask again. A checked line asks as well: `G65 P8811 T1.` (T2. replaces), for its own run
alone. `umi teach` cannot name a run: text of an old one that comes late may teach in place of the
one that is meant. So let the control read in the run that teaches, as in every run. A control that
reads in another run stops with UMI TAUGHT BY RUN; a run that nothing was read in is no reference
for another (taught_unread). Where the control does not read (`send`), the run that taught is told
once (taught_by_run). Then teach again, or probe once more. umi info and umi watch say what was
asked for and has not happened yet, by whom and since when. A board that starts anew has not been
asked.

What a job holds against the taught clamping (`[guards.learned]`) is one sample of what probe and
balls do. With --more each further clamping that is OK without those limits moves them to the
smallest and the largest that was taught. umi job show says what was learned.

Exit status: 0 the next clamping teaches, 1 usage or connection, 2 the board refuses.";

impl Teach {
    pub fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let what = match (self.again, self.more) {
            (_, true) => TeachWhat::More,
            (true, _) => TeachWhat::Again,
            _ => TeachWhat::Reference,
        };
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
            _ => "the clamping that is probed next is to be the reference".to_owned(),
        };
        print(&format!("{}\n", paint(GOOD, said)))
    }
}
