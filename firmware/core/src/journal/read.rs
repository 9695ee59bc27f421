//! Reading the record back, one entry at a time, and proving it.

use core::ops::Range;

use super::Journal;
use super::error::{JournalError, JournalFault};
use super::flash::Flash;
use super::format::chain::Chain;
use super::format::entry::{Entry, Found};
use super::format::layout::OVERHEAD;
use super::format::sector::HeaderRead;
use super::walk::{Cursor, Step, read_header};
use crate::units::Micros;

/// An entry that was read from the flash; its CRC is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadEntry<'a> {
    /// The entry.
    pub entry: Entry<'a>,
    /// The chain is unbroken from the start of its sector to this entry. False
    /// behind damage: the entry is whole, but that nothing was changed before it
    /// in this sector cannot be shown.
    pub chained: bool,
}

/// What is known of an entry of which a part was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryPart {
    /// Its kind.
    pub kind: u8,
    /// When it happened.
    pub t: Micros,
    /// Bytes that were read.
    pub len: usize,
}

/// A part of the record that was walked through without finding a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verified {
    /// First entry looked at.
    pub first: u64,
    /// The entry after the last one looked at.
    pub next: u64,
    /// Chain value before `first`.
    pub chain_before: Chain,
    /// Chain value that includes the last entry looked at.
    pub chain: Chain,
}

