//! The board's whole record: the journal of everything, and beside it a ring of evidence that
//! noise cannot push out.
//!
//! # Design
//!
//! Every record goes into the [`Journal`], numbered and chained without gaps; so the journal alone
//! can be replayed. A record of a kind that is evidence
//! ([`umi_protocol::message::Record::is_evidence`]) is also put into a second journal on flash of
//! its own, with its number and the chain value before it:
//!
//! ```text
//! journal   … 41 bytes  42 fault  43 verdict  44 bytes  45 head  46 bytes …     lapped by noise
//! evidence  …                  7: 43 verdict      8: 45 head             …     lapped by evidence
//! ```
//!
//! When the journal has been overwritten up to some entry, the evidence before that is still
//! there, each piece as the entry that it was, byte by byte. What is missing between is a gap. The
//! second journal has a chain of its own; signed heads name both
//! ([`umi_protocol::head::EvidenceMark`]), so that neither a piece of evidence can be taken out of
//! a gap nor one put in.
//!
//! A record counts as kept when both have it. The journal is written first; what the power cut off
//! of the evidence is copied at the next start, and so is the evidence of a journal that was
//! written before the board had this ring.
//!
//! Where the owner wants evidence kept ([`Archive::hold`]), none is overwritten that nobody has
//! acknowledged. The ring is full then when its last sector is, and a record that is evidence and
//! finds no room goes into neither of the two ([`JournalError::Full`]): a piece that only the journal
//! had would break the chain of evidence. What is no evidence is written as ever, inputs among it.
//! The last [`RESERVE`] bytes are for what must not fail (`is_urgent`): what has begun is told to its
//! end, a start, who may do what, an acknowledgement. Half of that stays free for what a power cut
//! has left of a piece, which is written once more.
//!
//! # Limitations
//!
//! * Evidence that never ends overwrites evidence: see what a host can do about it,
//!   [`Archive::lost_of`] and [`Archive::hold`].
//! * Of evidence that is held, a sector can be lost where power is cut again and again while the last
//!   piece is written.
//! * If the newest entries of the journal are damaged at rest, those that were evidence are put back from the
//!   ring, as far as they follow on each other. Behind others the journal goes on with the number that the ring knows,
//!   and a reader is told that they are missing.
//! * A ring of another journal is known by its newest piece, while the journal still holds the entry
//!   of that number. If that entry is overwritten already, the ring is taken for the journal's own.

mod evidence;
#[cfg(test)]
mod tests;

pub use evidence::{ArchiveFault, FIELDS};

use core::ops::Range;

use umi_protocol::head::EvidenceMark;
use umi_protocol::message::{MAX_RECORD, Record};

use crate::journal::{Chain, Entry, Flash, Journal, JournalError, Recovery, encode_in_place};
use crate::units::Micros;
use crate::zero_option::ZeroOption;
use evidence::Evidence;

/// Room for a record as it is appended: [`FIELDS`] bytes before its own.
pub const ROOM: usize = FIELDS + MAX_RECORD;

/// Room in the ring that only what is urgent takes, where evidence is held.
pub const RESERVE: u32 = 2 * MAX_RECORD as u32;

/// Whether a record of this kind may take the reserve. Each is bounded by who may cause it: an owner,
/// a key, a start, or something that has begun while there was room.
const fn is_urgent(kind: u8) -> bool {
    // Boot, Recovered, JobSet, ReferenceRestored; CorrectionSent, ProgramSent; JobLost, Head,
    // Acknowledged, ConfigSet; Access, Wiped, Update.
    matches!(kind, 0..=3 | 12 | 18 | 23 | 24 | 27 | 28 | 30 | 32 | 33)
}

/// A piece of evidence: its number in the ring, and the ring.
type Located<'a, F> = (u64, &'a mut Evidence<F>);

/// The journal, and the evidence of it.
#[derive(Clone, Debug)]
pub struct Archive<F: Flash> {
    journal: Journal<F>,
    evidence: ZeroOption<Evidence<F>>,
    /// Evidence from this entry on is not overwritten.
    held: ZeroOption<u64>,
}

impl<F: Flash> Archive<F> {
    /// Finds the journal. Only reads.
    ///
    /// # Errors
    /// As [`Journal::open`].
    pub fn open(flash: F) -> Result<(Self, Recovery), JournalError<F::Error>> {
        let (journal, recovery) = Journal::open(flash)?;
        let archive = Self {
            journal,
            evidence: ZeroOption::empty(),
            held: ZeroOption::empty(),
        };
        Ok((archive, recovery))
    }

    /// Keeps evidence apart from now on; what of the journal's is not there yet is copied. Returns what was
    /// damaged: of the ring, and of the journal as the ring shows.
    ///
    /// # Errors
    /// [`ArchiveFault`]: no evidence is kept apart.
    pub fn keep_evidence(
        &mut self,
        flash: F,
        scratch: &mut [u8; ROOM],
    ) -> Result<Recovery, ArchiveFault<F::Error>> {
        let (mut evidence, mut found) = Evidence::open(flash, &self.journal)?;
        let lost = evidence.catch_up(&mut self.journal, scratch)?;
        self.evidence.put(evidence);
        found.damaged_entries = found.damaged_entries.saturating_add(lost);
        Ok(found)
    }

