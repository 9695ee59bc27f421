//! Walking through the entries of a ring of sectors, past everything that a
//! power cut or a worn cell can leave between them.

use super::error::JournalFault;
use super::flash::{ERASED, Flash};
use super::format::chain::Chain;
use super::format::entry::{Found, MARKER, announced_len, chain_over, probe};
use super::format::layout::{HEADER_SIZE, Layout, OVERHEAD};
use super::format::sector::{Header, HeaderRead};

/// Which part of the flash holds the record.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub layout: Layout,
    /// The sector with the oldest entries.
    pub oldest: u32,
    /// The oldest entry there is.
    pub first_seq: u64,
    /// The sector that is being filled.
    pub head: u32,
    /// Where the next entry goes; the end of the head sector if it is full.
    pub tail: u32,
    /// The number that the next entry will get.
    pub next_seq: u64,
    /// The record begins also with a sector whose header cannot be read.
    pub takes_unproven: bool,
}

/// A place between two entries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cursor {
    pub sector: u32,
    pub addr: u32,
    /// The entry expected here.
    pub seq: u64,
    /// First entry of the following sector, `u64::MAX` if unknown. What a sector
    /// holds from there on was never acknowledged. Not used in the head sector.
    pub end: u64,
    /// Chain value before `seq`; nothing behind damage, until the next header.
    pub chain: Option<Chain>,
}

/// What a step along the record came upon.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// The next entry.
    Entry {
        found: Found,
        /// The chain is unbroken from the sector's header to this entry.
        chained: bool,
    },
    /// Something is wrong here; the cursor stands behind it.
    Fault(JournalFault),
    /// The newest entry was passed.
    End,
}

impl Cursor {
    /// The first entry of a sector with this header.
    pub fn at_start<F: Flash>(
        flash: &mut F,
        layout: &Layout,
        sector: u32,
        header: &Header,
    ) -> Result<Self, F::Error> {
        Ok(Self {
            sector,
            addr: layout.data(sector),
            seq: header.first_seq,
            end: first_seq_of(flash, layout, layout.next(sector))?,
            chain: Some(header.chain),
        })
    }

    /// The start of a sector whose header cannot be read.
    pub fn at_start_unproven<F: Flash>(
        flash: &mut F,
        layout: &Layout,
        sector: u32,
        seq: u64,
    ) -> Result<Self, F::Error> {
        let end = first_seq_of(flash, layout, layout.next(sector))?;
        Ok(Self {
            sector,
            addr: layout.data(sector),
            seq,
            end,
            // The first entry of all follows on nothing.
            chain: (seq == 0).then_some(Chain::GENESIS),
        })
    }

    /// Moves behind the next entry or the next fault.
    pub fn step<F: Flash>(&mut self, flash: &mut F, extent: &Extent) -> Result<Step, F::Error> {
        let layout = &extent.layout;
        // Each turn moves on by a sector, and the head sector always returns.
        for _ in 0..=layout.sectors {
            if self.seq >= extent.next_seq {
                return Ok(Step::End);
            }
            let in_head = self.sector == extent.head;
            let (end, limit) = if in_head {
                (extent.next_seq, extent.tail)
            } else {
                (self.end.min(extent.next_seq), layout.end(self.sector))
            };
            if self.seq < end {
                let search = search(flash, layout, self, limit)?;
                if let Some(hit) = search.hit.filter(|hit| hit.found.fields.seq < end) {
                    return Ok(self.pass(layout, &hit));
                }
            }
            if in_head {
                let fault = gap(self.seq, extent.next_seq);
                self.seq = extent.next_seq;
                self.chain = None;
                return Ok(Step::Fault(fault));
            }
            if let Some(fault) = self.enter(flash, layout, layout.next(self.sector))? {
                return Ok(Step::Fault(fault));
            }
        }
        Ok(Step::End)
    }

    /// Moves behind `hit`, or up to it if something is wrong before it.
    pub fn pass(&mut self, layout: &Layout, hit: &Hit) -> Step {
        let found = hit.found;
        let expected = self.seq;
        self.addr = found.addr;
        self.seq = found.fields.seq;
        if found.fields.seq != expected {
            self.chain = None;
            return Step::Fault(gap(expected, found.fields.seq));
        }
        if self.chain.is_some() && hit.chain.is_none() {
            self.chain = None;
            return Step::Fault(JournalFault::ChainBroken { seq: expected });
        }
        self.addr += layout.entry_size(u32::from(found.fields.len));
        self.seq += 1;
        self.chain = hit.chain;
        Step::Entry {
            found,
            chained: hit.chain.is_some(),
        }
    }

