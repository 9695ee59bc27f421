//! Pulls a board's journal entry by entry, verified as it comes, and reads
//! pulled files back.

pub mod audit;
pub mod guarding;
mod pull;
pub mod verify;

use std::fmt;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use umi_core::journal::{Chain, Entry, Gap, JournalFault};
use umi_protocol::config::AccessConfig;
use umi_protocol::job::{Guards, Teach, before};
use umi_protocol::message::{JournalInfo, Record};
use umi_protocol::program::Stated;

pub use pull::{Begun, PATIENCE, PullRequest, PullStep, Pulled, Unsigned, head, nonce, pull};

use crate::problem::Problem;

/// A verified stretch of a journal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// First entry.
    pub first: u64,
    /// The entry after the last one.
    pub next: u64,
    /// Chain value that includes the last entry.
    pub chain: Chain,
    /// Entries that the board had overwritten before they were read: first and next.
    pub overwritten: Vec<(u64, u64)>,
}

impl Stretch {
    /// Entries that it holds: all but those that were overwritten.
    #[must_use]
    pub fn held(&self) -> u64 {
        let count = |first: u64, next: u64| next.saturating_sub(first);
        let gone = self.overwritten.iter();
        gone.fold(count(self.first, self.next), |held, (first, next)| {
            held.saturating_sub(count(*first, *next))
        })
    }
}

/// Longer than any journal's file, in bytes: sixteen times the largest memory that a board can have (16 MB).
const LONGEST: u64 = 256 << 20;

/// The bytes of a journal's file. What is longer than any, or has no end, is none.
///
/// # Errors
/// It cannot be read; `file_too_long`.
pub fn load(path: &Path) -> Result<Vec<u8>, Problem> {
    load_up_to(path, LONGEST)
}

fn load_up_to(path: &Path, longest: u64) -> Result<Vec<u8>, Problem> {
    let failed = |error| Problem::file("read", path, &error);
    let file = File::open(path).map_err(failed)?;
    let is_longer = file.metadata().is_ok_and(|about| about.len() > longest);
    let mut bytes = Vec::new();
    if !is_longer {
        let read = file.take(longest + 1).read_to_end(&mut bytes);
        read.map_err(failed)?;
    }
    if is_longer || bytes.len() as u64 > longest {
        let message = format_args!(
            "{} has more than {longest} bytes: no board's journal is as long",
            path.display()
        );
        return Err(Problem::trouble("file_too_long", message));
    }
    Ok(bytes)
}

/// What stands in a journal's file.
#[derive(Debug)]
pub enum FileItem<'a> {
    /// An entry whose check value and chain are right.
    Entry(Entry<'a>),
    /// Entries that the board had overwritten before they were read.
    Gap(Gap),
}

