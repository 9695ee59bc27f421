//! `umi teach`

use crate::failure::Failure;
use crate::show::terminal::{GOOD, paint, print, print_json};
use clap::Args;
use serde_json::json;

use super::{Board, Format};

/// Make the clamping that is probed next the reference
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Teach {
    #[command(flatten)]
    board: Board,
    /// Replace the reference that there is: it is forgotten at once
    #[arg(long)]
    again: bool,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi teach                             then clamp the part as programmed, and probe it
  umi teach --again --port /dev/ttyACM0

A job with `teach = \"asked\"` teaches nothing by itself. If the clamping is NG, nothing is
taught: ask again. A checked line asks as well: `G65 P8811 T1.` (T2. replaces).

Exit status: 0 the next clamping teaches, 1 usage or connection, 2 the board refuses.";

impl Teach {
    pub fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        if let Err(refusal) = board.teach(self.again)? {
            return Err(Failure::refused(refusal.code(), refusal));
        }
        if self.format.json {
            return print_json(&json!({ "status": "ok" }));
        }
        let said = "the clamping that is probed next is to be the reference";
        print(&format!("{}\n", paint(GOOD, said)))
    }
}
