//! `umi log`

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, FAINT, GOOD, paint, print, print_json};
use crate::show::text;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use umi_client::journal::{self, PullStep, Stretch};
use umi_core::journal::Entry;

use super::events::Kind;
use super::{Board, Format};

/// Pull the journal of a board, or list it
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Log {
    /// List this file instead of the journal of a board
    #[arg(value_name = "FILE.umij", conflicts_with = "output")]
    file: Option<PathBuf>,
    #[command(flatten)]
    board: Board,
    /// Write the journal to this file instead of listing it
    #[arg(short, long, value_name = "FILE.umij")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Begin with this entry instead of the oldest
    #[arg(long, value_name = "SEQ")]
    from: Option<u64>,
    /// List only these; all entries are verified. The journal has no lines and hits of
    /// their own
    #[arg(
        long,
        value_name = "KINDS",
        value_delimiter = ',',
        conflicts_with = "output"
    )]
    only: Vec<Kind>,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Every entry is verified as it comes: its check value, and the SHA-256 chain over
everything before it. Note the chain value at the end somewhere else: it proves
later that nothing up to there was changed.

Examples:
  umi log                               list the journal of the only board
  umi log --port /dev/ttyACM0 -o monday.umij
  umi log monday.umij                   list a pulled file
  umi log monday.umij --only verdicts,faults
  umi log monday.umij --from 1200 --json | jq 'select(.type==\"verdict\")'

Times are the board's clock, since it started.
Exit status: 0 verified to the end, 1 file, usage or connection, 2 an entry is
damaged, missing or was changed.";

impl Log {
    pub fn run(self) -> Result<(), Failure> {
        match (&self.file, &self.output) {
            (Some(file), _) => self.list_file(file),
            (None, Some(output)) => self.save(output),
            (None, None) => self.list_board(),
        }
    }

    fn list_file(&self, path: &Path) -> Result<(), Failure> {
        let bytes = std::fs::read(path).map_err(|error| Failure::file("read", path, &error))?;
        let from = self.from.unwrap_or(0);
        let stretch = journal::read(&bytes, |entry| {
            if entry.seq < from {
                return Ok(());
            }
            self.show(&entry)
        })?;
        self.sum_up(&stretch, None)
    }

    fn list_board(&self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let stretch = journal::pull(&mut board, self.from, |step| match step {
            PullStep::Header(..) => Ok(()),
            PullStep::Entry(entry, _) => self.show(&entry),
        })?;
        self.sum_up(&stretch, None)
    }

    fn save(&self, path: &Path) -> Result<(), Failure> {
        self.force.check(path, &[])?;
        let mut board = self.board.connect()?;
        // Under its own name only when it is complete.
        let part = part_of(path);
        let failed = |error| Failure::file("write", &part, &error);
        let mut file = BufWriter::new(begin_part(&part).map_err(failed)?);
        let bar = ProgressBar::no_length().with_style(style());
        let stretch = journal::pull(&mut board, self.from, |step| match step {
            PullStep::Header(header, next) => {
                bar.set_length(next - header.first_seq);
                file.write_all(&header.encode()).map_err(failed)
            }
            PullStep::Entry(_, raw) => {
                bar.inc(1);
                file.write_all(raw).map_err(failed)
            }
        });
        bar.finish_and_clear();
        let closed = file
            .into_inner()
            .map_err(|error| failed(error.into_error()));
        let stretch = stretch.map_err(|failure| kept(failure, &part))?;
        closed?.sync_all().map_err(failed)?;
        std::fs::rename(&part, path).map_err(|error| Failure::file("write", path, &error))?;
        self.sum_up(&stretch, Some(path))
    }

    fn show(&self, entry: &Entry<'_>) -> Result<(), Failure> {
        let (seq, t_us) = (entry.seq, entry.t.0);
        let record = journal::record(entry);
        // What cannot be read is shown always.
        if let Ok(record) = &record
            && !self.only.is_empty()
            && !self.only.contains(&Kind::of(record))
        {
            return Ok(());
        }
        match (record, self.format.json) {
            (Ok(record), true) => print_json(&crate::show::json::entry(seq, t_us, &record)),
            (Ok(record), false) => line(seq, t_us, &text::record(&record)),
            (Err(unreadable), true) => print_json(&json!({
                "seq": seq,
                "t_us": t_us,
                "type": "unreadable",
                "kind": unreadable.kind,
                "message": unreadable.to_string(),
            })),
            (Err(unreadable), false) => line(seq, t_us, &paint(CAUTION, unreadable)),
        }
    }

    fn sum_up(&self, stretch: &Stretch, file: Option<&Path>) -> Result<(), Failure> {
        let Stretch { first, next, chain } = stretch;
        if self.format.json {
            return print_json(&json!({
                "type": "verified",
                "first_seq": first,
                "next_seq": next,
                "chain": chain.to_string(),
                "file": file.map(|path| path.display().to_string()),
            }));
        }
        let entries = match next.checked_sub(*first) {
            None | Some(0) => "no entries".to_owned(),
            Some(_) => format!("entries {first} to {}: verified", next - 1),
        };
        let to = file.map_or(String::new(), |path| format!(", in {}", path.display()));
        print(&format!(
            "{}{to}\nchain value {chain}\n",
            paint(GOOD, entries)
        ))
    }
}

fn line(seq: u64, t_us: u64, text: &str) -> Result<(), Failure> {
    let time = paint(FAINT, text::clock(t_us));
    print(&format!("{seq:>8}  {time}  {text}\n"))
}

fn part_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

/// Begins the file anew. A link that somebody has put under its name is taken away, not followed.
fn begin_part(part: &Path) -> io::Result<File> {
    match std::fs::remove_file(part) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => File::create_new(part),
    }
}

/// Says where that is which came before the failure.
fn kept(failure: Failure, part: &Path) -> Failure {
    let part = part.display();
    failure.noted(&format!(
        "\nwhat came before is verified and stays in {part}"
    ))
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {pos}/{len} entries, {per_sec}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}
