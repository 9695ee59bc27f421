//! `umi wipe`: a board forgets everything but its own key.

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use umi_client::board::link::{Client, LinkError};
use umi_client::board::port;
use umi_client::journal::key_id;
use umi_client::problem::Problem;

use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::show::terminal::{GOOD, paint, print, print_json};

/// How long a board may take to come back.
const PATIENCE: Duration = Duration::from_secs(60);

/// Have a board forget everything: keys, configuration, job, reference, programs, journal
#[derive(Args)]
#[command(after_help = "\
It needs the board's jumper, closed at the start and now, and an owner's key. Where the key is lost,
the jumper alone is enough if it was closed at two starts in a row. Pull the journal before: it goes,
too. What stays is the board's own key, and in the new journal a signed record of what the old one
held (`wiped`). A key of its own that cannot be read any more is drawn anew.

Examples:
  umi log pull last.umij --key anna
  umi wipe --yes --key anna
  umi wipe --yes                        the jumper was closed at this start and the one before")]
pub(crate) struct Wipe {
    /// Yes, all of it
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl Wipe {
    pub fn run(self) -> Result<(), Failure> {
        if !self.yes {
            return Err(Failure::trouble(
                "usage",
                "this takes everything away that the board holds: say --yes if that is meant",
            ));
        }
        let mut board = self.board.connect()?;
        let serial = board.identity()?.serial;
        let before = board.access()?;
        if !board.wipe()? {
            return Err(not_on_this_board(&mut board));
        }
        drop(board);
        let mut board = comes_back(self.board.address())?;
        let after = board.access()?;
        let mode = after.mode;
        let new_key = after.board_key.filter(|key| before.board_key != Some(*key));
        if self.format.json {
            let key_id = new_key.map(|key| key_id(&key));
            return print_json(
                &json!({"serial": serial.as_str(), "mode": mode, "new_board_key": key_id}),
            );
        }
        let mut done = format!(
            "board {serial} has forgotten everything and is {}",
            mode.name()
        );
        if new_key.is_some() {
            done +=
                ". Its own key could not be read: it signs with a new one (umi access board-key)";
        }
        print(&format!("{}\n", paint(GOOD, done)))
    }
}

/// Waits until a board that starts anew answers.
pub(super) fn comes_back(address: Option<&str>) -> Result<Client, Problem> {
    let until = Instant::now() + PATIENCE;
    loop {
        // It goes away first.
        std::thread::sleep(Duration::from_millis(200));
        let came = port::connect(address).and_then(|mut board| {
            board.identity()?;
            Ok(board)
        });
        match came {
            Ok(board) => return Ok(board),
            Err(problem) if Instant::now() >= until => return Err(problem),
            Err(_) => {}
        }
    }
}

/// What this board cannot do, and why: it reads no jumper, or has no key of its own.
pub(super) fn not_on_this_board(board: &mut Client) -> Failure {
    let has_place = board.access().is_ok_and(|access| access.jumper.is_some());
    Failure::refused(
        "not_on_this_board",
        match has_place {
            true => LinkError::NoSessions.to_string(),
            false => "this board has no place for keys: it is open, and stays so".to_owned(),
        },
    )
}
