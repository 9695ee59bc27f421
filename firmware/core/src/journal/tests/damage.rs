//! Damage and tampering on the flash: nothing false is read, nothing is lost
//! without being named, and no number is used twice.

use super::super::format::sector::HeaderRead;
use super::*;

/// Three and a half laps of a small ring.
fn old_journal() -> Journal<MockFlash> {
    let geometry = Geometry {
        sectors: 4,
        sector_size: 512,
        ..GEOMETRY
    };
    let mut journal = journal(geometry);
    fill(&mut journal, 63);
    journal
}

/// Reads everything there is: entries are right or refused. Returns those
/// refused and those that could be read and not proven.
fn survey(journal: &mut Journal<MockFlash>) -> (Vec<u64>, Vec<u64>) {
    let mut buffer = [0; MAX_PAYLOAD];
    let (mut refused, mut unproven) = (Vec::new(), Vec::new());
    for seq in journal.first_seq()..journal.next_seq() {
        match journal.read(seq, &mut buffer) {
            Ok(read) => {
                assert_content(&read, seq);
                if !read.chained {
                    unproven.push(seq);
                }
            }
            Err(JournalError::Record(_)) => refused.push(seq),
            Err(error) => panic!("{error}"),
        }
    }
    (refused, unproven)
}

/// Every byte of the whole flash, one at a time.
#[test]
fn any_one_damaged_byte_costs_what_it_held_and_no_more() {
    let whole = old_journal();
    let (first, next) = (whole.first_seq(), whole.next_seq());
    let mut refused_at_all = 0;
    for at in 0..whole.flash().data.len() {
        for bits in [0x01, 0x5A, 0xFF] {
            let (mut journal, recovery) = tamper(whole.clone(), |cells| cells[at] ^= bits);
            // The newest entry cannot be told from a torn one. That, and the
            // header of the oldest sector, change where the record ends.
            let lost_newest = journal.next_seq() == next - 1;
            assert!(lost_newest || journal.next_seq() == next, "{at}");
            assert!(!lost_newest || recovery.torn_bytes > 0, "{at}");
            let lost_oldest = journal.first_seq() > first;
            assert!(!lost_oldest || recovery.damaged_headers == 1 || recovery.sector_unfinished);
            let (refused, unproven) = survey(&mut journal);
            assert!(refused.len() <= 1, "{at}: {refused:?}");
            refused_at_all += refused.len();
            let verified = journal.verify(journal.first_seq(), journal.next_seq());
            assert_eq!(verified.is_ok(), refused.is_empty() && unproven.is_empty());
            if let (Err(JournalError::Record(fault)), [seq, ..]) = (verified, &refused[..]) {
                assert_eq!(fault, JournalFault::Damaged { seq: *seq });
            }
            // It goes on, and what comes after is proven.
            let end = journal.next_seq();
            fill(&mut journal, 5);
            let (mut journal, _) = reopen(journal);
            assert_eq!(journal.next_seq(), end + 5);
            journal
                .verify(end.max(journal.first_seq()), end + 5)
                .unwrap();
        }
    }
    assert!(refused_at_all > 1000);
}

#[test]
fn a_damaged_entry_in_the_newest_sector_does_not_make_numbers_come_back() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 8);
    let at = address_of(&mut journal, 4);
    // Its length is damaged too, so that its end is not known.
    let (mut journal, recovery) = tamper(journal, |cells| cells[at + 1..at + 12].fill(0));
    assert_eq!(
        (recovery.damaged_entries, recovery.chain_restarted),
        (1, true)
    );
    assert_eq!(journal.next_seq(), 8);
    assert_eq!(survey(&mut journal), (std::vec![4], std::vec![5, 6, 7]));
    assert_eq!(
        journal.verify(0, 8),
        Err(JournalError::Record(JournalFault::Damaged { seq: 4 }))
    );
    journal.verify(0, 4).unwrap();
    fill(&mut journal, 4);
    assert_eq!(survey(&mut journal), (std::vec![4], std::vec![5, 6, 7]));
    journal.verify(8, 12).unwrap();
}

