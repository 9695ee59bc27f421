//! The journal: the board's append-only, chained record that survives power loss.
//!
//! # Design
//!
//! Entries are numbered from 0 for the life of the board, without gaps. Each
//! carries a time, a kind, a payload that the journal does not look at, a CRC-32, and the start of a SHA-256 chain value over everything before and
//! including it. The bytes of an entry are drawn in `entry.rs`, of a sector
//! header in `sector.rs`, of a `.umij` file in `export.rs`.
//!
//! ```text
//!  sector, oldest              …            head                next
//! ┌────────┬──────┬───────┬───┐   ┌────────┬──────┬───┬───┬┄┄┄┐ ┌┄┄┄┄┄┄┄┄┄┐
//! │ header │ mark │ entry │ … │   │ header │ mark │ … │ … │   │ ┆ erased  ┆
//! └────────┴──────┴───────┴───┘   └────────┴──────┴───┴───┴┄┄┄┘ └┄┄┄┄┄┄┄┄┄┘
//!   └ generation, seq of the first entry,   └ set before the next sector is
//!     chain value before it, CRC              erased: it is no longer record
//! ```
//!
//! * **Acknowledged is kept.** [`append`](Journal::append) returns `Ok` when the
//!   entry has been programmed *and read back*. No later operation touches its
//!   words again until its sector is erased, a lap later.
//! * **Every state between two bits is a known state.** A torn entry fails its
//!   CRC, and the next one is found behind it by number, CRC and chain value. A
//!   sector is given up by a mark in the one before it, then erased, then given
//!   a header: a half-erased sector is never taken for record even if its old
//!   header survived, and a sector that was being erased or begun when power
//!   failed is erased again. What a sector holds from the first number of its
//!   successor on was never acknowledged and is not looked at.
//! * **A young journal needs no header.** While its first sector is its only one, the record begins there, on
//!   nothing: damage to that header costs nothing, and is told.
//! * **Opening only reads.** It can be cut as often as power likes.
//! * **A word is programmed once between erases**, as flash with error correction
//!   demands. After a power-up the rest of the page in use is left alone, since
//!   a program that was cut at its start can leave cells that only look erased,
//!   and behind a torn entry what more of it may have been programmed, as 0xFF.
//! * **Even wear.** Sectors are used in turn, each is erased once a lap, plus
//!   once for each power cut between its erase and its first use.
//! * **Loss is a record.** [`Recovery`] says what a power cut or damage has left;
//!   the application appends it as the first entry when it is not clean. Reading
//!   outside of what exists is [`JournalError::OutOfRange`] with both ends, never a
//!   silent skip.
//!
//! # Tradeoffs
//!
//! * An entry costs **32 bytes** beyond its payload, plus padding to the
//!   alignment (`write_size`, at least 4): on average 1.5 bytes at 4, 15.5 at 32.
//!   A sector costs 64 + alignment, rounded up to the alignment.
//! * Each entry carries 8 of the 32 bytes of its chain value; each sector header
//!   and the running value have all 32. A change is *found* by comparing a full
//!   value that someone noted elsewhere; the 8 bytes only *locate* the first
//!   entry that does not follow (by accident once in 2⁶⁴) and let a reader find
//!   the entry behind a torn one. 32 bytes in each would double the overhead.
//! * The CRC costs four bytes that the chain could save, and lets a single entry
//!   be checked when what stands before it is damaged.
//! * SHA-256 works on 64-byte blocks of `32 + 20 + n + 9` bytes: one block for
//!   n ≤ 3, two for n ≤ 67, 17 for n = 1000. A block is about 2,700 instructions
//!   on a Cortex-M7 and 5,300 on an M0+ (sha2 0.11, counted in its object code at
//!   `opt-level = "s"`; its code takes 7 and 9 KiB), so an ordinary entry is some
//!   10 µs at 480 MHz and 0.1 ms at 125 MHz: less than its program takes. A
//!   running hash over the whole record would save half a block for each entry,
//!   but could not be checked from its 32 bytes in the middle.
//! * Programs go through a 256-byte buffer on the stack, so an entry with up to
//!   224 bytes of payload is one program.
//! * Opening reads every sector header once or twice and the newest sector three
//!   times, which it also hashes: its chain value is not stored anywhere else.
//!
//! # Limitations
//!
//! * Taking the newest entries away leaves a shorter, valid record. Whoever must
//!   exclude that notes [`chain_head`](Journal::chain_head) and
//!   [`next_seq`](Journal::next_seq) outside of the board, or keeps a signed head
//!   ([`crate::trust::board_key`]). The chain itself has no key: who can write the flash can
//!   write another record, and only a head or a noted value tells the two apart.
//! * If the newest entry is damaged later, it cannot be told from a torn one: it
//!   is reported as `torn_bytes` and its number is used again. Damage to any
//!   other entry is reported as such, and no number is used twice.
//! * A word that was torn so late that it reads as complete is taken as complete;
//!   if it fades later, that entry is damaged. The first program after a
//!   power-up, torn so early that nothing of it can be read, is followed by
//!   another program of the same words; reading back decides.
//! * A torn entry whose payload holds the image of a whole later entry is taken
//!   for a damaged one: what is in the image can be read, never as proven.
//! * If the chain cannot be followed to the end of the newest sector, the rest of
//!   that sector is given up for new entries.
//! * A sector that cannot be erased any more is not skipped: the journal refuses
//!   entries with the flash's error, and what it holds can still be read.
//! * An entry does not cross sectors. A board whose records are longer than a
//!   sector joins sectors: its driver erases two for one, which may be cut between.
//! * Erased flash must read 0xFF. Sectors must all have one size.