    /// Overwrites no evidence from this entry on; none: the oldest is overwritten.
    pub fn hold(&mut self, from: Option<u64>) {
        match from {
            Some(from) => self.held.put(from),
            None => self.held.clear(),
        }
    }

    /// Whether a piece of evidence of so many bytes finds room.
    pub fn takes(&mut self, len: usize, is_urgent: bool) -> bool {
        let Some(Evidence { ring, .. }) = self.evidence.get() else {
            return true;
        };
        let kept_free = if is_urgent { RESERVE / 2 } else { RESERVE };
        ring.free() >= len as u32 + kept_free || !self.is_held()
    }

    /// Whether the ring may not be erased any further.
    fn is_held(&mut self) -> bool {
        let next_seq = self.journal.next_seq();
        match (self.evidence.get_mut(), self.held.get()) {
            (Some(evidence), Some(from)) => evidence.would_lose(*from, next_seq),
            _ => false,
        }
    }

    /// Appends the record of `len` bytes that stands in `room` behind its first [`FIELDS`] bytes,
    /// and returns its number. After `Ok` it survives a power cut.
    ///
    /// # Errors
    /// [`JournalError::Full`]: neither of the two has it. As [`Journal::append`]: the journal may have it
    /// then, if only the evidence has not: it is copied at the next start.
    pub fn append(
        &mut self,
        kind: u8,
        t: Micros,
        room: &mut [u8; ROOM],
        len: usize,
    ) -> Result<u64, JournalError<F::Error>> {
        let is_evidence = Record::is_evidence(kind);
        let is_held = is_evidence && self.is_held();
        if is_held && !self.takes(len, is_urgent(kind)) {
            return Err(JournalError::Full);
        }
        let before = self.journal.chain_head();
        let payload = room.get(FIELDS..FIELDS + len).unwrap_or_default();
        let seq = self.journal.append(kind, t, payload)?;
        if let Some(evidence) = self.evidence.get_mut()
            && is_evidence
        {
            evidence.ring.hold(is_held);
            evidence.append(kind, t, seq, &before, room, len)?;
        }
        Ok(seq)
    }

    /// Erases ahead while the board has time for that: see [`Journal::prepare`].
    ///
    /// # Errors
    /// [`JournalError::Flash`].
    pub fn prepare(&mut self, min_free: u32) -> Result<(), JournalError<F::Error>> {
        self.journal.prepare(min_free)?;
        let is_low = |of: &Evidence<F>| of.ring.free() < min_free;
        let is_wanted = self.evidence.get().is_some_and(is_low) && !self.is_held();
        if let Some(evidence) = self.evidence.get_mut()
            && is_wanted
        {
            evidence.ring.hold(false);
            evidence.ring.prepare(min_free)?;
        }
        Ok(())
    }

    /// The oldest entry of the journal: from there on it holds all of them.
    #[must_use]
    pub fn first_seq(&self) -> u64 {
        self.journal.first_seq()
    }

    /// The number that the next entry will get.
    #[must_use]
    pub fn next_seq(&self) -> u64 {
        self.journal.next_seq()
    }

    /// The chain value that includes the newest entry.
    #[must_use]
    pub fn chain_head(&self) -> Chain {
        self.journal.chain_head()
    }

    /// The longest payload that both can keep.
    #[must_use]
    pub fn max_payload(&self) -> usize {
        let evidence = self.evidence.get();
        let most = evidence.map_or(usize::MAX, |of| of.ring.max_payload() - FIELDS);
        self.journal.max_payload().min(most)
    }

    /// The oldest entry at or behind `seq` that is there, in the journal or as evidence that can be read.
    ///
    /// # Errors
    /// [`JournalError::Flash`].
    pub fn next_there(&mut self, seq: u64) -> Result<u64, JournalError<F::Error>> {
        let oldest = self.journal.first_seq();
        if seq < oldest
            && let Some(evidence) = self.evidence.get_mut()
            && let Some((_, found)) = evidence.locate(seq)?
        {
            return Ok(found.min(oldest));
        }
        Ok(seq.max(oldest).min(self.journal.next_seq()))
    }

