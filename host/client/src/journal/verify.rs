//! Whether a pulled file is the board's word, and up to where.
//!
//! A file whose entries follow from each other proves nothing to somebody who was not there: who
//! edits it can make check values and chain anew. What nobody but the board can make is a signed
//! head ([`umi_protocol::head`]); each vouches for everything before it, from the board's first
//! start on.

mod evidence;

use umi_core::journal::{Chain, Entry, FileError, FileHeader, JournalFault, decode_file};
use umi_core::trust::board_key::is_signed;
use umi_protocol::head::Head;
use umi_protocol::message::Record;

use super::{HEAD, Stretch, faulty, key_id, record};
use crate::problem::Problem;
use evidence::{EvidenceCheck, OtherEvidence};

/// A file that holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VerifiedFile {
    /// What it holds.
    pub stretch: Stretch,
    /// Everything in it stands before a good head, or is one.
    pub signed: bool,
    /// Its last head vouches for the entries before this one; none: it has none.
    pub signed_to: Option<u64>,
    /// The key that signed.
    pub key: Option<[u8; 32]>,
    /// Its last head is over a number that the puller had made: nothing that the board had
    /// written by then was left out.
    pub is_ended: bool,
}

/// Checks a file: every entry, the chain, every head in it; by `key`, if the reader knows the
/// board's; and that it goes on from a head `after` that the reader has kept.
///
/// Entries behind the last head are an error only with a key: without one they are told by
/// `signed`.
///
/// # Errors
/// With the `seq` of the first entry that is wrong: `entry_damaged`, `entries_missing`,
/// `chain_broken`, `entry_cut_short`; `head_missing`, `head_signature`, `head_other_board`,
/// `head_older`, `head_not_shown`. Without: `journal_header_damaged`, and trouble with what is no journal.
pub fn verify(
    bytes: &[u8],
    key: Option<[u8; 32]>,
    after: Option<&Head>,
) -> Result<VerifiedFile, Problem> {
    if let Some(after) = after
        && !is_signed(after)
    {
        return Err(signature(after.seq, 0));
    }
    let (header, mut entries) = decode_file(bytes).map_err(|error| unreadable(bytes, &error))?;
    let mut check = Check {
        key,
        expected: key.or(after.map(|head| head.key)),
        after,
        is_reached: false,
        newest: None,
        gaps: Vec::new(),
        since: header.first_seq,
        evidence: EvidenceCheck::new(
            header.first_seq,
            after.is_some_and(|head| head.evidence.is_some()),
        ),
    };
    loop {
        let (seq, chain) = (entries.next_seq(), entries.chain_head());
        check.place(seq, &chain)?;
        let entry = entries.next();
        let mut before = chain;
        if let Some(gap) = entries.take_gap() {
            check.gaps.push((gap.first, gap.next));
            check.evidence.gap(gap.first);
            before = gap.chain_before;
            check.place(gap.next, &before)?;
        }
        match entry {
            Some(Ok(entry)) => check.entry(&entry, &before)?,
            Some(Err(fault)) => return Err(faulty(&fault)),
            None => break,
        }
    }
    let stretch = Stretch {
        first: header.first_seq,
        next: entries.next_seq(),
        chain: entries.chain_head(),
        overwritten: check.gaps.clone(),
    };
    check.end(&header, stretch)
}

/// The key of the first head in a file that is not this one, as far as the file can be read: it is of another board, also
/// where the file does not hold.
#[must_use]
pub fn other_key(bytes: &[u8], key: &[u8; 32]) -> Option<[u8; 32]> {
    let (_, mut entries) = decode_file(bytes).ok()?;
    while let Some(Ok(entry)) = entries.next() {
        entries.take_gap();
        if entry.kind == HEAD
            && let Ok(Record::Head(head)) = record(&entry)
            && head.key != *key
        {
            return Some(head.key);
        }
    }
    None
}

/// A file that cannot be read as a journal. Damage to its first bytes is damage, too.
fn unreadable(bytes: &[u8], error: &FileError) -> Problem {
    match error {
        FileError::NotAJournal if FileHeader::lost_its_magic(bytes) => {
            let damaged = FileError::HeaderDamaged;
            Problem::refused(damaged.code(), damaged)
        }
        FileError::HeaderDamaged => Problem::refused(error.code(), error),
        _ => Problem::trouble(error.code(), error),
    }
}

struct Check<'a> {
    /// The board's key as the reader knows it.
    key: Option<[u8; 32]>,
    /// The key of the reader, of the kept head, or of the first head in the file.
    expected: Option<[u8; 32]>,
    after: Option<&'a Head>,
    /// The place of the kept head was passed.
    is_reached: bool,
    newest: Option<Head>,
    gaps: Vec<(u64, u64)>,
    /// Entries from here on have no head behind them yet.
    since: u64,
    evidence: EvidenceCheck,
}