pub mod archive;
mod error;
mod export;
pub(crate) mod flash;
pub(crate) mod format;
mod open;
mod read;
mod walk;
pub(crate) mod write;

#[cfg(test)]
#[allow(
    dead_code,
    reason = "what cuts power is used by tests/tests/keep/journal_power_cut"
)]
pub(crate) mod mock;
#[cfg(test)]
mod tests;

pub use error::{GeometryFault, JournalError, JournalFault};
pub use export::{
    EntryIter, FILE_HEADER_SIZE, FILE_HEADER_SIZE_1, FILE_VERSION, FileError, FileHeader, GAP_SIZE,
    Gap, decode_file, encode_entry,
};
pub use flash::{ERASED, Flash, Geometry};
pub use format::chain::{Chain, TAG_SIZE};
pub use format::entry::{Entry, encode_in_place};
pub use open::Recovery;
pub use read::{EntryPart, ReadEntry, Verified};

use crate::units::Micros;
use flash::LARGEST_WRITE;
use format::layout::Layout;
pub use format::layout::{FIELDS, MAX_PAYLOAD, OVERHEAD};
use format::sector::Header;
use open::{State, is_given_up, recover, set_oldest};
use walk::{Cursor, Extent};
use write::Stage;

/// The journal on a flash region. Its size is fixed and it holds no entry.
#[derive(Clone, Debug)]
pub struct Journal<F: Flash> {
    flash: F,
    extent: Extent,
    /// Generation of the head sector; 0 before the first sector is begun.
    generation: u64,
    /// Chain value that includes the newest entry.
    chain: Chain,
    /// The sector behind the head was given up: its mark is set.
    next_given_up: bool,
    /// The sector behind the head was erased in this power cycle.
    next_erased: bool,
    /// The sector behind the head must not be erased.
    is_held: bool,
    /// Where sequential reading goes on.
    cursor: Option<Cursor>,
}

/// What [`Journal::open_or_return`] could not open.
pub struct NotOpened<F: Flash> {
    /// Why.
    pub error: JournalError<F::Error>,
    /// The region, as it was.
    pub flash: F,
}

impl<F: Flash> Journal<F> {
    /// Finds the record in the region. Only reads: one header per sector, and
    /// the newest sector as a whole. An erased region is an empty journal.
    ///
    /// # Errors
    /// [`JournalError::NotAJournal`], [`JournalError::Version`], [`JournalError::OtherGeometry`]: the
    /// region holds something else, which is left as it is. [`JournalError::Geometry`]:
    /// it cannot hold a journal. [`JournalError::Flash`].
    pub fn open(flash: F) -> Result<(Self, Recovery), JournalError<F::Error>> {
        Self::open_or_return(flash).map_err(|not_opened| not_opened.error)
    }

