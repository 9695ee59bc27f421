//! `umi log`

mod ack;
mod export;
mod head;
#[cfg(feature = "cloud-formats")]
mod parquet;
mod pull;
mod verify;

use std::path::{Path, PathBuf};

use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, FAINT, GOOD, paint, print, print_json};
use crate::show::text;
use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};
use umi_client::journal::guarding::Guarding;
use umi_client::journal::verify::VerifiedFile;
use umi_client::journal::{self, FileItem, PullRequest, PullStep, Stretch, key_id};
use umi_core::journal::Entry;

pub(in crate::cmd) use head::unsigned;

use super::events::Kind;
use crate::cmd::{Board, Format};

/// Pull the journal of a board, or list it
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Log {
    #[command(subcommand)]
    action: Option<Action>,
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

/// What else can be done with a journal.
#[derive(Subcommand)]
enum Action {
    Pull(pull::PullFile),
    Verify(verify::Verify),
    Head(head::ShowHead),
    Export(export::Export),
    Ack(ack::Ack),
}

const HELP: &str = "\
Every entry is verified as it comes: its check value, and the SHA-256 chain over
everything before it. A file that is pulled ends with a head that the board has signed,
where it has a key: `umi log verify` says whether all of it is the board's word.

Examples:
  umi log                               list the journal of the only board
  umi log --port /dev/ttyACM0 -o monday.umij
  umi log monday.umij                   list a pulled file
  umi log monday.umij --only verdicts,faults
  umi log verify monday.umij --key board.pub
  umi log monday.umij --from 1200 --json | jq 'select(.type==\"verdict\")'

Times are the board's clock, since it started.
Exit status: 0 verified to the end, 1 file, usage or connection, 2 an entry is
damaged, missing or was changed.";

impl Log {
    pub fn run(self) -> Result<(), Failure> {
        if let Some(action) = self.action {
            return match action {
                Action::Pull(command) => command.run(),
                Action::Verify(command) => command.run(),
                Action::Head(command) => command.run(),
                Action::Export(command) => command.run(),
                Action::Ack(command) => command.run(),
            };
        }
        match (&self.file, &self.output) {
            (Some(file), _) => self.list_file(file),
            (None, Some(output)) => {
                self.force.check(output, &[])?;
                let pull = pull::Pull {
                    file: output,
                    from: self.from,
                    goes_on: false,
                };
                let pulled = pull.run(&mut self.board.connect()?)?;
                sum_up(self.format.json, &pulled, Some(output), true)
            }
            (None, None) => self.list_board(),
        }
    }

    fn list_file(&self, path: &Path) -> Result<(), Failure> {
        let bytes = journal::load(path)?;
        let from = self.from.unwrap_or(0);
        let mut guarding = Guarding::default();
        journal::read(&bytes, |item| match item {
            FileItem::Entry(entry) => self.show(&entry, from, &mut guarding),
            FileItem::Gap(gap) if gap.next > from => self.show_gap(gap.first, gap.next),
            _ => Ok(()),
        })?;
        let verified = journal::verify::verify(&bytes, None, None)?;
        sum_up(self.format.json, &verified, None, false)
    }

    fn list_board(&self) -> Result<(), Failure> {
        let mut board = self.board.connect()?;
        let wanted = PullRequest {
            from: self.from,
            ..PullRequest::default()
        };
        let mut guarding = Guarding::default();
        let pulled = journal::pull(&mut board, wanted, |step| match step {
            PullStep::Header(..) => Ok(()),
            PullStep::Gap(gap) => self.show_gap(gap.first, gap.next),
            PullStep::Entry(entry, _) => self.show(&entry, 0, &mut guarding),
        })?;
        if self.format.json {
            return print_json(&Value::Object(summary(&pulled.stretch, None)));
        }
        let Stretch { first, next, .. } = pulled.stretch;
        let (chain, held) = (pulled.stretch.chain, pulled.stretch.held());
        let entries = paint(GOOD, entries(first, next, held, "read whole"));
        print(&format!("{entries}\nchain value {chain}\n"))
    }

    fn show_gap(&self, first: u64, next: u64) -> Result<(), Failure> {
        if self.format.json {
            return print_json(
                &json!({"type": "overwritten", "first_seq": first, "next_seq": next}),
            );
        }
        let text = format!(
            "entries {first} to {} were overwritten on the board",
            next - 1
        );
        print(&format!("{first:>8}  {}\n", paint(CAUTION, text)))
    }

    /// Shows an entry, if it stands at `from` or behind.
    fn show(&self, entry: &Entry<'_>, from: u64, guarding: &mut Guarding) -> Result<(), Failure> {
        let (seq, t_us) = (entry.seq, entry.t.0);
        let record = journal::record(entry);
        let mode = record
            .as_ref()
            .ok()
            .and_then(|record| guarding.follow(seq, record));
        if seq < from {
            return Ok(());
        }
        // What cannot be read is shown always.
        if let Ok(record) = &record
            && !self.only.is_empty()
            && !self.only.contains(&Kind::of(record))
        {
            return Ok(());
        }
        match (record, self.format.json) {
            (Ok(record), true) => {
                print_json(&crate::show::json::guarded_entry(seq, t_us, &record, mode))
            }
            (Ok(record), false) => line(seq, t_us, &text::guarded_record(&record, mode)),
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
}

/// What was read and proven, in a line for machines or in words.
///
/// `is_known`: the key is that of the reader, or of the board at the other end.
fn sum_up(
    json: bool,
    verified: &VerifiedFile,
    file: Option<&Path>,
    is_known: bool,
) -> Result<(), Failure> {
    if json {
        return print_json(&machine(verified, file));
    }
    let Stretch {
        first, next, chain, ..
    } = verified.stretch;
    let to = file.map_or(String::new(), |path| format!(", in {}", path.display()));
    let signed = signed_by(verified);
    let held = verified.stretch.held();
    let read = if verified.signed {
        paint(GOOD, entries(first, next, held, "verified"))
    } else {
        paint(CAUTION, entries(first, next, held, "read whole"))
    };
    let mut text = format!("{read}{to}\n{signed}\n");
    if verified.key.is_some() && !is_known {
        text += "not held against a board key that you know: --key BOARD.pub\n";
    }
    if verified.key.is_some() && !verified.is_ended {
        let open = "its end is not signed over the number of who pulled it: entries behind its last head can have been left out";
        text += &format!("{}\n", paint(CAUTION, open));
    }
    for (first, next) in &verified.stretch.overwritten {
        let lost = format!(
            "entries {first} to {} are not in it: overwritten on the board{}",
            next - 1,
            if verified.signed {
                ""
            } else {
                ", says the file"
            }
        );
        text += &format!("{}\n", paint(CAUTION, lost));
    }
    print(&format!("{text}chain value {chain}\n"))
}

/// Whose word it is.
pub(super) fn signed_by(verified: &VerifiedFile) -> String {
    match (&verified.key, verified.signed, verified.signed_to) {
        (Some(key), true, _) => paint(GOOD, format_args!("signed by board key {}", key_id(key))),
        (Some(key), false, Some(to)) => paint(
            CAUTION,
            format_args!(
                "signed by board key {} up to entry {to}; nobody vouches for what is behind it",
                key_id(key)
            ),
        ),
        _ => paint(
            CAUTION,
            "unsigned: whoever had the file can have made it anew",
        ),
    }
}

/// The same for machines.
fn machine(verified: &VerifiedFile, file: Option<&Path>) -> Value {
    let mut object = summary(&verified.stretch, file);
    object.insert("signed".into(), verified.signed.into());
    object.insert("signed_to".into(), verified.signed_to.into());
    object.insert("ended".into(), verified.is_ended.into());
    object.insert("entries".into(), verified.stretch.held().into());
    let key = verified.key.as_ref().map(key_id);
    object.insert("key_id".into(), key.into());
    let overwritten: Vec<_> = verified.stretch.overwritten.iter().collect();
    object.insert("overwritten".into(), json!(overwritten));
    Value::Object(object)
}

fn summary(stretch: &Stretch, file: Option<&Path>) -> Map<String, Value> {
    let mut object = Map::new();
    object.insert("type".into(), "verified".into());
    object.insert("first_seq".into(), stretch.first.into());
    object.insert("next_seq".into(), stretch.next.into());
    object.insert("chain".into(), stretch.chain.to_string().into());
    let file = file.map(|path| path.display().to_string());
    object.insert("file".into(), file.into());
    object
}

fn entries(first: u64, next: u64, held: u64, what: &str) -> String {
    match next.checked_sub(first) {
        _ if held == 0 => "no entries".to_owned(),
        Some(all) if all == held => format!("entries {first} to {}: {what}", next - 1),
        _ => format!("{held} entries of {first} to {}: {what}", next - 1),
    }
}

fn line(seq: u64, t_us: u64, text: &str) -> Result<(), Failure> {
    let time = paint(FAINT, text::clock(t_us));
    print(&format!("{seq:>8}  {time}  {text}\n"))
}
