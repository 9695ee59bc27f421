//! The self-test of a board: an image of its own that drives its inputs and sends a table.
//!
//! The table is text over the board's port, fields between tabs, as
//! `firmware/drivers/src/selftest/table.rs` says. Whether a row passes is judged here again,
//! so that what is shown never says more than its own figures.

use std::time::{Duration, Instant};

use serde::Serialize;

use crate::board::link::Transport;
use crate::problem::Problem;

/// The form of the table that is understood.
const VERSION: &str = "1";
/// Nothing in the table is as long; what is comes from something else.
const LONGEST_LINE: usize = 256;
/// A table has a few dozen rows.
const MOST_ROWS: usize = 1000;

/// What a row's figure must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Promised {
    /// Just this.
    Exactly(i64),
    /// Not more than this.
    AtMost(i64),
}

impl Promised {
    fn parse(text: &str) -> Option<Self> {
        match text.strip_prefix("<= ") {
            Some(most) => most.parse().ok().map(Self::AtMost),
            None => text.parse().ok().map(Self::Exactly),
        }
    }

    /// Whether a figure is as promised.
    #[must_use]
    pub const fn holds(self, measured: i64) -> bool {
        match self {
            Self::Exactly(promised) => measured == promised,
            Self::AtMost(most) => measured <= most,
        }
    }
}

impl std::fmt::Display for Promised {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Exactly(promised) => write!(f, "{promised}"),
            Self::AtMost(most) => write!(f, "<= {most}"),
        }
    }
}

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SelfTestRow {
    /// What was measured.
    pub name: String,
    /// What it should be.
    pub promised: Promised,
    /// What it was.
    pub measured: i64,
    /// Of both; empty: a number of things.
    pub unit: String,
    /// Whether it is as promised.
    pub passed: bool,
}

/// A board's table.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SelfTest {
    /// Which board's image it is.
    pub board: String,
    /// Its version.
    pub firmware: String,
    /// How often the rings were to be restarted.
    pub restarts: u32,
    /// How many edges of each input were to be driven.
    pub edges: u32,
    /// In the order of the measurements.
    pub rows: Vec<SelfTestRow>,
}

impl SelfTest {
    /// Rows that are not as promised.
    pub fn failed(&self) -> impl Iterator<Item = &SelfTestRow> {
        self.rows.iter().filter(|row| !row.passed)
    }

    /// Takes a line of the table. True: that was the last.
    ///
    /// # Errors
    /// `bad_selftest`: it is no line of a table, or does not fit those before it.
    pub fn take(&mut self, line: &str) -> Result<bool, Problem> {
        let bad = |why: &str| {
            Problem::trouble(
                "bad_selftest",
                format_args!("{line:?} is no line of a self-test: {why}"),
            )
        };
        let fields: Vec<&str> = line.split('\t').collect();
        match fields[..] {
            ["selftest", VERSION, board, firmware] if self.board.is_empty() => {
                (self.board, self.firmware) = (board.to_owned(), firmware.to_owned());
                Ok(false)
            }
            ["selftest", version, ..] if self.board.is_empty() => Err(bad(&format!(
                "it has version {version}, and 1 is known here"
            ))),
            _ if self.board.is_empty() => Err(bad("the table has not begun")),
            ["row", name, promised, measured, unit, verdict] => {
                let promised = Promised::parse(promised).ok_or_else(|| bad("what is promised"))?;
                let measured = measured.parse().map_err(|_| bad("what was measured"))?;
                let passed = promised.holds(measured);
                if verdict != if passed { "pass" } else { "fail" } {
                    return Err(bad("its verdict is not that of its figures"));
                }
                if self.rows.len() == MOST_ROWS {
                    return Err(bad("there are too many"));
                }
                self.rows.push(SelfTestRow {
                    name: name.to_owned(),
                    promised,
                    measured,
                    unit: unit.to_owned(),
                    passed,
                });
                Ok(false)
            }
            ["end", rows, failed] => {
                let are = [self.rows.len(), self.failed().count()];
                let told = [rows, failed].map(|number| number.parse().ok());
                if told != are.map(Some) || self.rows.is_empty() {
                    return Err(bad("rows are missing"));
                }
                Ok(true)
            }
            _ => Err(bad("it has other fields")),
        }
    }
}