    /// Reads entry `seq` as it was appended. `into` needs as many bytes as its payload has.
    ///
    /// # Errors
    /// As [`Journal::read`]. An entry that was overwritten and was no evidence is
    /// [`JournalError::OutOfRange`].
    pub fn read<'b>(
        &mut self,
        seq: u64,
        into: &'b mut [u8],
    ) -> Result<Entry<'b>, JournalError<F::Error>> {
        Ok(self.journal.read(seq, into)?.entry)
    }

    /// Reads entry `seq` as it is encoded in a `.umij` file; the number of its bytes.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_encoded(
        &mut self,
        seq: u64,
        into: &mut [u8],
    ) -> Result<usize, JournalError<F::Error>> {
        let found = self.evidence_of(seq)?;
        let Some((number, evidence)) = found else {
            return self.journal.read_encoded(seq, into).map(<[u8]>::len);
        };
        let (_, before) = evidence.fields(number)?;
        let short = JournalError::BufferTooSmall { need: into.len() };
        let Some((_, place)) = into.split_at_mut_checked(crate::journal::FIELDS) else {
            return Err(short);
        };
        let piece = evidence.ring.read_piece(number, FIELDS, place)?;
        let entry = (piece.kind, piece.t, seq);
        encode_in_place(into, entry, piece.len, &before).ok_or(short)
    }

    /// The chain value before entry `seq`.
    ///
    /// # Errors
    /// As [`Journal::chain_before`].
    pub fn chain_before(&mut self, seq: u64) -> Result<Chain, JournalError<F::Error>> {
        match self.evidence_of(seq)? {
            Some((number, evidence)) => Ok(evidence.fields(number)?.1),
            None => self.journal.chain_before(seq),
        }
    }

    /// The evidence that entry `seq` is, if the journal has it no more.
    fn evidence_of(&mut self, seq: u64) -> Result<Option<Located<'_, F>>, JournalError<F::Error>> {
        if seq >= self.journal.first_seq() {
            return Ok(None);
        }
        let Some(evidence) = self.evidence.get_mut() else {
            return Ok(None);
        };
        let found = evidence.locate(seq)?.filter(|(_, of)| *of == seq);
        Ok(found.map(|(number, _)| (number, evidence)))
    }

    /// What a head says of the evidence; none: none is kept apart.
    ///
    /// # Errors
    /// [`JournalError::Flash`].
    pub fn mark(&mut self) -> Result<Option<EvidenceMark>, JournalError<F::Error>> {
        let next_seq = self.journal.next_seq();
        let Some(evidence) = self.evidence.get_mut() else {
            return Ok(None);
        };
        let ring = &mut evidence.ring;
        let (oldest, next) = (ring.first_seq(), ring.next_seq());
        // Behind a damaged header the chain is known again from the next one on.
        let is_known = ring.chain_before(oldest).is_ok();
        let first = match is_known {
            true => oldest,
            false => ring.next_readable(oldest..next, true)?.unwrap_or(next),
        };
        let first_chain = ring.chain_before(first)?.0;
        let chain = ring.chain_head().0;
        // Of a damaged piece the entry is not known: from the one behind it on. A reader finds that it is missing.
        let found = evidence.first_of(first..next)?;
        let first_seq = found.map_or(next_seq, |(_, seq)| seq);
        Ok(Some(EvidenceMark {
            first,
            first_seq,
            first_chain,
            next,
            chain,
        }))
    }

    /// How many of these entries are on the board no more: neither in the journal nor as evidence. Pieces that are damaged
    /// between others that can be read count as there; where the flash says nothing, all that the journal has no more.
    pub fn lost_of(&mut self, entries: Range<u64>) -> u64 {
        let end = entries.end.min(self.journal.first_seq());
        let gone = end.saturating_sub(entries.start);
        let Some(evidence) = self.evidence.get_mut().filter(|_| gone > 0) else {
            return gone;
        };
        match (evidence.locate(entries.start), evidence.behind(end)) {
            (Ok(Some((first, _))), Ok(behind)) => gone - behind.saturating_sub(first).min(gone),
            _ => gone,
        }
    }

    /// Whether there is a record of this kind, that is evidence, from this number of the ring on, and the number that its
    /// next will get. Reads all of them: a start that has looked before looks at what is new. What cannot be read says nothing.
    pub fn tells(&mut self, kind: u8, from: u64) -> (bool, u64) {
        let ring = match self.evidence.get_mut() {
            Some(Evidence { ring, .. }) => ring,
            None => &mut self.journal,
        };
        let end = ring.next_seq();
        // Another ring, where it has not come so far.
        let from = if from > end { 0 } else { from };
        let mut numbers = from.max(ring.first_seq())..end;
        let is_it = |number| {
            ring.read_piece(number, 0, &mut [])
                .is_ok_and(|piece| piece.kind == kind)
        };
        (numbers.any(is_it), end)
    }

    /// Whether less than `min_free` bytes of evidence can be kept before some from entry `from` on is
    /// overwritten, or was, where no ring keeps it apart.
    pub fn is_full(&mut self, from: u64, min_free: u32) -> bool {
        let next_seq = self.journal.next_seq();
        if let Some(evidence) = self.evidence.get_mut() {
            return evidence.ring.free() < min_free && evidence.would_lose(from, next_seq);
        }
        // The journal itself is all there is, and what comes in is never held back.
        let end = self.journal.next_to_go();
        let is_near = self.journal.free() < min_free && end.is_some_and(|end| end > from);
        is_near || self.journal.first_seq() > from
    }
}