impl<F: Flash> Journal<F> {
    /// Reads entry `seq`; `into` takes its payload ([`MAX_PAYLOAD`] bytes are
    /// always enough). Reading on from there is cheap; going back or far ahead
    /// starts at the sector's header.
    ///
    /// # Errors
    /// [`JournalError::OutOfRange`] with both ends of what there is;
    /// [`JournalError::BufferTooSmall`]; [`JournalError::Record`] if the entry is damaged or
    /// missing; [`JournalError::Flash`].
    ///
    /// [`MAX_PAYLOAD`]: super::MAX_PAYLOAD
    pub fn read<'b>(
        &mut self,
        seq: u64,
        into: &'b mut [u8],
    ) -> Result<ReadEntry<'b>, JournalError<F::Error>> {
        let (found, chained, cursor) = self.find(seq)?;
        let need = usize::from(found.fields.len);
        let (payload, _) = into
            .split_at_mut_checked(need)
            .ok_or(JournalError::BufferTooSmall { need })?;
        self.flash
            .read(found.payload_at(), payload)
            .map_err(JournalError::Flash)?;
        self.cursor = Some(cursor);
        let Found { fields, .. } = found;
        let entry = Entry {
            seq,
            t: fields.t,
            kind: fields.kind,
            payload,
        };
        Ok(ReadEntry { entry, chained })
    }

    /// Reads the payload of entry `seq` from byte `from` on, as much of it as there is and `into`
    /// takes.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_piece(
        &mut self,
        seq: u64,
        from: usize,
        into: &mut [u8],
    ) -> Result<EntryPart, JournalError<F::Error>> {
        let (found, _, cursor) = self.find(seq)?;
        let fields = found.fields;
        let len = usize::from(fields.len).saturating_sub(from).min(into.len());
        let (place, _) = into.split_at_mut(len);
        self.flash
            .read(found.payload_at() + from as u32, place)
            .map_err(JournalError::Flash)?;
        self.cursor = Some(cursor);
        Ok(EntryPart {
            kind: fields.kind,
            t: fields.t,
            len,
        })
    }

    /// Reads entry `seq` as it is encoded, for a `.umij` file. `into` needs
    /// [`OVERHEAD`] bytes more than the payload.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_encoded<'b>(
        &mut self,
        seq: u64,
        into: &'b mut [u8],
    ) -> Result<&'b [u8], JournalError<F::Error>> {
        let (found, _, cursor) = self.find(seq)?;
        let need = usize::from(found.fields.len) + OVERHEAD;
        let (bytes, _) = into
            .split_at_mut_checked(need)
            .ok_or(JournalError::BufferTooSmall { need })?;
        self.flash
            .read(found.addr, bytes)
            .map_err(JournalError::Flash)?;
        self.cursor = Some(cursor);
        Ok(bytes)
    }

    /// The first of these entries that can be read: what is damaged is passed over. With `chained`, the first one before which
    /// the chain is known.
    ///
    /// # Errors
    /// [`JournalError::Flash`].
    pub fn next_readable(
        &mut self,
        entries: Range<u64>,
        chained: bool,
    ) -> Result<Option<u64>, JournalError<F::Error>> {
        let first = entries.start.max(self.extent.first_seq);
        let end = entries.end.min(self.extent.next_seq);
        if first >= end {
            return Ok(None);
        }
        let mut cursor = self.cursor_near(first)?;
        // Each turn moves on.
        while cursor.seq < end {
            let before = cursor;
            match cursor
                .step(&mut self.flash, &self.extent)
                .map_err(JournalError::Flash)?
            {
                Step::Entry {
                    found,
                    chained: is_chained,
                } if (first..end).contains(&found.fields.seq) && (is_chained || !chained) => {
                    self.cursor = Some(before);
                    return Ok(Some(found.fields.seq));
                }
                Step::Entry { .. } | Step::Fault(_) => {}
                Step::End => break,
            }
        }
        Ok(None)
    }

    /// The chain value before entry `seq`, which a reader of the entries from
    /// there on needs to verify them.
    ///
    /// # Errors
    /// As [`read`](Self::read); [`JournalFault::ChainBroken`] if damage before `seq` in
    /// its sector hides it.
    pub fn chain_before(&mut self, seq: u64) -> Result<Chain, JournalError<F::Error>> {
        if seq == self.extent.next_seq {
            return Ok(self.chain);
        }
        let mut cursor = self.seek(seq)?;
        if cursor.chain.is_none() && cursor.seq == cursor.end {
            // Behind damage, at the end of a sector: the header of the next one knows the chain.
            self.cursor = None;
            cursor = self.seek(seq)?;
        }
        self.cursor = Some(cursor);
        cursor
            .chain
            .ok_or(JournalError::Record(JournalFault::ChainBroken { seq }))
    }

    /// Walks through entries `from..to` and recomputes every CRC and the chain,
    /// also from sector to sector. To verify a large journal without stopping
    /// everything else, call it for one stretch after the other: it goes on from
    /// where it ended, and the chain is followed across the calls.
    ///
    /// # Errors
    /// [`JournalError::Record`] names the first entry that is bad and how;
    /// [`JournalError::OutOfRange`]; [`JournalError::Flash`].
    pub fn verify(&mut self, from: u64, to: u64) -> Result<Verified, JournalError<F::Error>> {
        let next_seq = self.extent.next_seq;
        if to > next_seq || to < from {
            return Err(self.out_of_range(to));
        }
        let mut chain = self.chain_before(from)?;
        let chain_before = chain;
        if from < next_seq {
            let mut cursor = self.seek(from)?;
            while cursor.seq < to {
                match cursor
                    .step(&mut self.flash, &self.extent)
                    .map_err(JournalError::Flash)?
                {
                    Step::Entry { .. } => {}
                    Step::Fault(fault) => return Err(JournalError::Record(fault)),
                    Step::End => break,
                }
                chain = cursor.chain.unwrap_or(chain);
            }
            self.cursor = Some(cursor);
        }
        // At the end the value must be the one that append goes on from.
        if to == next_seq && chain != self.chain {
            return Err(JournalError::Record(JournalFault::ChainBroken {
                seq: next_seq,
            }));
        }
        Ok(Verified {
            first: from,
            next: to,
            chain_before,
            chain,
        })
    }

    fn out_of_range(&self, seq: u64) -> JournalError<F::Error> {
        let (first, next) = (self.extent.first_seq, self.extent.next_seq);
        JournalError::OutOfRange { seq, first, next }
    }

    /// Finds entry `seq`, and the cursor behind it.
    fn find(&mut self, seq: u64) -> Result<(Found, bool, Cursor), JournalError<F::Error>> {
        let mut cursor = self.seek(seq)?;
        // A fault right before the entry may have to be passed first.
        while cursor.seq <= seq {
            match cursor
                .step(&mut self.flash, &self.extent)
                .map_err(JournalError::Flash)?
            {
                Step::Entry { found, chained } if found.fields.seq == seq => {
                    return Ok((found, chained, cursor));
                }
                Step::Entry { .. } | Step::Fault(_) => {}
                Step::End => break,
            }
        }
        Err(JournalError::Record(JournalFault::Damaged { seq }))
    }

    /// A cursor at entry `seq`: from the last read if that is on the way, else
    /// from the header of its sector.
    fn seek(&mut self, seq: u64) -> Result<Cursor, JournalError<F::Error>> {
        if !(self.extent.first_seq..self.extent.next_seq).contains(&seq) {
            return Err(self.out_of_range(seq));
        }
        let mut cursor = self.cursor_near(seq)?;
        while cursor.seq < seq {
            if let Step::End = cursor
                .step(&mut self.flash, &self.extent)
                .map_err(JournalError::Flash)?
            {
                break;
            }
        }
        if cursor.seq > seq {
            return Err(JournalError::Record(JournalFault::Damaged { seq }));
        }
        Ok(cursor)
    }

    /// A cursor at entry `seq` or before it in its sector.
    fn cursor_near(&mut self, seq: u64) -> Result<Cursor, JournalError<F::Error>> {
        let near = self.cursor.filter(|cursor| {
            let in_sector = cursor.sector == self.extent.head || seq < cursor.end;
            cursor.seq == seq || (cursor.seq < seq && in_sector)
        });
        match near {
            Some(cursor) => Ok(cursor),
            None => self.sector_start(seq).map_err(JournalError::Flash),
        }
    }

    /// A cursor at the start of the sector that should hold entry `seq`.
    fn sector_start(&mut self, seq: u64) -> Result<Cursor, F::Error> {
        let layout = self.extent.layout;
        let mut sector = self.extent.head;
        loop {
            if let HeaderRead::Valid(header) = read_header(&mut self.flash, &layout, sector)?
                && header.first_seq <= seq
            {
                return Cursor::at_start(&mut self.flash, &layout, sector, &header);
            }
            if sector == self.extent.oldest {
                let first = self.extent.first_seq;
                return Cursor::at_start_unproven(&mut self.flash, &layout, sector, first);
            }
            sector = layout.previous(sector);
        }
    }
}