/// An entry that was reported as failed stands whole at the end of its sector,
/// and the one before it is damaged: the search must not take the former.
#[test]
fn what_was_not_acknowledged_does_not_stand_in_for_what_is_damaged() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 3);
    journal.flash.fail_next_program = true;
    journal
        .append(1, Micros(0), b"not acknowledged")
        .unwrap_err();
    fill(&mut journal, 3);
    let at = address_of(&mut journal, 2);
    let (mut journal, _) = tamper(journal, |cells| cells[at + 20] ^= 1);
    assert_eq!(survey(&mut journal), (std::vec![2], std::vec![]));
    assert_eq!(
        journal.verify(0, 6),
        Err(JournalError::Record(JournalFault::Damaged { seq: 2 }))
    );
}

/// Bytes in a torn entry that look like the next entries are read as unproven.
#[test]
fn an_image_of_an_entry_in_a_torn_one_is_never_proven() {
    for ahead in [0, 1] {
        let mut journal = journal(GEOMETRY);
        fill(&mut journal, 3);
        let tail = journal.extent.tail as usize;
        let mut image = [0; 64];
        let entry = Entry {
            seq: 3 + ahead,
            t: Micros(0),
            kind: 0,
            payload: b"forged",
        };
        let mut chain = Chain::GENESIS;
        encode_entry(&entry, &mut chain, &mut image).unwrap();
        journal
            .append(1, Micros(0), &[[0; 64], image].concat())
            .unwrap();
        let (mut journal, recovery) = tamper(journal, |cells| {
            cells[tail + 20 + 128..].fill(ERASED);
        });
        assert!(recovery.chain_restarted && !recovery.is_clean());
        let next = journal.next_seq();
        assert_eq!(next, 4 + ahead);
        assert!(!journal.read(next - 1, &mut [0; 64]).unwrap().chained);
        let Err(JournalError::Record(fault)) = journal.verify(0, next) else {
            panic!("verified")
        };
        assert_eq!(fault.seq(), 3);
        journal.append(1, Micros(0), b"goes on").unwrap();
        journal.verify(next, next + 1).unwrap();
    }
}

#[test]
fn two_damaged_entries_are_missing_together() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 8);
    let at = [3, 4].map(|seq| address_of(&mut journal, seq));
    let (mut journal, recovery) = tamper(journal, |cells| {
        at.into_iter().for_each(|at| cells[at + 30] ^= 4)
    });
    assert_eq!(recovery.damaged_entries, 2);
    let fault = JournalFault::Missing { first: 3, next: 5 };
    assert_eq!(journal.verify(0, 8), Err(JournalError::Record(fault)));
    assert_eq!(survey(&mut journal).0, [3, 4]);
}

#[test]
fn the_newest_sector_without_its_header_is_still_the_newest() {
    for (prepared, entries) in [(false, 40), (true, 40), (false, 25)] {
        let mut journal = journal(GEOMETRY);
        fill(&mut journal, entries);
        if prepared {
            journal.prepare(u32::MAX).unwrap();
        }
        let start = journal.extent.layout.start(journal.extent.head) as usize;
        let first = journal.first_seq();
        let (mut journal, recovery) = tamper(journal, |cells| cells[start + 9] ^= 1);
        assert_eq!((journal.first_seq(), journal.next_seq()), (first, entries));
        assert!(recovery.chain_restarted && !recovery.is_clean());
        let (refused, unproven) = survey(&mut journal);
        assert!(refused.is_empty());
        assert!(!unproven.is_empty());
        let fault = JournalFault::ChainBroken { seq: unproven[0] };
        assert_eq!(
            journal.verify(first, entries),
            Err(JournalError::Record(fault))
        );
        fill(&mut journal, 20);
        let (mut journal, _) = reopen(journal);
        assert_eq!(journal.next_seq(), entries + 20);
        journal.verify(entries, entries + 20).unwrap();
    }
}

#[test]
fn without_any_header_it_refuses_and_leaves_all_as_it_is() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 100);
    let mut flash = journal.into_flash();
    for sector in flash.data.chunks_mut(1024) {
        if sector[0] != ERASED {
            sector[20] ^= 1;
        }
    }
    assert_eq!(Journal::open(flash).unwrap_err(), JournalError::NotAJournal);
}

