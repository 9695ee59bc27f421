//! `umi selftest`

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use umi_client::board::port;
use umi_client::board::selftest::{self, SelfTest};
use umi_client::problem::Problem;

use crate::cmd::{Board, Format};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{BAD, GOOD, PLAIN, Table, one_line, paint, print, print_json};
use crate::show::text::printable;

/// Let a board test itself, and show the table of what it promises and measures
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi selftest                                  the only board that is plugged in
  umi selftest --port /dev/ttyACM0 -o board-7.json
  umi selftest --restarts 100 --json

The board needs the image of the test: `cargo xtask firmware selftest-pico` makes pico-selftest.uf2,
which is copied onto the drive that the board shows while BOOTSEL is pressed. It drives its own
encoder, skip, trigger and index pins: nothing may be connected to them. It panics, faults and
overflows its stack on purpose, so it takes three seconds until its port is there. A Nucleo's is
`selftest-nucleo`: by a debug probe, with eight jumpers.

A test that stands still or is cut keeps what has come of its table: `complete` is false.

Exit status: 0 all rows pass, 1 usage or connection, 2 a row fails or the table is not complete.")]
pub(crate) struct Selftest {
    #[command(flatten)]
    board: Board,
    /// How often the rings of samples are restarted
    #[arg(long, value_name = "NUMBER", default_value_t = 10_000,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    restarts: u32,
    /// How many edges of each input are driven, and how many trigger pulses sent
    #[arg(long, value_name = "NUMBER", default_value_t = 40,
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    edges: u32,
    /// How long to wait for a row, at most
    #[arg(long, value_name = "SECONDS", default_value_t = 60,
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    seconds: u64,
    /// Keep the table in this file, as JSON
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    format: Format,
}

impl Selftest {
    pub fn run(self) -> Result<(), Failure> {
        if let Some(output) = &self.output {
            self.force.check(output, &[])?;
        }
        let mut port = port::open(self.board.address())?;
        let patience = Duration::from_secs(self.seconds);
        let bar = ProgressBar::new_spinner()
            .with_style(style())
            .with_message("waiting for the board's first row");
        bar.enable_steady_tick(Duration::from_millis(200));
        let asked = (self.restarts, self.edges);
        let (table, whole) = selftest::run(port.as_mut(), asked, patience, |table| {
            if let Some(row) = table.rows.last() {
                let name = printable(row.name.as_bytes());
                bar.set_message(format!("{} rows, the last: {name}", table.rows.len()));
            }
        });
        bar.finish_and_clear();
        let missing = match whole {
            Err(problem) if table.rows.is_empty() => return Err(problem.into()),
            whole => whole.err(),
        };
        let told = told(&table, missing.as_ref());
        if let Some(output) = &self.output {
            let text = format!("{told:#}\n");
            self.force.write(output, &[], text.as_bytes())?;
        }
        if self.format.json {
            print_json(&told)?;
        } else {
            show(&table, missing.as_ref())?;
        }
        match (missing, table.failed().count()) {
            (None, 0) => Ok(()),
            _ => Err(Failure::Negative),
        }
    }
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{spinner} {elapsed}, {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_spinner())
}

/// What has come, and why it is not all.
fn told(table: &SelfTest, missing: Option<&Problem>) -> Value {
    let mut told = json!(table);
    told["complete"] = json!(missing.is_none());
    told["passed"] = json!(missing.is_none() && table.failed().count() == 0);
    if let Some(missing) = missing {
        told["error"] = missing.json()["error"].clone();
    }
    told
}

fn show(table: &SelfTest, missing: Option<&Problem>) -> Result<(), Failure> {
    let mut rows = Table::new("<>>< ").titles(&["", "promised", "measured", "", ""]);
    for row in &table.rows {
        let (style, says) = match row.passed {
            true => (GOOD, "pass"),
            false => (BAD, "FAIL"),
        };
        rows.styled([
            (PLAIN, row.name.clone()),
            (PLAIN, row.promised.to_string()),
            (PLAIN, row.measured.to_string()),
            (PLAIN, row.unit.clone()),
            (style, says.to_owned()),
        ]);
    }
    print(&format!("{rows}"))?;
    let rows = table.rows.len();
    let says = match (missing, table.failed().count()) {
        (Some(missing), failed) => paint(
            BAD,
            format!("not to its end: {failed} of the {rows} rows that came fail, then {missing}"),
        ),
        (None, 0) => paint(GOOD, format!("all {rows} rows pass")),
        (None, failed) => paint(BAD, format!("{failed} of {rows} rows fail")),
    };
    print(&format!(
        "\n{}, firmware {}: {says}\n",
        one_line(&table.board),
        one_line(&table.firmware)
    ))
}
