//! The journal on a flash that works, wears out, is damaged and is tampered with.
//! Power cuts have a file of their own: `tests/tests/journal_power_cut.rs`.

use std::string::ToString;
use std::vec::Vec;

use super::mock::{MockError, MockFlash, Op, Random};
use super::*;

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

fn reopen(journal: Journal<MockFlash>) -> (Journal<MockFlash>, Recovery) {
    Journal::open(journal.into_flash()).unwrap()
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

/// Every entry there is reads back as `content` says, and the chain holds.
fn check(journal: &mut Journal<MockFlash>) {
    let mut buffer = [0; MAX_PAYLOAD];
    for seq in journal.first_seq()..journal.next_seq() {
        let read = journal.read(seq, &mut buffer).unwrap();
        let (kind, t, payload) = content(seq);
        assert_eq!(
            read,
            ReadEntry {
                entry: Entry {
                    seq,
                    t,
                    kind,
                    payload: &payload
                },
                chained: true
            }
        );
    }
    let verified = journal
        .verify(journal.first_seq(), journal.next_seq())
        .unwrap();
    assert_eq!(verified.chain, journal.chain_head());
}

#[test]
fn many_laps_keep_the_newest_entries_and_wear_is_even() {
    let mut journal = journal(GEOMETRY);
    for _ in 0..100 {
        fill(&mut journal, 10);
        check(&mut journal);
    }
    let erases = &journal.flash().erases;
    let (least, most) = (erases.iter().min().unwrap(), erases.iter().max().unwrap());
    assert!(most - least <= 1, "{erases:?}");
    assert!(*least > 10);
}
