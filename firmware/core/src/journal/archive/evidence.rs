//! The ring of evidence: entries of a journal, with their number and what they are chained to.

use core::ops::Range;

use umi_protocol::message::Record;

use super::ROOM;
use crate::journal::format::chain::CRC32;
use crate::journal::{Chain, Flash, Journal, JournalError, ReadEntry, Recovery};
use crate::units::Micros;

/// Bytes before the payload of an entry that is evidence: its number, 8 bytes little endian, and
/// the chain value before it.
pub const FIELDS: usize = 8 + 32;

/// Pieces that are tried where some are damaged.
const TRIED: usize = 8;

/// Why no evidence is kept apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArchiveFault<E> {
    /// One of the two journals.
    Journal(JournalError<E>),
    /// No piece of evidence that the journal should have is the entry of that number there: the ring is that
    /// of another journal.
    OtherJournal,
}

impl<E> From<JournalError<E>> for ArchiveFault<E> {
    fn from(error: JournalError<E>) -> Self {
        Self::Journal(error)
    }
}

/// The ring.
#[derive(Clone, Debug)]
pub(super) struct Evidence<F: Flash> {
    pub ring: Journal<F>,
    /// What was looked for last: its number here, and the entry that it is.
    hint: (u64, u64),
}

impl<F: Flash> Evidence<F> {
    /// Finds the ring. One that is damaged where it would go on is made anew as long as the journal has everything from
    /// its first entry on, so that it becomes what it was: its chain would go on from before the damage, and no reader
    /// could follow it.
    pub fn open(
        flash: F,
        journal: &Journal<F>,
    ) -> Result<(Self, Recovery), JournalError<F::Error>> {
        let (mut ring, found) = Journal::open(flash)?;
        // Each piece has its number and its chain value with it: the header of its sector proves nothing of it.
        ring.take_unproven()?;
        let is_damaged = found.chain_restarted || found.damaged_entries > 0;
        let ring = if is_damaged && ring.first_seq() == 0 && journal.first_seq() == 0 {
            let mut flash = ring.into_flash();
            Journal::format(&mut flash)?;
            let mut ring = Journal::open(flash)?.0;
            ring.take_unproven()?;
            ring
        } else {
            ring
        };
        let evidence = Self {
            ring,
            hint: (u64::MAX, 0),
        };
        Ok((evidence, found))
    }

    /// Copies what the journal has and the ring has not: all of it, into a new ring. What the journal has lost at its end,
    /// and the ring has, goes the other way. Returns how many entries the journal has lost for good.
    pub fn catch_up(
        &mut self,
        journal: &mut Journal<F>,
        scratch: &mut [u8; ROOM],
    ) -> Result<u64, ArchiveFault<F::Error>> {
        let mut lost = 0;
        let numbers = self.ring.first_seq()..self.ring.next_seq();
        let mut newest = numbers.clone().rev().take(TRIED);
        let newest = newest.find_map(|number| Some((number, self.fields(number).ok()?)));
        let from = match newest {
            Some((_, (seq, _))) if seq >= journal.next_seq() => {
                lost = self.give_back(journal, seq, scratch)?;
                journal.next_seq()
            }
            Some((newest, (seq, before))) => {
                if !self.is_of(journal, newest, seq, &before, scratch)? {
                    return Err(ArchiveFault::OtherJournal);
                }
                seq + 1
            }
            None if numbers.is_empty() => 0,
            // Damage hides what the ring has: nothing is put in twice, and what comes is kept.
            None => journal.next_seq(),
        };
        for seq in from.max(journal.first_seq())..journal.next_seq() {
            let (_, place) = scratch.split_at_mut(FIELDS);
            // What is damaged cannot be copied; a reader is told of it when it is pulled.
            let Ok(found) = journal.read(seq, place) else {
                continue;
            };
            let (kind, t, len) = (found.entry.kind, found.entry.t, found.entry.payload.len());
            if Record::is_evidence(kind)
                && let Ok(before) = journal.chain_before(seq)
            {
                self.append(kind, t, seq, &before, scratch, len)?;
            }
        }
        Ok(lost)
    }

    /// The journal has lost what stood at its end, up to entry `last` at least, as far as the ring tells. The pieces that
    /// follow on what it has are put back, each as the entry that it was. Where others are gone, their numbers are not given
    /// again: a reader is told that they are missing. Returns how many that are.
    fn give_back(
        &mut self,
        journal: &mut Journal<F>,
        last: u64,
        scratch: &mut [u8; ROOM],
    ) -> Result<u64, ArchiveFault<F::Error>> {
        // The newest piece that the journal should have.
        let known = self.behind(journal.next_seq())?;
        let mut older = (self.ring.first_seq()..known).rev().take(TRIED);
        let older = older.find_map(|number| Some((number, self.fields(number).ok()?)));
        let mut is_of = false;
        if let Some((number, (seq, before))) = older
            && seq >= journal.first_seq()
        {
            is_of = self.is_of(journal, number, seq, &before, scratch)?;
            if !is_of {
                return Err(ArchiveFault::OtherJournal);
            }
        }
        // On an empty journal the first piece of any ring follows.
        let is_empty = journal.next_seq() == 0;
        for number in known..self.ring.next_seq() {
            let follows = self.fields(number).is_ok_and(|(seq, before)| {
                seq == journal.next_seq() && before == journal.chain_head()
            });
            if !follows || is_empty {
                break;
            }
            is_of = true;
            let (_, place) = scratch.split_at_mut(FIELDS);
            let piece = self.ring.read_piece(number, FIELDS, place)?;
            let payload = place.get(..piece.len).unwrap_or_default();
            journal.append(piece.kind, piece.t, payload)?;
        }
        if !is_of {
            return Err(ArchiveFault::OtherJournal);
        }
        let next = last.saturating_add(1);
        let lost = next.saturating_sub(journal.next_seq());
        if lost > 0 {
            journal.skip_to(next);
        }
        Ok(lost)
    }

