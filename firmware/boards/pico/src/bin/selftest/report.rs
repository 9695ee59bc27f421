//! The table on its way to the host, and the host's request.

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
#[derive(Clone, Copy)]
pub struct Asked {
    /// How often the rings are restarted.
    pub restarts: u32,
    /// How many edges of each input are driven, and how many pulses sent.
    pub edges: u32,
}

/// `run RESTARTS EDGES` and the end of the line.
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
    pub async fn begin(&mut self) -> Result<(), Broken> {
        let chip = if cfg!(feature = "rp2350") {
            "pico2"
        } else {
            "pico"
        };
        let firmware = env!("CARGO_PKG_VERSION");
        self.line(format_args!("selftest\t{VERSION}\t{chip}\t{firmware}\n"))
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