/// Reads a pulled file, verified as it comes. Whether it is the board's word is another
/// question: [`verify::verify`].
///
/// # Errors
/// The file is no journal; a faulty entry; what `step` returns.
pub fn read<E: From<Problem>>(
    bytes: &[u8],
    mut step: impl FnMut(FileItem<'_>) -> Result<(), E>,
) -> Result<Stretch, E> {
    let (header, mut entries) = umi_core::journal::decode_file(bytes)
        .map_err(|error| Problem::trouble(error.code(), error))?;
    let mut overwritten = Vec::new();
    loop {
        let entry = entries.next();
        if let Some(gap) = entries.take_gap() {
            overwritten.push((gap.first, gap.next));
            step(FileItem::Gap(gap))?;
        }
        match entry {
            Some(entry) => step(FileItem::Entry(entry.map_err(|fault| faulty(&fault))?))?,
            None => break,
        }
    }
    Ok(Stretch {
        first: header.first_seq,
        next: entries.next_seq(),
        chain: entries.chain_head(),
        overwritten,
    })
}

/// A short name of a public key: the first 8 bytes of its SHA-256, as hexadecimal digits.
#[must_use]
pub fn key_id(key: &[u8; 32]) -> String {
    hex(&umi_core::trust::board_key::key_id(key))
}

/// Bytes as hexadecimal digits.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What an entry says.
///
/// # Errors
/// [`Unreadable`].
pub fn record(entry: &Entry<'_>) -> Result<Record, Unreadable> {
    let unreadable = Unreadable { kind: entry.kind };
    let of_today = record_of_today(entry, unreadable);
    match (one_sigma(entry), of_today) {
        (None, of_today) => of_today,
        (Some(before), Err(_)) => Ok(before),
        // Numbers that nobody gave show which of the two it is not.
        (Some(before), Ok(today)) => {
            match (has_plain_figures(&before), has_plain_figures(&today)) {
                (true, false) => Ok(before),
                (false, true) => Ok(today),
                _ => Err(unreadable),
            }
        }
    }
}

fn record_of_today(entry: &Entry<'_>, unreadable: Unreadable) -> Result<Record, Unreadable> {
    match postcard::take_from_bytes::<Record>(entry.payload) {
        Ok((record, [])) if record.kind() == entry.kind => Ok(record),
        Err(postcard::Error::DeserializeUnexpectedEnd) => older(entry).ok_or(unreadable),
        _ => Err(unreadable),
    }
}

/// A job with a probing sigma as it was recorded up to protocol 2.24, with one for the three axes.
fn one_sigma(entry: &Entry<'_>) -> Option<Record> {
    let len = entry.payload.len();
    if entry.kind != JOB_SET {
        return None;
    }
    let mut bytes = entry.payload.to_vec();
    bytes.resize(len + before::GROWN, 0);
    // Behind the record's number.
    let grown = before::widen(bytes.get_mut(1..)?, len.checked_sub(1)?)?;
    if grown + 1 == len {
        return None;
    }
    match postcard::take_from_bytes::<Record>(bytes.get(..=grown)?) {
        Ok((record, [])) if record.kind() == entry.kind => Some(record),
        _ => None,
    }
}

/// Whether what stands about the place of the sigmas is what somebody may have stated: bytes of other
/// numbers, read as one, are far from it.
fn has_plain_figures(record: &Record) -> bool {
    let Record::JobSet { job, .. } = record else {
        return false;
    };
    let guards = &job.guards;
    let probing = guards.probing.iter().flat_map(|probing| probing.sigma_mm);
    let warmth = guards.warmth.iter();
    let warmth = warmth.flat_map(|warmth| [warmth.expansion_ppm_per_k, warmth.at_most_k]);
    let is_plain = |value: f64| (1e-9..1e9).contains(&value);
    probing.chain(warmth).all(is_plain) && umi_core::job::check(job).is_ok()
}

/// A record of an earlier firmware that ends before what was added since. All of that is
/// absent in it, which is written as zeros.
fn older(entry: &Entry<'_>) -> Option<Record> {
    const ADDED: usize = 16;
    let grown = matches!(
        entry.kind,
        JOB_SET
            | REFERENCE_RESTORED
            | TAUGHT
            | PROGRAM_KEPT
            | PROGRAM_DELETED
            | ALARM_SENT
            | TEACH_ASKED
            | HEAD
            | CONFIG_SET
    );
    let mut bytes = entry.payload.to_vec();
    bytes.resize(bytes.len() + ADDED, 0);
    let (record, rest) = postcard::take_from_bytes::<Record>(&bytes).ok()?;
    // Only what was added may be missing: never a byte of what was there before.
    let whole = rest.len() < ADDED && record.kind() == entry.kind;
    (grown && whole && is_plain(&record)).then_some(record)
}

const JOB_SET: u8 = 2;
const REFERENCE_RESTORED: u8 = 3;
const TAUGHT: u8 = 11;
const PROGRAM_KEPT: u8 = 15;
const PROGRAM_DELETED: u8 = 16;
const ALARM_SENT: u8 = 17;
const TEACH_ASKED: u8 = 22;
/// Kind number of [`Record::Head`].
const HEAD: u8 = 24;
const CONFIG_SET: u8 = 28;

/// Nothing in it was added since. A record that broke off earlier would have zeros elsewhere,
/// too; entries are whole by their check value, so there is none.
fn is_plain(record: &Record) -> bool {
    match record {
        Record::JobSet { job, key_id } => {
            job.teach == Teach::FirstOk
                && job.guards == Guards::default()
                && job.again.is_none()
                && key_id.is_none()
        }
        Record::ReferenceRestored { learned, .. } | Record::Taught { learned, .. } => {
            learned.largest.is_empty() && learned.further == 0
        }
        Record::ProgramKept { program, key_id } => {
            program.stated == Stated::default() && key_id.is_none()
        }
        Record::ProgramDeleted { key_id, .. } => key_id.is_none(),
        Record::TeachAsked { keep, .. } => !keep,
        Record::AlarmSent { run, .. } => run.is_none(),
        Record::Head(head) => head.evidence.is_none(),
        Record::ConfigSet(config) => config.access == AccessConfig::NEW,
        _ => false,
    }
}

/// A whole entry whose content this version cannot read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unreadable {
    /// Its kind number.
    pub kind: u8,
}

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "record of kind {} that this umi ({}) cannot read: list it with the umi of the firmware that wrote it",
            self.kind,
            env!("CARGO_PKG_VERSION")
        )
    }
}

