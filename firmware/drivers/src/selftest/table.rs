//! The table on its way to the host, and the host's request.
//!
//! Text, fields between tabs: `selftest`, version, board, firmware; then `row`, name, promised,
//! measured, unit, `pass` or `fail`; then `end`, rows, failed ones. `client::board::selftest` reads it.

use core::fmt::{self, Write as _};

use heapless::String;
use umi_app::board::{Broken, LinkTx};

/// The form of the table.
const VERSION: u32 = 1;
const LINE: usize = 128;
/// The most restarts of the rings that a host can ask for.
const MOST_RESTARTS: u32 = 1_000_000;

/// The most edges of each input.
const MOST_EDGES: u32 = 10_000;

/// What the host asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked {
    /// How often the rings are restarted.
    pub restarts: u32,
    /// How many edges of each input are driven, and how many pulses sent.
    pub edges: u32,
}

/// `run RESTARTS EDGES` and the end of the line.
#[derive(Debug, Default)]
pub struct Request(String<24>);

impl Request {
    /// Nothing has come.
    pub const fn new() -> Self {
        Self(String::new())
    }

    /// Takes a byte. Returns what is asked for, if that was the end of a request.
    pub fn take(&mut self, byte: u8) -> Option<Asked> {
        if byte != b'\n' {
            if self.0.push(char::from(byte)).is_err() {
                self.0.clear();
            }
            return None;
        }
        let asked = asked(self.0.trim());
        self.0.clear();
        asked
    }
}

fn asked(line: &str) -> Option<Asked> {
    let (restarts, edges) = line.strip_prefix("run ")?.split_once(' ')?;
    let asked = Asked {
        restarts: restarts.parse().ok()?,
        edges: edges.parse().ok()?,
    };
    let fits = asked.restarts <= MOST_RESTARTS && asked.edges <= MOST_EDGES;
    fits.then_some(asked)
}

/// Rows that are sent as they come.
#[derive(Debug)]
pub struct Table<'link, L> {
    link: &'link mut L,
    rows: u32,
    failed: u32,
}

impl<'link, L: LinkTx> Table<'link, L> {
    /// Over this link.
    pub const fn new(link: &'link mut L) -> Self {
        Self {
            link,
            rows: 0,
            failed: 0,
        }
    }

    /// What comes before the rows.
    pub async fn begin(&mut self, board: &str) -> Result<(), Broken> {
        let firmware = env!("CARGO_PKG_VERSION");
        self.line(format_args!("selftest\t{VERSION}\t{board}\t{firmware}\n"))
            .await
    }

    /// A figure that must be the promised one.
    pub async fn exactly(
        &mut self,
        name: &str,
        promised: i64,
        measured: i64,
        unit: &str,
    ) -> Result<(), Broken> {
        let passes = measured == promised;
        self.row(name, format_args!("{promised}"), measured, unit, passes)
            .await
    }

    /// A figure that must not be above the promised one.
    pub async fn at_most(
        &mut self,
        name: &str,
        promised: i64,
        measured: i64,
        unit: &str,
    ) -> Result<(), Broken> {
        let passes = measured <= promised;
        self.row(name, format_args!("<= {promised}"), measured, unit, passes)
            .await
    }

    async fn row(
        &mut self,
        name: &str,
        promised: fmt::Arguments<'_>,
        measured: i64,
        unit: &str,
        passes: bool,
    ) -> Result<(), Broken> {
        self.rows = self.rows.saturating_add(1);
        self.failed = self.failed.saturating_add((!passes).into());
        let verdict = if passes { "pass" } else { "fail" };
        self.line(format_args!(
            "row\t{name}\t{promised}\t{measured}\t{unit}\t{verdict}\n"
        ))
        .await
    }

    /// What comes behind the rows.
    pub async fn end(&mut self) -> Result<(), Broken> {
        let (rows, failed) = (self.rows, self.failed);
        self.line(format_args!("end\t{rows}\t{failed}\n")).await
    }

    async fn line(&mut self, text: fmt::Arguments<'_>) -> Result<(), Broken> {
        let mut line = String::<LINE>::new();
        // No row is as long.
        let _ = line.write_fmt(text);
        self.link.write(line.as_bytes()).await
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use embassy_futures::block_on;

    use super::*;

    struct Kept(Vec<u8>);

    impl LinkTx for Kept {
        async fn write(&mut self, bytes: &[u8]) -> Result<(), Broken> {
            self.0.extend_from_slice(bytes);
            Ok(())
        }
    }

    fn heard(text: &str) -> Vec<Asked> {
        let mut request = Request::new();
        text.bytes().filter_map(|byte| request.take(byte)).collect()
    }

    #[test]
    fn a_request_is_a_line_and_nothing_else_is_one() {
        let asked = Asked {
            restarts: 10_000,
            edges: 40,
        };
        assert_eq!(heard("run 10000 40\r\n"), [asked]);
        assert_eq!(heard("AT+GCAP\nrun 10000 40\n"), [asked]);
        for none in [
            "run 1 2",
            "run 1\n",
            "run -1 2\n",
            "run 1000001 2\n",
            "run 1 10001\n",
        ] {
            assert_eq!(heard(none), [], "{none:?}");
        }
        // What is too long is forgotten, not the request behind it.
        assert_eq!(
            heard(&(std::string::String::from("x").repeat(1000) + "\nrun 10000 40\n")),
            [asked]
        );
    }

    #[test]
    fn rows_carry_their_verdict_and_the_end_their_number() {
        let mut kept = Kept(Vec::new());
        block_on(async {
            let mut table = Table::new(&mut kept);
            table.begin("a-board").await?;
            table.exactly("same", 3, 3, "").await?;
            table.exactly("other", 3, 4, "counts").await?;
            table.at_most("below", 3, -4, "ns").await?;
            table.at_most("above", 3, 4, "ns").await?;
            table.end().await
        })
        .unwrap();
        let text = core::str::from_utf8(&kept.0).unwrap();
        let lines: Vec<&str> = text.lines().skip(1).collect();
        assert!(text.starts_with("selftest\t1\ta-board\t"), "{text}");
        assert_eq!(
            lines,
            [
                "row\tsame\t3\t3\t\tpass",
                "row\tother\t3\t4\tcounts\tfail",
                "row\tbelow\t<= 3\t-4\tns\tpass",
                "row\tabove\t<= 3\t4\tns\tfail",
                "end\t4\t2",
            ]
        );
    }
}
