//! `umi access`: whose board it is.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::json;
use umi_client::files::key_file;
use umi_client::journal::{self, PATIENCE, hex, key_id};
use umi_protocol::head::HeadAnswer;
use umi_protocol::message::AccessMode;

use crate::cmd::record::log::unsigned;
use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, GOOD, paint, print, print_json};

/// Who may do what with a board, and the key with which it signs its journal
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi access show
  umi access board-key -o board.pub")]
pub(crate) struct Access {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    Show(Show),
    BoardKey(BoardKey),
}

/// Show who may do what with a board
#[derive(Args)]
#[command(after_help = "\
open: the board has no owner, and whoever reaches its port may set jobs, put programs and switch
outputs. No firmware can be claimed by an owner yet, and no board reads a jumper (null).

Examples:
  umi access show
  umi access show --json --port /dev/ttyACM0")]
struct Show {
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
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
        match self.action {
            Action::Show(command) => command.run(),
            Action::BoardKey(command) => command.run(),
        }
    }
}

/// What a mode means to somebody at the board.
pub(super) const fn about(mode: AccessMode) -> &'static str {
    match mode {
        AccessMode::Open => "open: whoever reaches the port may do everything",
    }
}

impl Show {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let mode = board.status()?.access;
        // The newest head names the key; a board without one has signed nothing.
        let head = match board.head(None)? {
            HeadAnswer::Signed(head) => Some(head),
            HeadAnswer::NoKey => None,
            // It has just started: one that is asked for comes as soon as it can.
            HeadAnswer::Pending => match journal::head(&mut board, journal::nonce()?, PATIENCE)? {
                Ok(head) => Some(head),
                Err(why) => return Err(unsigned(why)),
            },
        };
        if self.format.json {
            let board_key =
                head.map(|head| json!({"key_id": key_id(&head.key), "public": hex(&head.key)}));
            // An open board knows nobody's key, and so refuses nobody.
            return print_json(&json!({
                "mode": mode,
                "jumper": null,
                "board_key": board_key,
                "keys": [],
                "retry_in_s": 0,
            }));
        }
        let signs = match head {
            Some(head) => format!("signs with key {}", key_id(&head.key)),
            None => "signs nothing".to_owned(),
        };
        print(&format!("{}\n{signs}\n", paint(CAUTION, about(mode))))
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
