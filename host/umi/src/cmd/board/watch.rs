//! `umi watch`

use std::io::IsTerminal as _;

use crate::failure::Failure;
use crate::interrupt;
use crate::show::terminal::{print, print_json};
use crate::watch::{self, Session, TURN, screen};
use clap::Args;

use crate::cmd::{Board, Format};

/// Watch a board: positions, feed, hits, verdict, link, losses
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Watch {
    #[command(flatten)]
    board: Board,
    /// Show one picture as plain text and end
    #[arg(long)]
    once: bool,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Positions are in millimetres where the board's job says how many counts that is
(counts_per_mm of its witness section), and the control's coordinates where it has
origin_counts too; else they are counts. q, Ctrl-C, the end of its input or of the
terminal ends it; ? explains it. A board that goes away is shown as gone and connected
again. One program at a time can be a board's host.

Examples:
  umi watch                             the only board that is plugged in
  umi watch --port /dev/ttyACM0
  umi watch --port tcp://localhost:7001 --once
  umi watch --json | jq .positions      ten lines a second

A machine and board to watch:
  umi machine run probe.nc --scene scene.toml --board virtual --job job.toml --usb tcp:7001";

impl Watch {
    pub fn run(self) -> Result<(), Failure> {
        let mut session = Session::open(self.board.address(), self.board.key()?)?;
        if self.once {
            // Two looks, so that there is a feed.
            std::thread::sleep(TURN);
            session.turn();
            if self.format.json {
                return print_json(&session.view().json());
            }
            const WIDTH: u16 = 120;
            return print(&screen::text(session.view(), WIDTH));
        }
        if self.format.json {
            interrupt::watch();
            while !interrupt::came() {
                session.turn();
                print_json(&session.view().json())?;
                std::thread::sleep(TURN);
            }
            return Ok(());
        }
        if !std::io::stdout().is_terminal() {
            return Err(Failure::trouble(
                "usage",
                "this is no terminal: --once prints one picture as text, --json ten lines a second",
            ));
        }
        watch::run(session)
    }
}
