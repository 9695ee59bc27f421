//! Recovery of the record after a power cycle. Nothing is written here, so
//! that a second power cut during recovery finds what the first one left.

use super::error::JournalError;
use super::flash::Flash;
use super::format::chain::Chain;
use super::format::entry::probe;
use super::format::layout::{HEADER_SIZE, Layout, OVERHEAD};
use super::format::sector::{Header, HeaderRead};
use super::walk::{Cursor, Extent, Step, is_erased, read_header, search};

/// What [`Journal::open`](super::Journal::open) found. Unless it
/// [is clean](Self::is_clean), the application appends an entry that says so:
/// loss is a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovery {
    /// The oldest entry there is.
    pub first_seq: u64,
    /// The number that the next entry will get.
    pub next_seq: u64,
    /// The region was empty: this is the start of a new record.
    pub fresh: bool,
    /// Bytes behind the newest entry that belong to no whole entry: what a power
    /// cut left of an entry that was never acknowledged.
    pub torn_bytes: u32,
    /// Power was cut while the next sector was erased or begun; it will be
    /// erased again. Nothing that was acknowledged is affected.
    pub sector_unfinished: bool,
    /// Entries of the newest sector that were acknowledged and cannot be read.
    pub damaged_entries: u64,
    /// Sectors that were written and whose header cannot be read. If they are the
    /// oldest, their entries are lost; else they can be read but not proven.
    pub damaged_headers: u32,
    /// The newest sector is damaged, so the chain goes on in a new sector from
    /// the last entry that could be proven; `verify` names the place.
    pub chain_restarted: bool,
}

impl Recovery {
    /// True if nothing was lost: neither an entry that was being appended nor
    /// one that was acknowledged.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.torn_bytes == 0
            && self.damaged_entries == 0
            && self.damaged_headers == 0
            && !self.chain_restarted
    }

    /// Adds what is damaged elsewhere.
    pub fn add(&mut self, other: &Self) {
        self.damaged_entries = self.damaged_entries.saturating_add(other.damaged_entries);
        self.damaged_headers = self.damaged_headers.saturating_add(other.damaged_headers);
        self.chain_restarted |= other.chain_restarted;
    }
}

/// Everything a journal needs to go on.
pub(super) struct State {
    pub extent: Extent,
    /// Generation of the head sector; 0 if no sector was ever written.
    pub generation: u64,
    pub chain: Chain,
    /// The sector behind the head was given up.
    pub next_given_up: bool,
    pub recovery: Recovery,
}

/// Reads the region and finds both ends of the record.
pub(super) fn recover<F: Flash>(flash: &mut F) -> Result<State, JournalError<F::Error>> {
    let layout = Layout::new(flash.geometry()).map_err(JournalError::Geometry)?;
    let Some((sector, header)) = newest_sector(flash, &layout)? else {
        return fresh(flash, layout);
    };
    let cursor = Cursor::at_start(flash, &layout, sector, &header).map_err(JournalError::Flash)?;
    let mut head = Head {
        cursor: Cursor {
            end: u64::MAX,
            ..cursor
        },
        generation: header.generation,
        first_seq: header.first_seq,
        proven: header.chain,
        used: cursor.addr,
        announced: cursor.addr,
        damaged_entries: 0,
        broken: false,
    };
    head.run(flash, &layout).map_err(JournalError::Flash)?;
    let mut next_given_up = is_given_up(flash, &layout, sector).map_err(JournalError::Flash)?;
    let mut sector_unfinished = false;
    if next_given_up {
        let next = layout.next(sector);
        if head
            .move_on(flash, &layout, next)
            .map_err(JournalError::Flash)?
        {
            next_given_up = is_given_up(flash, &layout, next).map_err(JournalError::Flash)?;
        } else {
            sector_unfinished = !is_erased(flash, layout.start(next), layout.end(next))
                .map_err(JournalError::Flash)?;
        }
    }
    head.finish(flash, layout, next_given_up, sector_unfinished)
        .map_err(JournalError::Flash)
}

/// The sector with the highest generation. Refuses a journal that is not ours.
fn newest_sector<F: Flash>(
    flash: &mut F,
    layout: &Layout,
) -> Result<Option<(u32, Header)>, JournalError<F::Error>> {
    let mut newest: Option<(u32, Header)> = None;
    for sector in 0..layout.sectors {
        match read_header(flash, layout, sector).map_err(JournalError::Flash)? {
            HeaderRead::Valid(header) => {
                if newest.is_none_or(|(_, best)| header.generation > best.generation) {
                    newest = Some((sector, header));
                }
            }
            HeaderRead::OtherVersion(found) => return Err(JournalError::Version { found }),
            HeaderRead::OtherGeometry {
                sectors,
                sector_size,
                align,
            } => {
                return Err(JournalError::OtherGeometry {
                    sectors,
                    sector_size,
                    align,
                });
            }
            HeaderRead::None => {}
        }
    }
    Ok(newest)
}