    /// As [`open`](Self::open), and gives the flash back where that fails.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_or_return(mut flash: F) -> Result<(Self, Recovery), NotOpened<F>> {
        let State {
            extent,
            generation,
            chain,
            next_given_up,
            recovery,
        } = match recover(&mut flash) {
            Ok(state) => state,
            Err(error) => return Err(NotOpened { error, flash }),
        };
        let journal = Self {
            flash,
            extent,
            generation,
            chain,
            next_given_up,
            next_erased: false,
            is_held: false,
            cursor: None,
        };
        Ok((journal, recovery))
    }

    /// Destroys whatever the region holds: erases every sector. The next
    /// [`open`](Self::open) begins a new record at entry 0. If power is cut
    /// before it returns, call it again.
    ///
    /// # Errors
    /// [`JournalError::Geometry`], [`JournalError::Flash`].
    pub fn format(flash: &mut F) -> Result<(), JournalError<F::Error>> {
        let layout = Layout::new(flash.geometry()).map_err(JournalError::Geometry)?;
        for sector in 0..layout.sectors {
            flash.erase(sector).map_err(JournalError::Flash)?;
        }
        Ok(())
    }

    /// Appends an entry and returns its number. After `Ok` the entry survives a
    /// power cut at any later moment, until the ring comes round to it.
    ///
    /// If the current sector is full and [`prepare`](Self::prepare) was not
    /// called, this includes erasing a sector.
    ///
    /// # Errors
    /// [`JournalError::PayloadTooLong`]; [`JournalError::Flash`] and [`JournalError::NotKept`] when
    /// the flash fails: the entry is not acknowledged, its number will be used
    /// again, and the next append goes to another sector.
    pub fn append(
        &mut self,
        kind: u8,
        t: Micros,
        payload: &[u8],
    ) -> Result<u64, JournalError<F::Error>> {
        let max = self.max_payload();
        if payload.len() > max {
            return Err(JournalError::PayloadTooLong {
                len: payload.len(),
                max,
            });
        }
        match self.try_append(kind, t, payload) {
            // A worn word is not the end: the rest of this sector is given up.
            Err(JournalError::NotKept { .. }) => self.try_append(kind, t, payload),
            result => result,
        }
    }

    /// Erases the next sector ahead of its use if the current one has fewer than
    /// `min_free` bytes left, so that the appends that follow need not. This
    /// gives up the oldest sector when the ring is full. Returns true if it
    /// erased; call it when the board has time for that.
    ///
    /// # Errors
    /// [`JournalError::Flash`]; calling it again tries again.
    pub fn prepare(&mut self, min_free: u32) -> Result<bool, JournalError<F::Error>> {
        if self.next_erased || self.free() >= min_free {
            return Ok(false);
        }
        self.erase_next()?;
        Ok(true)
    }

    /// Erases the oldest sector no more, or does so again: meanwhile an entry that needs its room is
    /// [`JournalError::Full`], and is not there.
    pub fn hold(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    /// Gives up the rest of the current sector: the entry that comes next begins another one. For a copy
    /// that must not go with what it is a copy of where a sector is damaged.
    pub fn turn(&mut self) {
        self.extent.tail = self.extent.layout.end(self.extent.head);
    }

    /// From now on a sector that was written and whose header cannot be read is part of the record also
    /// where it is the oldest: what it holds can be read, not proven. Else it is given up.
    ///
    /// # Errors
    /// [`JournalError::Flash`].
    pub fn take_unproven(&mut self) -> Result<(), JournalError<F::Error>> {
        let Extent { layout, head, .. } = self.extent;
        self.extent.takes_unproven = true;
        let next = layout.next(head);
        let start = if self.next_given_up {
            layout.next(next)
        } else {
            next
        };
        set_oldest(&mut self.flash, &mut self.extent, start, self.generation)
            .map_err(JournalError::Flash)?;
        Ok(())
    }

    /// Goes on with this number, in another sector: those before it were given, and are lost.
    pub fn skip_to(&mut self, next_seq: u64) {
        self.extent.next_seq = next_seq.max(self.extent.next_seq);
        self.turn();
    }

    /// Bytes left in the current sector. An entry takes [`OVERHEAD`] and its
    /// payload, padded to the alignment.
    #[must_use]
    pub fn free(&self) -> u32 {
        self.extent.layout.end(self.extent.head) - self.extent.tail
    }

    /// Number of the oldest entry there is; equal to [`next_seq`](Self::next_seq)
    /// if there is none.
    #[must_use]
    pub fn first_seq(&self) -> u64 {
        self.extent.first_seq
    }

    /// The number that the next entry will get: how many there ever were.
    #[must_use]
    pub fn next_seq(&self) -> u64 {
        self.extent.next_seq
    }

    /// The end of what the next erasure of a sector takes away: the first entry behind that; none
    /// if it takes nothing, because the ring has not come round or the sector is erased already.
    pub fn next_to_go(&mut self) -> Option<u64> {
        let Extent {
            layout,
            oldest,
            head,
            ..
        } = self.extent;
        if self.next_erased || self.generation == 0 || layout.next(head) != oldest {
            return None;
        }
        let next_seq = self.extent.next_seq;
        // A sector whose header cannot be read counts to the one before it, and what cannot be read at
        // all for all that there is.
        let mut sector = oldest;
        while sector != head {
            sector = layout.next(sector);
            match walk::first_seq_of(&mut self.flash, &layout, sector) {
                Ok(behind) if behind <= next_seq => return Some(behind),
                _ => {}
            }
        }
        Some(next_seq)
    }

    /// The chain value that includes the newest entry. Noted elsewhere, it proves
    /// the whole record up to here.
    #[must_use]
    pub fn chain_head(&self) -> Chain {
        self.chain
    }

    /// The longest payload: [`MAX_PAYLOAD`] unless sectors are smaller than that.
    #[must_use]
    pub fn max_payload(&self) -> usize {
        self.extent.layout.max_payload()
    }

    /// The flash below, for its counters.
    #[must_use]
    pub fn flash(&self) -> &F {
        &self.flash
    }

    /// Gives the flash back.
    #[must_use]
    pub fn into_flash(self) -> F {
        self.flash
    }

    fn try_append(
        &mut self,
        kind: u8,
        t: Micros,
        payload: &[u8],
    ) -> Result<u64, JournalError<F::Error>> {
        let size = self.extent.layout.entry_size(payload.len() as u32);
        if size > self.free() {
            self.begin_next_sector()?;
        }
        let Extent {
            layout,
            tail,
            next_seq: seq,
            head,
            ..
        } = self.extent;
        // Until it is known to be there, this sector must take no other entry:
        // if what follows fails and is found whole after a power-up, an entry
        // behind it would have its number.
        self.extent.tail = layout.end(head);
        let mut stage = Stage::new(&mut self.flash, tail, layout.align);
        let entry = Entry {
            seq,
            t,
            kind,
            payload,
        };
        let chain = entry.emit(&self.chain, |piece| stage.push(piece))?;
        stage.finish()?;
        self.chain = chain;
        self.extent.tail = tail + size;
        self.extent.next_seq = seq + 1;
        Ok(seq)
    }

    /// Gives up the sector behind the head and erases it.
    fn erase_next(&mut self) -> Result<(), JournalError<F::Error>> {
        if self.is_held {
            return Err(JournalError::Full);
        }
        let Extent { layout, head, .. } = self.extent;
        let next = layout.next(head);
        self.next_erased = false;
        // Before the first sector there is no head to mark, and nothing to lose.
        if self.generation > 0 {
            self.mark_given_up()?;
            if self.extent.oldest == next {
                self.extent.oldest = head;
                self.extent.first_seq = self.extent.next_seq;
                let start = layout.next(next);
                set_oldest(&mut self.flash, &mut self.extent, start, self.generation)
                    .map_err(JournalError::Flash)?;
            }
        }
        if self.cursor.is_some_and(|cursor| cursor.sector == next) {
            self.cursor = None;
        }
        self.flash.erase(next).map_err(JournalError::Flash)?;
        self.next_erased = true;
        Ok(())
    }

    /// Sets the mark in the head sector. Any bit of it is enough, and all zeros may
    /// be programmed over a mark that a power cut left begun, also where flash with
    /// error correction refuses other values.
    fn mark_given_up(&mut self) -> Result<(), JournalError<F::Error>> {
        if self.next_given_up {
            return Ok(());
        }
        let Extent { layout, head, .. } = self.extent;
        let zeros = write::Buffer([0; LARGEST_WRITE]);
        let (mark, _) = zeros.0.split_at(layout.align as usize);
        let programmed = self.flash.program(layout.mark(head), mark);
        self.next_given_up =
            is_given_up(&mut self.flash, &layout, head).map_err(JournalError::Flash)?;
        match programmed {
            _ if self.next_given_up => Ok(()),
            Err(error) => Err(JournalError::Flash(error)),
            Ok(()) => Err(JournalError::NotKept {
                addr: layout.mark(head),
            }),
        }
    }

    /// Makes the sector behind the head the new head.
    fn begin_next_sector(&mut self) -> Result<(), JournalError<F::Error>> {
        if !self.next_erased {
            self.erase_next()?;
        }
        let Extent {
            layout,
            head,
            next_seq,
            ..
        } = self.extent;
        let next = layout.next(head);
        let generation = self.generation + 1;
        let header = Header {
            generation,
            first_seq: next_seq,
            chain: self.chain,
        };
        // If the header fails, the sector must be erased before another attempt.
        self.next_erased = false;
        let mut stage = Stage::new(&mut self.flash, layout.start(next), layout.align);
        stage.push(&header.encode(&layout))?;
        stage.finish()?;
        if let Some(cursor) = self.cursor.as_mut().filter(|cursor| cursor.sector == head) {
            cursor.end = next_seq;
        }
        self.extent.head = next;
        self.extent.tail = layout.data(next);
        self.generation = generation;
        self.next_given_up = false;
        Ok(())
    }
}
