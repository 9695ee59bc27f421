//! `umi access`: whose board it is.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::json;
use umi_client::files::key_file;
use umi_client::journal::{self, PATIENCE, hex, key_id};

use crate::cmd::record::log::unsigned;
use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{GOOD, paint, print, print_json};

/// The key with which a board signs its journal
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi access board-key -o board.pub")]
pub(crate) struct Access {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    BoardKey(BoardKey),
}

/// Ask a board for its public key, and have it show that it has the secret one
#[derive(Args)]
#[command(after_help = "\
Ask at the board, over its own cable, and keep the file where nobody else can change it: it is
what `umi log verify --key` rests on.

Examples:
  umi access board-key -o board.pub
  umi access board-key --json")]
struct BoardKey {
    /// Write it to this file
    #[arg(short, long, value_name = "BOARD.pub")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Access {
    pub fn run(self) -> Result<(), Failure> {
        let Action::BoardKey(command) = self.action;
        command.run()
    }
}

impl BoardKey {
    fn run(self) -> Result<(), Failure> {
        if let Some(path) = &self.output {
            self.force.check(path, &[])?;
        }
        let mut board = self.board.connect()?;
        // A head over our nonce: who signs it has the key.
        let head = match journal::head(&mut board, journal::nonce()?, PATIENCE)? {
            Ok(head) => head,
            Err(why) => return Err(unsigned(why)),
        };
        if let Some(path) = &self.output {
            let text = key_file::public_text(&head.key)?;
            self.force.write(path, &[], text)?;
        }
        if self.format.json {
            return print_json(&json!({
                "key_id": key_id(&head.key),
                "public": hex(&head.key),
                "serial": head.serial.as_str(),
                "file": self.output.map(|path| path.display().to_string()),
            }));
        }
        let to = self
            .output
            .map_or(String::new(), |path| format!(", in {}", path.display()));
        print(&format!(
            "{}{to}\n{}\n",
            paint(
                GOOD,
                format_args!("key {} of board {}", key_id(&head.key), head.serial)
            ),
            hex(&head.key),
        ))
    }
}