/// Asks for the test with so many restarts of the rings and edges of each input, and waits for its
/// table, at most `patience` for each row. `progress` sees the table after each line of it. What has come
/// of the table, and why it is not all: a board that hangs or resets has shown what it is by then.
///
/// # Errors
/// `no_selftest`: no answer, as of a board with another image; `bad_selftest`; the port's own.
pub fn run(
    port: &mut dyn Transport,
    (restarts, edges): (u32, u32),
    patience: Duration,
    progress: impl FnMut(&SelfTest),
) -> (SelfTest, Result<(), Problem>) {
    let mut table = SelfTest {
        restarts,
        edges,
        ..SelfTest::default()
    };
    let whole = fill(&mut table, port, patience, progress);
    (table, whole)
}

fn fill(
    table: &mut SelfTest,
    port: &mut dyn Transport,
    patience: Duration,
    mut progress: impl FnMut(&SelfTest),
) -> Result<(), Problem> {
    let broken =
        |error| Problem::trouble("disconnected", format_args!("the board's port: {error}"));
    let SelfTest {
        restarts, edges, ..
    } = *table;
    port.write(format!("run {restarts} {edges}\n").as_bytes())
        .map_err(broken)?;
    let mut line = Vec::new();
    let mut buffer = [0; 512];
    let mut latest = Instant::now();
    loop {
        let left = patience.saturating_sub(latest.elapsed());
        let count = port.read(&mut buffer, left).map_err(broken)?;
        if count == 0 && latest.elapsed() >= patience {
            return Err(match table.rows.last() {
                None => Problem::trouble(
                    "no_selftest",
                    "the board does not answer as a self-test: put the image pico-selftest.uf2 on it",
                ),
                Some(row) => Problem::trouble(
                    "no_selftest",
                    format_args!("the self-test stands still behind \"{}\"", row.name),
                ),
            });
        }
        for byte in buffer.iter().take(count) {
            if *byte != b'\n' {
                line.push(*byte);
                if line.len() > LONGEST_LINE {
                    return Err(Problem::trouble(
                        "no_selftest",
                        "what comes is no table of a self-test: put the image pico-selftest.uf2 on the board",
                    ));
                }
                continue;
            }
            latest = Instant::now();
            let text = String::from_utf8_lossy(&line).into_owned();
            line.clear();
            if table.take(&text)? {
                return Ok(());
            }
            progress(table);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "selftest\t1\tpico\t0.1.0\n\
        row\tposition of axis 1\t4000\t4000\tcounts\tpass\n\
        row\ttheir instants\t<= 3000\t3001\tns off\tfail\n\
        end\t2\t1\n";

    fn read(text: &str) -> Result<SelfTest, Problem> {
        let mut table = SelfTest::default();
        for line in text.lines() {
            if table.take(line)? {
                return Ok(table);
            }
        }
        Err(Problem::trouble("no_end", "no end"))
    }

    #[test]
    fn a_table_is_read() {
        let table = read(TABLE).unwrap();
        assert_eq!((table.board.as_str(), table.rows.len()), ("pico", 2));
        let failed: Vec<&str> = table.failed().map(|row| row.name.as_str()).collect();
        assert_eq!(failed, ["their instants"]);
    }

    /// Whatever is missing, twice there, or says other than its figures is refused.
    #[test]
    fn a_wrong_table_is_refused() {
        for (what, with) in [
            ("4000\tcounts", "3999\tcounts"),
            ("3001", "3000"),
            ("selftest\t1", "selftest\t2"),
            ("end\t2\t1", "end\t3\t1"),
            ("end\t2\t1", "end\t2\t0"),
            ("<= 3000", "3000ish"),
            ("row\ttheir", "their"),
            ("selftest\t1\tpico\t0.1.0\n", ""),
        ] {
            assert!(TABLE.contains(what), "{what}");
            assert!(read(&TABLE.replace(what, with)).is_err(), "{what}: {with}");
        }
        let (first, _) = TABLE.split_once('\n').unwrap();
        assert!(read(&format!("{first}\n{TABLE}")).is_err());
        assert!(read(&format!("{first}\nend\t0\t0\n")).is_err());
    }
}