/// A record that has no entry yet. The first sector may be anything but the
/// remains of a record: power may have been cut while it was prepared.
fn fresh<F: Flash>(flash: &mut F, layout: Layout) -> Result<State, JournalError<F::Error>> {
    let first = Cursor {
        sector: 0,
        addr: layout.data(0),
        seq: 0,
        end: u64::MAX,
        chain: None,
    };
    let found = search(flash, &layout, &first, layout.end(0)).map_err(JournalError::Flash)?;
    let rest = layout.end(layout.sectors - 1);
    if !is_erased(flash, layout.end(0), rest).map_err(JournalError::Flash)? {
        return Err(JournalError::NotAJournal);
    }
    if found.hit.is_some() {
        return young(flash, layout, first);
    }
    let sector_unfinished =
        !is_erased(flash, layout.start(0), layout.end(0)).map_err(JournalError::Flash)?;
    let recovery = Recovery {
        first_seq: 0,
        next_seq: 0,
        fresh: true,
        torn_bytes: 0,
        sector_unfinished,
        damaged_entries: 0,
        damaged_headers: 0,
        chain_restarted: false,
    };
    // As if the last sector were full: the first append begins sector 0.
    let head = layout.sectors - 1;
    let extent = Extent {
        layout,
        oldest: 0,
        first_seq: 0,
        head,
        tail: layout.end(head),
        next_seq: 0,
        takes_unproven: false,
    };
    Ok(State {
        extent,
        generation: 0,
        chain: Chain::GENESIS,
        next_given_up: false,
        recovery,
    })
}

/// A record in its first sector, whose header was good once and has been damaged since: it is known by
/// its first entry, which follows on nothing.
fn young<F: Flash>(
    flash: &mut F,
    layout: Layout,
    first: Cursor,
) -> Result<State, JournalError<F::Error>> {
    let cursor = Cursor {
        chain: Some(Chain::GENESIS),
        ..first
    };
    let found = search(flash, &layout, &cursor, layout.end(0)).map_err(JournalError::Flash)?;
    if found.hit.is_none_or(|hit| hit.chain.is_none()) {
        return Err(JournalError::NotAJournal);
    }
    let mut head = Head {
        cursor,
        generation: 1,
        first_seq: 0,
        proven: Chain::GENESIS,
        used: cursor.addr,
        announced: cursor.addr,
        damaged_entries: 0,
        broken: false,
    };
    head.run(flash, &layout).map_err(JournalError::Flash)?;
    let next_given_up = is_given_up(flash, &layout, 0).map_err(JournalError::Flash)?;
    head.finish(flash, layout, next_given_up, false)
        .map_err(JournalError::Flash)
}

/// The newest sector while it is read to its end.
struct Head {
    cursor: Cursor,
    generation: u64,
    first_seq: u64,
    /// Chain value after the last entry that could be proven.
    proven: Chain,
    used: u32,
    announced: u32,
    damaged_entries: u64,
    broken: bool,
}

impl Head {
    /// Reads the entries of the sector that the cursor stands in.
    fn run<F: Flash>(&mut self, flash: &mut F, layout: &Layout) -> Result<(), F::Error> {
        let limit = layout.end(self.cursor.sector);
        loop {
            let search = search(flash, layout, &self.cursor, limit)?;
            let Some(hit) = search.hit else {
                self.used = search.used;
                self.announced = search.announced;
                return Ok(());
            };
            let expected = self.cursor.seq;
            match self.cursor.pass(layout, &hit) {
                Step::Entry { .. } => self.proven = self.cursor.chain.unwrap_or(self.proven),
                // The next turn finds the same entry as the expected one.
                _ => {
                    self.damaged_entries += self.cursor.seq - expected;
                    self.broken = true;
                }
            }
        }
    }