    /// Moves to the start of the next sector; says if it does not follow.
    fn enter<F: Flash>(
        &mut self,
        flash: &mut F,
        layout: &Layout,
        sector: u32,
    ) -> Result<Option<JournalFault>, F::Error> {
        let before = *self;
        let HeaderRead::Valid(header) = read_header(flash, layout, sector)? else {
            *self = Self::at_start_unproven(flash, layout, sector, before.seq)?;
            return Ok(before
                .chain
                .map(|_| JournalFault::ChainBroken { seq: before.seq }));
        };
        *self = Self::at_start(flash, layout, sector, &header)?;
        Ok(if header.first_seq > before.seq {
            Some(gap(before.seq, header.first_seq))
        } else if header.first_seq < before.seq
            || before.chain.is_some_and(|chain| chain != header.chain)
        {
            Some(JournalFault::ChainBroken {
                seq: header.first_seq,
            })
        } else {
            None
        })
    }
}

/// The fault for entries `first..next` that cannot be read.
fn gap(first: u64, next: u64) -> JournalFault {
    if next.saturating_sub(first) == 1 {
        JournalFault::Damaged { seq: first }
    } else {
        JournalFault::Missing { first, next }
    }
}

/// An entry that a search found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub found: Found,
    /// The chain value that includes it, if it follows from the cursor's.
    pub chain: Option<Chain>,
}

/// Result of a search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    pub hit: Option<Hit>,
    /// Behind the last byte that is not erased, when nothing was hit.
    pub used: u32,
    /// The furthest end that anything like the start of an entry announces, when
    /// nothing was hit.
    pub announced: u32,
}

/// Looks for the cursor's entry between the cursor and `limit`.
///
/// Nearly always it is right there. Otherwise there is a gap: the rest of a page
/// left alone at power-up, an entry that a power cut tore, or damage. So the
/// first whole entry that can follow is taken, with the expected number or a
/// later one: one bad entry neither hides those behind it nor makes the journal
/// use their numbers again.
pub(super) fn search<F: Flash>(
    flash: &mut F,
    layout: &Layout,
    cursor: &Cursor,
    limit: u32,
) -> Result<Search, F::Error> {
    let (mut used, mut announced) = (cursor.addr, cursor.addr);
    let mut hit = entry_at(flash, cursor, cursor.addr, limit)?;
    let mut buffer = [0; 64];
    let mut at = cursor.addr;
    while hit.is_none() && at < limit {
        let (piece, _) = buffer.split_at_mut((limit - at).min(64) as usize);
        flash.read(at, piece)?;
        for (addr, byte) in (at..).zip(piece.iter()) {
            if *byte != ERASED {
                used = addr + 1;
            }
            if *byte != MARKER || addr % layout.align != 0 || hit.is_some() {
                continue;
            }
            if addr != cursor.addr {
                hit = entry_at(flash, cursor, addr, limit)?;
            }
            let mut start = [0; 4];
            flash.read(addr, &mut start)?;
            if let Some(len) = announced_len(start) {
                announced = announced.max(addr + layout.entry_size(u32::from(len)));
            }
        }
        at += piece.len() as u32;
    }
    Ok(Search {
        hit,
        used,
        announced,
    })
}

/// The entry at `addr`, if there is a whole one that can follow on the cursor.
fn entry_at<F: Flash>(
    flash: &mut F,
    cursor: &Cursor,
    addr: u32,
    limit: u32,
) -> Result<Option<Hit>, F::Error> {
    let Ok(found) = probe(flash, addr, limit)? else {
        return Ok(None);
    };
    // No more entries can be missing than fit in between.
    let most = u64::from((addr - cursor.addr) / OVERHEAD as u32);
    let chain = match (found.fields.seq.checked_sub(cursor.seq), &cursor.chain) {
        (Some(0), Some(before)) => chain_over(flash, &found, before)?,
        (Some(ahead), _) if ahead <= most => None,
        _ => return Ok(None),
    };
    Ok(Some(Hit { found, chain }))
}

/// Reads what stands in the place of a sector's header.
pub(super) fn read_header<F: Flash>(
    flash: &mut F,
    layout: &Layout,
    sector: u32,
) -> Result<HeaderRead, F::Error> {
    let mut bytes = [0; HEADER_SIZE];
    flash.read(layout.start(sector), &mut bytes)?;
    Ok(Header::decode(&bytes, layout))
}

/// The first entry of a sector, `u64::MAX` if its header cannot be read.
pub(super) fn first_seq_of<F: Flash>(
    flash: &mut F,
    layout: &Layout,
    sector: u32,
) -> Result<u64, F::Error> {
    Ok(match read_header(flash, layout, sector)? {
        HeaderRead::Valid(header) => header.first_seq,
        _ => u64::MAX,
    })
}

/// True if nothing in `from..to` is programmed.
pub(super) fn is_erased<F: Flash>(flash: &mut F, from: u32, to: u32) -> Result<bool, F::Error> {
    let mut buffer = [0; 64];
    let mut at = from;
    while at < to {
        let (piece, _) = buffer.split_at_mut((to - at).min(64) as usize);
        flash.read(at, piece)?;
        if piece.iter().any(|byte| *byte != ERASED) {
            return Ok(false);
        }
        at += piece.len() as u32;
    }
    Ok(true)
}