/// A forger with access to the flash who makes the CRC right.
#[test]
fn an_edited_entry_is_named_by_verify_and_marked_when_read() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 30);
    let seq = 5;
    let at = address_of(&mut journal, seq);
    let len = content(seq).2.len() + OVERHEAD;
    let (mut journal, _) = tamper(journal, |cells| {
        cells[at + 1] ^= 1;
        let crc = crate::journal::format::chain::CRC32.checksum(&cells[at..at + len - 4]);
        cells[at + len - 4..at + len].copy_from_slice(&crc.to_le_bytes());
    });
    let fault = JournalFault::ChainBroken { seq };
    assert_eq!(journal.verify(0, 30), Err(JournalError::Record(fault)));
    assert!(!journal.read(seq, &mut [0; MAX_PAYLOAD]).unwrap().chained);
    assert!(
        journal
            .read(seq - 1, &mut [0; MAX_PAYLOAD])
            .unwrap()
            .chained
    );
    assert_eq!(
        journal.chain_before(seq),
        journal.verify(0, seq).map(|verified| verified.chain)
    );
    assert_eq!(
        journal.chain_before(seq + 1),
        Err(JournalError::Record(JournalFault::ChainBroken {
            seq: seq + 1
        }))
    );
}

/// A forger who rewrites a whole sector, chain and all, is found at the next.
#[test]
fn a_forged_sector_does_not_lead_to_the_next_one() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 30);
    let second = journal.extent.layout.start(1) as usize;
    let HeaderRead::Valid(next) =
        walk::read_header(&mut journal.flash, &journal.extent.layout, 1).unwrap()
    else {
        panic!("no header")
    };
    let mut forger = super::journal(GEOMETRY);
    for seq in 0..next.first_seq {
        let (kind, t, payload) = content(seq);
        forger
            .append(kind, Micros(t.0 ^ u64::from(seq == 2)), &payload)
            .unwrap();
    }
    let forged = forger.into_flash().data;
    let (mut journal, _) = tamper(journal, |cells| {
        cells[68..second].copy_from_slice(&forged[68..second])
    });
    let fault = JournalFault::ChainBroken {
        seq: next.first_seq,
    };
    assert_eq!(journal.verify(0, 30), Err(JournalError::Record(fault)));
}

#[test]
fn verify_goes_on_in_stretches() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 100);
    let (first, next) = (journal.first_seq(), journal.next_seq());
    let whole = journal.verify(first, next).unwrap();
    let mut chain = whole.chain_before;
    for from in (first..next).step_by(7) {
        let to = (from + 7).min(next);
        let part = journal.verify(from, to).unwrap();
        assert_eq!(part.chain_before, chain);
        assert_eq!((part.first, part.next), (from, to));
        chain = part.chain;
    }
    assert_eq!(chain, whole.chain);
    assert!(matches!(
        journal.verify(first, next + 1),
        Err(JournalError::OutOfRange { .. })
    ));
    assert!(matches!(
        journal.verify(next, first),
        Err(JournalError::OutOfRange { .. })
    ));
}

/// A young journal whose only header is damaged is still its record, proven from its first entry on: it
/// says so, goes on, and is the same after the next start. Without its first entry it is none.
#[test]
fn the_only_header_is_not_needed() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 5);
    let chain = journal.chain_head();
    let whole = journal.into_flash();
    let mut bytes = [0; MAX_PAYLOAD];
    for bit in 0..8 * 64 {
        let mut flash = whole.clone();
        flash.data[bit / 8] ^= 1 << (bit % 8);
        let (mut journal, found) = Journal::open(flash).unwrap();
        assert_eq!((found.damaged_headers, found.is_clean()), (1, false));
        assert_eq!((journal.first_seq(), journal.next_seq()), (0, 5));
        assert_eq!(journal.chain_head(), chain, "bit {bit}");
        assert!(!found.fresh && !found.chain_restarted);
        journal.verify(0, 5).unwrap();
        assert_eq!(journal.append(7, Micros(9), b"goes on").unwrap(), 5);
        let (mut journal, _) = Journal::open(journal.into_flash()).unwrap();
        journal.verify(0, 6).unwrap();
        assert_eq!(
            journal.read(5, &mut bytes).unwrap().entry.payload,
            b"goes on"
        );
    }
    let mut flash = whole;
    flash.data[..80].fill(0);
    assert_eq!(Journal::open(flash).unwrap_err(), JournalError::NotAJournal);
}