impl Check<'_> {
    /// Before entry `seq` the chain has this value.
    fn place(&mut self, seq: u64, chain: &Chain) -> Result<(), Problem> {
        let Some(after) = self.after.filter(|after| after.seq == seq) else {
            return Ok(());
        };
        self.is_reached = true;
        if after.chain == chain.0 {
            return Ok(());
        }
        let message = format!(
            "this is not the record of the head that was kept: before entry {seq} the board had signed another one; an older memory was put back, or the file was made anew"
        );
        Err(Problem::refused("head_older", message).with("seq", seq))
    }

    fn entry(&mut self, entry: &Entry<'_>, before: &Chain) -> Result<(), Problem> {
        if entry.kind != HEAD {
            self.evidence.entry(entry, before);
            return Ok(());
        }
        let seq = entry.seq;
        let Ok(Record::Head(head)) = record(entry) else {
            return Err(signature(seq, self.since));
        };
        // The signature is over what the head says; this is what the entry and the chain say.
        let mut room = [0; umi_protocol::message::MAX_RECORD];
        let again = postcard::to_slice(&Record::Head(head.clone()), &mut room);
        // One of a firmware that knew no evidence ends before that.
        let again = again.is_ok_and(|again| {
            again == entry.payload || again.strip_suffix(&[0]) == Some(entry.payload)
        });
        let is_its_own =
            head.seq == seq && head.t_us == entry.t.0 && head.chain == before.0 && again;
        if !is_its_own || !is_signed(&head) {
            return Err(signature(seq, self.since));
        }
        let expected = *self.expected.get_or_insert(head.key);
        if head.key != expected {
            let message = format!(
                "the head in entry {seq} is signed by key {}, not by {}: it is of another board",
                key_id(&head.key),
                key_id(&expected)
            );
            return Err(Problem::refused("head_other_board", message).with("seq", seq));
        }
        // A board does not forget its starts.
        if let Some(newest) = &self.newest
            && (head.boot < newest.boot || head.first_seq < newest.first_seq)
        {
            return Err(signature(seq, self.since));
        }
        self.evidence
            .head(entry, before, head.evidence.as_ref())
            .map_err(|of| other_evidence(&of))?;
        self.newest = Some(head);
        self.since = seq.saturating_add(1);
        Ok(())
    }

    fn end(self, header: &FileHeader, stretch: Stretch) -> Result<VerifiedFile, Problem> {
        let next = stretch.next;
        let nonce = self.newest.as_ref().and_then(|head| head.nonce);
        let is_cut = header.nonce.is_some() && header.nonce != nonce;
        // Of what was overwritten behind it a head says nothing.
        let before = |newest: &Head| self.gaps.iter().rfind(|gap| gap.1 <= newest.seq);
        let held = self.newest.as_ref().and_then(|newest| {
            let gap = before(newest).filter(|gap| newest.first_seq < gap.1)?;
            Some(*gap)
        });
        // The board still held some of that when it signed. If the pull ended with this head,
        // somebody else left it out; if not, it may have been overwritten before it was pulled.
        if let Some((first, next)) = held
            && (header.nonce.is_some() || self.key.is_some())
        {
            return Err(faulty(&JournalFault::Missing { first, next }));
        }
        let unproven = self.evidence.end().map_err(|of| other_evidence(&of))?;
        let is_whole = self.since == next && unproven.is_none() && held.is_none();
        let signed = self.newest.is_some() && is_whole && !is_cut;
        if (self.key.is_some() && !signed) || is_cut {
            let message = if is_cut {
                "the head with which this file was pulled is not at its end: something was taken away there".to_owned()
            } else if let Some(seq) = unproven.filter(|_| self.since == next) {
                format!(
                    "entry {seq} was overwritten or stands before entries that were, and no signed head vouches for the evidence there: pull the journal again; if that stays so, the board's memory of evidence is damaged"
                )
            } else {
                format!(
                    "no signed head stands behind entry {}: nobody vouches for the entries from there on",
                    self.since
                )
            };
            let seq = unproven.unwrap_or(self.since).min(self.since).min(next);
            return Err(Problem::refused("head_missing", message).with("seq", seq));
        }
        if let Some(after) = self.after
            && !self.is_reached
            && next < after.seq
        {
            let message = format!(
                "the file ends before entry {next}, and a head was kept that vouches for the entries before {}: it was cut short, or an older memory was put back",
                after.seq
            );
            return Err(Problem::refused("head_older", message).with("seq", next));
        }
        // A board whose older memory was put back signs on from there, with later starts.
        if let Some(after) = self.after.filter(|_| !self.is_reached) {
            let message = format!(
                "nothing in the file shows that it goes on from the head that was kept: the place before entry {} is not in it; pull the journal from there (--from {}), or hold it against a head that was kept later",
                after.seq, after.seq
            );
            return Err(Problem::refused("head_not_shown", message).with("seq", stretch.first));
        }
        Ok(VerifiedFile {
            signed,
            signed_to: self.newest.as_ref().map(|head| head.seq),
            key: self.newest.map(|head| head.key),
            is_ended: header.nonce.is_some(),
            stretch,
        })
    }
}

fn other_evidence(of: &OtherEvidence) -> Problem {
    let seq = of.seq;
    let message = format!(
        "the verdicts, corrections and other evidence before entry {seq} are not those of which the board has signed that they were all: a piece was taken out, put in or changed, or the board's memory of them is damaged"
    );
    Problem::refused("head_signature", message).with("seq", seq)
}

fn signature(seq: u64, since: u64) -> Problem {
    let message = format!(
        "the signature in entry {seq} is not over what stands before it: something from entry {since} on was changed"
    );
    Problem::refused("head_signature", message)
        .with("seq", seq)
        .with("since", since)
}

#[cfg(test)]
mod tests;