    /// The next sector was given up, and erased before anything was written to
    /// it. If it holds entries that go on from here, then its header was good
    /// once and has been damaged since: it is the head.
    fn move_on<F: Flash>(
        &mut self,
        flash: &mut F,
        layout: &Layout,
        next: u32,
    ) -> Result<bool, F::Error> {
        let cursor = Cursor {
            sector: next,
            addr: layout.data(next),
            seq: self.cursor.seq,
            end: u64::MAX,
            chain: None,
        };
        if search(flash, layout, &cursor, layout.end(next))?
            .hit
            .is_none()
        {
            return Ok(false);
        }
        self.cursor = cursor;
        self.generation += 1;
        self.first_seq = cursor.seq;
        self.broken = true;
        self.run(flash, layout)?;
        Ok(true)
    }

    fn finish<F: Flash>(
        self,
        flash: &mut F,
        layout: Layout,
        next_given_up: bool,
        sector_unfinished: bool,
    ) -> Result<State, F::Error> {
        let Cursor {
            sector: head,
            seq: next_seq,
            addr,
            ..
        } = self.cursor;
        let end = layout.end(head);
        let tail = if self.broken {
            // The chain is not known here: go on in a new sector.
            end
        } else if self.used > addr {
            layout
                .resume_behind_torn(self.used, self.announced)
                .min(end)
        } else {
            layout.resume(addr).min(end)
        };
        let mut extent = Extent {
            layout,
            oldest: head,
            first_seq: self.first_seq,
            head,
            tail,
            next_seq,
            takes_unproven: false,
        };
        let start = layout.next(head);
        let start = if next_given_up {
            layout.next(start)
        } else {
            start
        };
        let damaged_headers = set_oldest(flash, &mut extent, start, self.generation)?;
        let recovery = Recovery {
            first_seq: extent.first_seq,
            next_seq,
            fresh: false,
            torn_bytes: self.used.saturating_sub(addr),
            sector_unfinished,
            damaged_entries: self.damaged_entries,
            damaged_headers,
            chain_restarted: self.broken,
        };
        Ok(State {
            extent,
            generation: self.generation,
            chain: self.proven,
            next_given_up,
            recovery,
        })
    }
}

/// Sets the old end of the record: the first sector from `start` up to the head
/// whose header is good and of this lap. If there is none, `extent` stays.
/// Returns how many of these sectors were written and have no such header. Where the record
/// begins also with one of them, those before that sector belong to it: what they hold
/// can be read as far as their first entries tell, and is there in any case.
pub(super) fn set_oldest<F: Flash>(
    flash: &mut F,
    extent: &mut Extent,
    start: u32,
    generation: u64,
) -> Result<u32, F::Error> {
    let layout = extent.layout;
    let mut found = false;
    let mut damaged = 0;
    let (mut unproven, mut first_seq) = (None, None);
    let mut sector = start;
    for _ in 0..layout.sectors {
        let behind = u64::from((extent.head + layout.sectors - sector) % layout.sectors);
        match read_header(flash, &layout, sector)? {
            HeaderRead::Valid(header)
                if generation.checked_sub(behind) == Some(header.generation) =>
            {
                if !found {
                    extent.oldest = sector;
                    extent.first_seq = header.first_seq;
                }
                found = true;
            }
            _ => {
                let place = layout.start(sector);
                let is_damaged = !is_erased(flash, place, place + HEADER_SIZE as u32)?;
                damaged += u32::from(is_damaged);
                if extent.takes_unproven && is_damaged && !found {
                    unproven.get_or_insert(sector);
                    first_seq = first_seq.or(first_of(flash, &layout, sector)?);
                }
            }
        }
        if sector == extent.head {
            break;
        }
        sector = layout.next(sector);
    }
    if let Some(sector) = unproven.filter(|_| found) {
        extent.oldest = sector;
        let most = u64::from(layout.sectors * (layout.sector_size / OVERHEAD as u32));
        let is_before = |first: &u64| {
            extent
                .first_seq
                .checked_sub(*first)
                .is_some_and(|n| n <= most)
        };
        extent.first_seq = first_seq.filter(is_before).unwrap_or(extent.first_seq);
    }
    Ok(damaged)
}

/// The number of the entry with which a sector begins, by what it says of itself.
fn first_of<F: Flash>(
    flash: &mut F,
    layout: &Layout,
    sector: u32,
) -> Result<Option<u64>, F::Error> {
    let found = probe(flash, layout.data(sector), layout.end(sector))?;
    Ok(found.ok().map(|found| found.fields.seq))
}

/// True if the mark says that the sector behind this one was given up.
pub(super) fn is_given_up<F: Flash>(
    flash: &mut F,
    layout: &Layout,
    sector: u32,
) -> Result<bool, F::Error> {
    let at = layout.mark(sector);
    Ok(!is_erased(flash, at, at + layout.align)?)
}