    /// Whether the journal has this piece as its entry `seq`, as far as it still has that: it may
    /// be overwritten, or damaged at rest. The chain value before it stands for all before it.
    fn is_of(
        &mut self,
        journal: &mut Journal<F>,
        number: u64,
        seq: u64,
        before: &Chain,
        scratch: &mut [u8; ROOM],
    ) -> Result<bool, ArchiveFault<F::Error>> {
        if seq < journal.first_seq() {
            return Ok(true);
        }
        match journal.chain_before(seq) {
            Ok(of_journal) if of_journal != *before => return Ok(false),
            Ok(_) | Err(JournalError::Record(_)) => {}
            Err(error) => return Err(error.into()),
        }
        let (_, place) = scratch.split_at_mut(FIELDS);
        let piece = self.ring.read_piece(number, FIELDS, place)?;
        let digest = CRC32.checksum(place.get(..piece.len).unwrap_or_default());
        match journal.read(seq, place) {
            Ok(ReadEntry { entry, .. }) => Ok((entry.kind, entry.t) == (piece.kind, piece.t)
                && CRC32.checksum(entry.payload) == digest),
            Err(JournalError::Record(_)) => Ok(true),
            Err(error) => Err(error.into()),
        }
    }

    /// Appends entry `seq`, whose payload of `len` bytes stands in `room` behind [`FIELDS`].
    pub fn append(
        &mut self,
        kind: u8,
        t: Micros,
        seq: u64,
        before: &Chain,
        room: &mut [u8; ROOM],
        len: usize,
    ) -> Result<(), JournalError<F::Error>> {
        let fields = seq.to_le_bytes().into_iter().chain(before.0);
        for (place, byte) in room.iter_mut().zip(fields) {
            *place = byte;
        }
        let payload = room.get(..FIELDS + len).unwrap_or_default();
        self.ring.append(kind, t, payload).map(|_| ())
    }

    /// The entry that a piece of evidence is, and the chain value before that.
    pub fn fields(&mut self, number: u64) -> Result<(u64, Chain), JournalError<F::Error>> {
        let mut fields = [0; FIELDS];
        self.ring.read_piece(number, 0, &mut fields)?;
        let (mut seq, mut chain) = ([0; 8], [0; 32]);
        let (first, last) = fields.split_at(seq.len());
        seq.copy_from_slice(first);
        chain.copy_from_slice(last);
        Ok((u64::from_le_bytes(seq), Chain(chain)))
    }

    /// Whether the next erasure takes evidence from entry `from` on away, as far as the first piece
    /// behind it tells, which is found at once. Behind damage a later one tells, or where none can be read
    /// the journal's end: never too little is held, and who has acknowledged everything finds room.
    pub fn would_lose(&mut self, from: u64, next_seq: u64) -> bool {
        let Some(end) = self.ring.next_to_go() else {
            return false;
        };
        let behind = end..self.ring.next_seq();
        let stride = behind.end.saturating_sub(end) / TRIED as u64;
        let far = (1..TRIED as u64).map(|n| end.saturating_add(stride.saturating_mul(n)));
        let first = (behind.take(TRIED).chain(far)).find_map(|number| self.fields(number).ok());
        first.map_or(next_seq, |(seq, _)| seq) > from
    }

    /// The first of these pieces that can be read: its number, and the entry that it is.
    pub fn first_of(
        &mut self,
        numbers: Range<u64>,
    ) -> Result<Option<(u64, u64)>, JournalError<F::Error>> {
        match self.ring.next_readable(numbers, false)? {
            Some(number) => Ok(Some((number, self.fields(number)?.0))),
            None => Ok(None),
        }
    }

    /// The first piece at or behind entry `seq` that can be read: its number, and the entry that it is. One that is damaged
    /// hides no other.
    pub fn locate(&mut self, seq: u64) -> Result<Option<(u64, u64)>, JournalError<F::Error>> {
        let numbers = self.ring.first_seq()..self.ring.next_seq();
        if self.hint.1 == seq && numbers.contains(&self.hint.0) {
            return Ok(Some(self.hint));
        }
        let behind = self.behind(seq)?;
        let found = self.first_of(behind..numbers.end)?;
        self.hint = found.unwrap_or(self.hint);
        Ok(found)
    }

    /// The number behind the last piece before entry `seq` that can be read.
    pub fn behind(&mut self, seq: u64) -> Result<u64, JournalError<F::Error>> {
        let (mut low, mut high) = (self.ring.first_seq(), self.ring.next_seq());
        let (number, entry) = self.hint;
        if (low..high).contains(&number) {
            // Readers go on from where they were.
            match entry < seq {
                true => low = number.saturating_add(1),
                false => high = number,
            }
        }
        let mut middle = low;
        while low < high {
            match self.first_of(middle..high)? {
                Some((number, entry)) if entry < seq => low = number.saturating_add(1),
                _ => high = middle,
            }
            middle = low.midpoint(high);
        }
        Ok(low)
    }
}
