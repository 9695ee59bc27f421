//! `umi log ack`: entries are kept elsewhere.

use clap::Args;
use serde_json::json;
use umi_client::board::link::Acknowledged;

use super::{Board, Format};
use crate::failure::Failure;
use crate::show::terminal::{GOOD, paint, print, print_json};

/// Tell a board that everything before an entry is kept elsewhere
#[derive(Args)]
#[command(after_help = "\
Give the `next_seq` that `umi log verify` says of the file that you keep. What the board overwrites
without that is counted and told by `umi info`; with `umi config set journal.full refuse` it overwrites
no evidence and sends nothing until you acknowledge.

Examples:
  umi log ack 1200 --port /dev/ttyACM0")]
pub(super) struct Ack {
    /// The first entry that is not kept yet
    #[arg(value_name = "SEQ")]
    seq: u64,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Ack {
    pub fn run(self) -> Result<(), Failure> {
        let seq = self.seq;
        let mut board = self.board.connect()?;
        match board.journal_ack(seq)? {
            Acknowledged::Done => {}
            Acknowledged::NoEntry(info) => {
                let message = format!(
                    "the journal ends before entry {}: nobody can have kept more",
                    info.next_seq
                );
                let refused = umi_client::problem::Problem::refused("out_of_range", message);
                return Err(refused.with("next_seq", info.next_seq).into());
            }
            Acknowledged::NotOnThisBoard => {
                return Err(Failure::refused(
                    "not_on_this_board",
                    "this board does not keep what was acknowledged",
                ));
            }
        }
        let info = board.journal_info()?;
        if self.format.json {
            return print_json(&json!({
                "acked_seq": info.acked_seq,
                "first_seq": info.first_seq,
                "next_seq": info.next_seq,
                "lost": info.lost,
            }));
        }
        let done = format!("the entries before {} are kept elsewhere", info.acked_seq);
        print(&format!("{}\n", paint(GOOD, done)))
    }
}
