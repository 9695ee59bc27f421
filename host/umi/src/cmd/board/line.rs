//! `umi line`

use std::time::Duration;

use crate::failure::Failure;
use crate::show::terminal::{GOOD, Table, paint, print, print_json};
use clap::{Args, Subcommand};
use serde_json::json;
use umi_client::board::line::{self, Listened};
use umi_protocol::serial::{Cts, LEAST_BAUD, LineSettings, MOST_BAUD, USUAL_BAUD};

use crate::cmd::{Board, Format};

/// Find out how the control's serial line is set
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Line {
    #[command(subcommand)]
    action: Action,
}

const HELP: &str = "\
Examples:
  umi line find
  umi line find --seconds 30 --port /dev/ttyACM0";

#[derive(Subcommand)]
enum Action {
    Find(Find),
}

/// Listen at each speed and say which fits
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi line find                            every usual speed, ten seconds at each at most
  umi line find --baud 4800,9600,19200     only these
  umi line find --json

Let the control print again and again meanwhile: a loop of DPRNT lines, for example. A speed
fits where every character has its stop bit and one code's parity, all are characters that
controls print, and lines end. The job of the board does not change; write what was found into
its [line] and set it again.

Exit status: 0 found, 1 usage or connection, 2 no speed fits, or nothing came.")]
struct Find {
    #[command(flatten)]
    board: Board,
    /// How long to listen at each speed, at most
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=600))]
    seconds: u64,
    /// The speeds to try, in this order
    #[arg(long, value_name = "BAUD", value_delimiter = ',',
          value_parser = clap::value_parser!(u32).range(i64::from(LEAST_BAUD)..=i64::from(MOST_BAUD)))]
    baud: Vec<u32>,
    #[command(flatten)]
    format: Format,
}

impl Line {
    pub fn run(self) -> Result<(), Failure> {
        match self.action {
            Action::Find(action) => action.run(),
        }
    }
}

/// What came at a speed; none: the board cannot be set to it.
struct Tried {
    baud: u32,
    came: Option<Listened>,
}

impl Find {
    fn run(self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let bauds = match self.baud.is_empty() {
            true => USUAL_BAUD.to_vec(),
            false => self.baud.clone(),
        };
        let mut tried = Vec::new();
        for baud in bauds {
            let line = LineSettings {
                baud,
                data_bits: 8,
                stop_bits: 1,
                cts: Cts::Ignored,
            };
            let longest = Duration::from_secs(self.seconds);
            let came = match line::listen(&mut board, line, longest)? {
                Ok(came) => Some(came),
                Err(umi_protocol::message::LineRefusal::NotOnThisBoard { .. }) => None,
                Err(refusal) => return Err(Failure::refused(refusal.code(), refusal)),
            };
            let fits = came.as_ref().is_some_and(|came| came.judge().fits);
            tried.push(Tried { baud, came });
            if fits {
                break;
            }
        }
        // It is so as well when this program is gone.
        let _ = board.listen(None)?;
        self.tell(&tried)
    }

    fn tell(&self, tried: &[Tried]) -> Result<(), Failure> {
        let found = tried.iter().find_map(|of| {
            let judged = of.came.as_ref()?.judge();
            judged.fits.then_some((of.baud, judged.coding))
        });
        if self.format.json {
            let rows: Vec<_> = tried.iter().map(row).collect();
            print_json(&json!({
                "found": found.map(|(baud, coding)| json!({
                    "baud": baud,
                    "coding": coding,
                })),
                "tried": rows,
            }))?;
        } else {
            print(&format!("{}", table(tried)))?;
        }
        match found {
            Some(_) if self.format.json => Ok(()),
            Some((baud, coding)) => {
                let says = format!("the control's line fits {baud} baud, {coding}");
                let job = line::in_a_job(baud, coding);
                print(&format!("\n{}\nIn the job:\n{job}\n", paint(GOOD, says)))
            }
            None if tried
                .iter()
                .all(|of| of.came.as_ref().is_none_or(is_silent)) =>
            {
                Err(Failure::refused(
                    "nothing_came",
                    "nothing came at any speed: let the control print meanwhile, and look at plug, TX and RX",
                ))
            }
            None => Err(match (endless(tried), few(tried)) {
                (Some(baud), _) => Failure::refused(
                    "no_line_ends",
                    format_args!(
                        "at {baud} baud every character is right, and no line has ended: let the control print whole lines, \
                         or set its line end to LF or CR LF (EOB)"
                    ),
                ),
                (None, Some((speeds, different))) => Failure::refused(
                    "few_characters",
                    format_args!(
                        "at {speeds} baud every character is right, but only {different} different ones came, and so few can be \
                         others at another speed: let the control print more different characters (a program, not one line \
                         again and again)"
                    ),
                ),
                (None, None) => Failure::refused(
                    "no_speed_fits",
                    "no speed fits: let the control print for longer, ask its parameters, and look at the 0 V wire between the two",
                ),
            }),
        }
    }
}

/// The speed at which only line ends are missing.
fn endless(tried: &[Tried]) -> Option<u32> {
    let is_endless = |of: &&Tried| of.came.as_ref().is_some_and(|came| came.judge().endless);
    tried.iter().find(is_endless).map(|of| of.baud)
}

/// The speeds at which only too few different characters came, and how many these were at most.
fn few(tried: &[Tried]) -> Option<(String, usize)> {
    let few = tried
        .iter()
        .filter_map(|of| Some((of.baud, of.came.as_ref()?.judge().few?)));
    let (speeds, different): (Vec<String>, Vec<usize>) = few
        .map(|(baud, different)| (baud.to_string(), different))
        .unzip();
    Some((speeds.join(" and "), different.into_iter().max()?))
}

fn is_silent(came: &Listened) -> bool {
    came.bytes.is_empty() && came.broken == 0
}

fn row(of: &Tried) -> serde_json::Value {
    let Some(came) = &of.came else {
        return json!({ "baud": of.baud, "on_this_board": false });
    };
    let judged = came.judge();
    json!({
        "baud": of.baud,
        "on_this_board": true,
        "characters": came.bytes.len(),
        "broken": came.broken,
        "strange": judged.strange,
        "coding": judged.coding,
        "line_ends": judged.lines,
        "fits": judged.fits,
    })
}

fn table(tried: &[Tried]) -> Table {
    let titles = ["baud", "characters", "broken", "strange", "line ends", ""];
    let mut table = Table::new(">>>>><").titles(&titles);
    for of in tried {
        let baud = of.baud.to_string();
        let Some(came) = &of.came else {
            table.row([&baud, "-", "-", "-", "-", "not on this board"]);
            continue;
        };
        let judged = came.judge();
        let says = match judged.fits {
            true => format!("fits: {}", judged.coding),
            false if is_silent(came) => "nothing came".into(),
            false => String::new(),
        };
        table.row([
            baud,
            came.bytes.len().to_string(),
            came.broken.to_string(),
            judged.strange.to_string(),
            judged.lines.to_string(),
            says,
        ]);
    }
    table
}
