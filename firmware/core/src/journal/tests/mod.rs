//! The journal on a flash that works, wears out, is damaged and is tampered with.
//! Power cuts have a file of their own: `tests/tests/keep/journal_power_cut`.

mod damage;
mod file;
mod format;
mod random;
mod ring;

use std::vec::Vec;

use super::mock::{MockFlash, Random};
use super::*;

/// A small ring: about ten entries of `content` in each sector.
const GEOMETRY: Geometry = Geometry {
    sectors: 4,
    sector_size: 1024,
    write_size: 4,
    page_size: 4,
};

fn journal(geometry: Geometry) -> Journal<MockFlash> {
    let (journal, recovery) = Journal::open(MockFlash::new(geometry)).unwrap();
    assert!(recovery.fresh && recovery.is_clean());
    journal
}

/// What happens at a power cycle while nothing was going on.
fn reopen(journal: Journal<MockFlash>) -> (Journal<MockFlash>, Recovery) {
    Journal::open(journal.into_flash()).unwrap()
}

/// Changes the cells and opens what that leaves.
fn tamper(
    journal: Journal<MockFlash>,
    change: impl FnOnce(&mut [u8]),
) -> (Journal<MockFlash>, Recovery) {
    let mut flash = journal.into_flash();
    change(&mut flash.data);
    Journal::open(flash).unwrap()
}

/// An entry's content as a function of its number.
fn content(seq: u64) -> (u8, Micros, Vec<u8>) {
    let mut random = Random(seq);
    let len = random.below(90) as usize;
    let payload = (0..len).map(|_| random.byte()).collect();
    (random.byte(), Micros(random.bits()), payload)
}

fn fill(journal: &mut Journal<MockFlash>, entries: u64) {
    for _ in 0..entries {
        let seq = journal.next_seq();
        let (kind, t, payload) = content(seq);
        assert_eq!(journal.append(kind, t, &payload), Ok(seq));
    }
}

/// Asserts that `read` is entry `seq` as `content` has it.
fn assert_content(read: &ReadEntry<'_>, seq: u64) {
    let (kind, t, payload) = content(seq);
    let payload = &payload;
    assert_eq!(
        read.entry,
        Entry {
            seq,
            t,
            kind,
            payload
        }
    );
}

/// Every entry there is reads back as `content` says, and the chain holds.
fn check(journal: &mut Journal<MockFlash>) {
    let mut buffer = [0; MAX_PAYLOAD];
    let (first, next) = (journal.first_seq(), journal.next_seq());
    for seq in first..next {
        let read = journal.read(seq, &mut buffer).unwrap();
        assert_content(&read, seq);
        assert!(read.chained);
    }
    let verified = journal.verify(first, next).unwrap();
    assert_eq!(verified.chain, journal.chain_head());
}

/// Address of the encoded entry in the flash's cells.
fn address_of(journal: &mut Journal<MockFlash>, seq: u64) -> usize {
    let mut buffer = [0; MAX_PAYLOAD + OVERHEAD];
    let encoded = journal.read_encoded(seq, &mut buffer).unwrap();
    let cells = &journal.flash().data;
    cells
        .windows(encoded.len())
        .position(|cells| cells == encoded)
        .unwrap()
}
