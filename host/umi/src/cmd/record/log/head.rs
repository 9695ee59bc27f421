//! `umi log head`: the board's signature over its journal, to be kept.

use std::path::PathBuf;

use clap::Args;
use umi_client::files::head_file;
use umi_client::journal::{self, PATIENCE, Unsigned, key_id};

use super::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{GOOD, paint, print, print_json};

/// Ask a board for a signed head of its journal, and keep it
#[derive(Args)]
#[command(after_help = "\
A head vouches for everything that the journal held before it. Kept elsewhere it shows later that
a file was cut short, or that the board's memory was put back: `umi log verify --after`.

Examples:
  umi log head
  umi log head -o friday.head --port /dev/ttyACM0")]
pub(super) struct ShowHead {
    /// Write it to this file, too
    #[arg(short, long, value_name = "FILE.head")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl ShowHead {
    pub fn run(self) -> Result<(), Failure> {
        if let Some(path) = &self.output {
            self.force.check(path, &[])?;
        }
        let mut board = self.board.connect()?;
        let head = match journal::head(&mut board, journal::nonce()?, PATIENCE)? {
            Ok(head) => head,
            Err(why) => return Err(unsigned(why)),
        };
        if let Some(path) = &self.output {
            let text = head_file::text(&head);
            self.force.write(path, &[], text)?;
        }
        if self.format.json {
            return print_json(&head_file::json(&head));
        }
        print(&format!(
            "{}\nboard {}, firmware {}, start {}\nchain value {}\nkey {}\n",
            paint(GOOD, format_args!("signed up to entry {}", head.seq)),
            head.serial,
            head.firmware,
            head.boot,
            journal::hex(&head.chain),
            key_id(&head.key),
        ))
    }
}

/// Why there is no head.
pub fn unsigned(why: Unsigned) -> Failure {
    let message = match why {
        Unsigned::NoKey => "this board has no key: it signs nothing",
        Unsigned::Busy => {
            "the board has not signed in five seconds: a clamping is under way, its journal is full, or others asked too often; wait ten minutes or use --key"
        }
        Unsigned::Full => {
            "the board has not signed in five seconds: its journal has no room until somebody acknowledges what it holds (umi log pull, then umi log ack), or a clamping is under way"
        }
        Unsigned::Overtaken => {
            "the board has overwritten entries meanwhile that no head stands behind: pull again"
        }
    };
    Failure::refused(why.code(), message)
}