fn faulty(fault: &JournalFault) -> Problem {
    Problem::refused(fault.code(), fault).with("seq", fault.seq())
}

fn hidden(seq: u64) -> Problem {
    let message =
        format!("damage in the journal before entry {seq} hides the chain value that proves it");
    Problem::refused("chain_broken", message).with("seq", seq)
}

fn gone(seq: u64, info: JournalInfo) -> Problem {
    let error = umi_core::journal::JournalError::<()>::OutOfRange {
        seq,
        first: info.first_seq,
        next: info.next_seq,
    };
    Problem::trouble(error.code(), error)
        .with("seq", seq)
        .with("first_seq", info.first_seq)
        .with("next_seq", info.next_seq)
}

#[cfg(test)]
mod tests {
    use umi_core::units::Micros;

    use super::*;

    /// A job as a firmware wrote it that knew no guards: without the eleven zeros at its end.
    /// One byte less, and it is no record of any firmware.
    #[test]
    fn a_job_of_an_earlier_firmware_is_read() {
        let job = toml::from_str(include_str!("../../../../examples/three-spheres.toml"));
        let set = Record::JobSet {
            job: job.unwrap(),
            key_id: None,
        };
        let mut room = [0; umi_protocol::message::MAX_RECORD];
        let bytes = postcard::to_slice(&set, &mut room).unwrap();
        let read = |payload| {
            record(&Entry {
                seq: 1,
                t: Micros(1),
                kind: JOB_SET,
                payload,
            })
        };
        assert_eq!(bytes[bytes.len() - 11..], [0; 11]);
        assert_eq!(read(&bytes[..]), Ok(set.clone()));
        assert_eq!(read(&bytes[..bytes.len() - 11]), Ok(set));
        for less in 17..60 {
            assert!(read(&bytes[..bytes.len() - less]).is_err(), "{less}");
        }
    }

    /// A program that was kept, and a teaching that was asked for, before anything was said of
    /// the one and before there was more to teach: they end there.
    #[test]
    fn what_was_kept_before_it_grew_is_read() {
        let program = umi_protocol::program::ProgramInfo {
            number: 7,
            name: umi_protocol::job::name("PART"),
            bytes: 12,
            crc32: 0x1234_5678,
            release: umi_protocol::program::Release::Always,
            hold_s: 5,
            stated: Stated::default(),
        };
        let kept = Record::ProgramKept {
            program,
            key_id: None,
        };
        let deleted = Record::ProgramDeleted {
            number: 7,
            crc32: 1,
            key_id: None,
        };
        for (record_now, added) in [
            (kept, 4),
            (deleted, 1),
            (
                Record::TeachAsked {
                    more: true,
                    keep: false,
                },
                1,
            ),
            (
                Record::TeachAsked {
                    more: false,
                    keep: false,
                },
                2,
            ),
        ] {
            let mut room = [0; umi_protocol::message::MAX_RECORD];
            let bytes = postcard::to_slice(&record_now, &mut room).unwrap();
            let before = &bytes[..bytes.len() - added];
            let read = record(&Entry {
                seq: 1,
                t: Micros(1),
                kind: record_now.kind(),
                payload: before,
            });
            assert_eq!(read, Ok(record_now));
        }
    }

    /// What is longer than a journal can be is refused before it is read, and what has no end when it is as long.
    #[test]
    fn what_is_too_long_is_no_journal() {
        let path = std::env::temp_dir().join(format!("umi-journal-{}", std::process::id()));
        std::fs::write(&path, [7; 10]).unwrap();
        assert_eq!(load_up_to(&path, 10).unwrap(), [7; 10]);
        assert_eq!(load_up_to(&path, 9).unwrap_err().code, "file_too_long");
        File::create(&path).unwrap().set_len(LONGEST + 1).unwrap();
        assert_eq!(load(&path).unwrap_err().code, "file_too_long");
        std::fs::remove_file(&path).unwrap();
        if cfg!(unix) {
            let endless = load_up_to(Path::new("/dev/zero"), 1000);
            assert_eq!(endless.unwrap_err().code, "file_too_long");
        }
    }
}
