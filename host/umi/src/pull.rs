//! Pulls a board's journal entry by entry, verified as it comes, and reads
//! pulled files back.

use std::fmt;

use umi_core::journal::{Chain, Entry, EntryIter, Fault, FileHeader};
use umi_protocol::message::{JournalInfo, Record};

use crate::failure::{Explained, Failure};
use crate::link::{Client, JournalChain, JournalEntry};

/// A verified stretch of a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// First entry.
    pub first: u64,
    /// The entry after the last one.
    pub next: u64,
    /// Chain value that includes the last entry.
    pub chain: Chain,
}

/// What happens while a journal is pulled, in this order.
#[derive(Debug)]
pub enum Step<'a> {
    /// What a file begins with, and the entry after the last one to come.
    Header(FileHeader, u64),
    /// An entry whose check value and chain are right, as it is stored.
    Entry(Entry<'a>, &'a [u8]),
}

/// Pulls all entries from `from` on (by default from the oldest) that are there
/// when it begins.
///
/// # Errors
/// The link's; `out_of_range`; an entry that is damaged, missing or does not follow
/// from those before it, by the code of its [`Fault`]; what `step` returns.
pub fn pull(
    board: &mut Client,
    from: Option<u64>,
    mut step: impl FnMut(Step<'_>) -> Result<(), Failure>,
) -> Result<Stretch, Failure> {
    let info = board.journal_info()?;
    let first = from.unwrap_or(info.first_seq);
    if !(info.first_seq..=info.next_seq).contains(&first) {
        return Err(gone(first, info));
    }
    let chain_before = match board.journal_chain(first)? {
        JournalChain::Before(value) => Chain(value),
        JournalChain::Hidden => return Err(hidden(first)),
        JournalChain::None(info) => return Err(gone(first, info)),
    };
    step(Step::Header(
        FileHeader {
            first_seq: first,
            chain_before,
        },
        info.next_seq,
    ))?;
    let mut chain = chain_before;
    for seq in first..info.next_seq {
        let raw = match board.journal_read(seq)? {
            JournalEntry::Stored(raw) => raw,
            JournalEntry::None(info) => return Err(gone(seq, info)),
        };
        let mut entries = EntryIter::new(&raw, seq, chain);
        let entry = entries.next().unwrap_or(Err(Fault::CutShort { seq }));
        let entry = entry.map_err(|fault| faulty(&fault))?;
        if entries.offset() != raw.len() {
            return Err(faulty(&Fault::Damaged { seq }));
        }
        step(Step::Entry(entry, &raw))?;
        chain = entries.chain_head();
    }
    // The entries follow from each other; this says that they are the board's.
    match board.journal_chain(info.next_seq)? {
        JournalChain::Before(value) if Chain(value) == chain => {}
        JournalChain::Before(_) => {
            return Err(faulty(&Fault::ChainBroken { seq: info.next_seq }));
        }
        JournalChain::Hidden => return Err(hidden(info.next_seq)),
        JournalChain::None(now) => return Err(gone(info.next_seq, now)),
    }
    Ok(Stretch {
        first,
        next: info.next_seq,
        chain,
    })
}

/// Reads the entries of a pulled file, verified as they come.
///
/// # Errors
/// The file is no journal; a faulty entry; what `step` returns.
pub fn read(
    bytes: &[u8],
    mut step: impl FnMut(Entry<'_>) -> Result<(), Failure>,
) -> Result<Stretch, Failure> {
    let (header, mut entries) = umi_core::journal::decode_file(bytes)
        .map_err(|error| Failure::trouble(error.code(), error))?;
    for entry in entries.by_ref() {
        step(entry.map_err(|fault| faulty(&fault))?)?;
    }
    Ok(Stretch {
        first: header.first_seq,
        next: entries.next_seq(),
        chain: entries.chain_head(),
    })
}

/// What an entry says.
///
/// # Errors
/// [`Unreadable`].
pub fn record(entry: &Entry<'_>) -> Result<Record, Unreadable> {
    let unreadable = Unreadable { kind: entry.kind };
    match postcard::take_from_bytes::<Record>(entry.payload) {
        Ok((record, [])) if record.kind() == entry.kind => Ok(record),
        _ => Err(unreadable),
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

fn faulty(fault: &Fault) -> Failure {
    Failure::Refused(Explained::new(fault.code(), fault).with("seq", fault.seq()))
}

fn hidden(seq: u64) -> Failure {
    let message = format!(
        "damage in the journal before entry {seq} hides the chain value that proves it: start behind the damage with --from, at a later entry"
    );
    Failure::Refused(Explained::new("chain_broken", message).with("seq", seq))
}

fn gone(seq: u64, info: JournalInfo) -> Failure {
    let error = umi_core::journal::Error::<()>::OutOfRange {
        seq,
        first: info.first_seq,
        next: info.next_seq,
    };
    Failure::Trouble(
        Explained::new(error.code(), error)
            .with("seq", seq)
            .with("first_seq", info.first_seq)
            .with("next_seq", info.next_seq),
    )
}
