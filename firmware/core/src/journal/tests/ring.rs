//! The ring at work: laps, wear, reading, preparing, worn cells, refusals.

use std::string::ToString;

use super::super::mock::{MockError, Op};
use super::*;

#[test]
fn many_laps_keep_the_newest_entries_and_wear_is_even() {
    let mut journal = journal(GEOMETRY);
    for _ in 0..100 {
        fill(&mut journal, 10);
        check(&mut journal);
        // Three whole sectors at least, of nine entries at least.
        assert!(journal.next_seq() < 40 || journal.next_seq() - journal.first_seq() >= 27);
    }
    let erases = &journal.flash().erases;
    let (least, most) = (erases.iter().min().unwrap(), erases.iter().max().unwrap());
    assert!(most - least <= 1, "{erases:?}");
    assert!(*least > 10);
}

#[test]
fn numbers_go_on_over_power_cycles() {
    let mut journal = journal(GEOMETRY);
    for cycle in 0..200 {
        let (opened, recovery) = reopen(journal);
        journal = opened;
        assert_eq!(journal.next_seq(), 3 * cycle);
        assert!(recovery.is_clean() && !recovery.sector_unfinished);
        assert_eq!(recovery.fresh, cycle == 0);
        assert_eq!(recovery.next_seq, journal.next_seq());
        assert_eq!(recovery.first_seq, journal.first_seq());
        fill(&mut journal, 3);
        check(&mut journal);
    }
}

#[test]
fn after_a_power_cycle_the_page_in_use_is_left_alone() {
    let geometry = Geometry {
        page_size: 256,
        write_size: 1,
        ..GEOMETRY
    };
    let mut journal = journal(geometry);
    journal.append(1, Micros(0), &[0; 10]).unwrap();
    let (mut journal, _) = reopen(journal);
    journal.flash().take_ops();
    journal.append(1, Micros(0), &[0; 10]).unwrap();
    assert_eq!(
        journal.flash().take_ops(),
        [Op::Program { addr: 256, len: 44 }]
    );
}

#[test]
fn entries_are_read_in_any_order() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 100);
    let (first, next) = (journal.first_seq(), journal.next_seq());
    let mut buffer = [0; MAX_PAYLOAD];
    let mut random = Random(3);
    for _ in 0..500 {
        let seq = first + random.below(next - first);
        assert_content(&journal.read(seq, &mut buffer).unwrap(), seq);
    }
    for seq in (first..next).rev() {
        assert_content(&journal.read(seq, &mut buffer).unwrap(), seq);
    }
}

#[test]
fn reading_keeps_up_with_appending_round_the_ring() {
    let mut journal = journal(GEOMETRY);
    let mut buffer = [0; MAX_PAYLOAD];
    for seq in 0..300 {
        fill(&mut journal, 1);
        assert_content(&journal.read(seq, &mut buffer).unwrap(), seq);
        journal.prepare(200).unwrap();
    }
}

/// The figures that the application plans with, as counts of what happens.
#[test]
fn sequential_reading_costs_three_passes_over_each_entry() {
    let mut journal = journal(Geometry {
        sectors: 8,
        sector_size: 4096,
        ..GEOMETRY
    });
    for _ in 0..100 {
        journal.append(1, Micros(0), &[7; 64]).unwrap();
    }
    let mut buffer = [0; MAX_PAYLOAD];
    journal.read(0, &mut buffer).unwrap();
    let before = journal.flash().bytes_read;
    for seq in 1..100 {
        journal.read(seq, &mut buffer).unwrap();
    }
    let bytes = journal.flash().bytes_read - before;
    // Checked (96 bytes), chained (84), copied (64), and two headers at each of
    // the two changes of sector.
    assert_eq!(bytes, 99 * (96 + 84 + 64) + 2 * 2 * 64);
}

#[test]
fn an_entry_is_one_program_and_is_read_back() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 1);
    journal.flash().take_ops();
    let before = journal.flash().bytes_read;
    journal.append(1, Micros(0), &[7; 64]).unwrap();
    assert!(matches!(
        journal.flash().take_ops()[..],
        [Op::Program { len: 96, .. }]
    ));
    assert_eq!(journal.flash().bytes_read - before, 96);
}

#[test]
fn prepare_takes_the_erase_out_of_append() {
    let mut journal = journal(GEOMETRY);
    let mut prepared = false;
    for _ in 0..200 {
        let due = journal.free() < 200 && !prepared;
        assert_eq!(journal.prepare(200), Ok(due));
        assert_eq!(journal.prepare(200), Ok(false), "once is enough");
        prepared |= due;
        let head = journal.extent.head;
        journal.flash().take_ops();
        fill(&mut journal, 1);
        let ops = journal.flash().take_ops();
        assert!(!ops.iter().any(|op| matches!(op, Op::Erase { .. })));
        prepared &= journal.extent.head == head;
        check(&mut journal);
    }
}

#[test]
fn a_reader_behind_the_ring_is_told_both_ends() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 100);
    let (first, next) = (journal.first_seq(), journal.next_seq());
    assert!(first > 0);
    let mut buffer = [0; MAX_PAYLOAD];
    for seq in [0, first - 1, next, u64::MAX] {
        let expected = JournalError::OutOfRange { seq, first, next };
        assert_eq!(journal.read(seq, &mut buffer).unwrap_err(), expected);
    }
    assert!(
        journal
            .read(0, &mut buffer)
            .unwrap_err()
            .to_string()
            .contains("no longer")
    );
    assert!(
        journal
            .read(next, &mut buffer)
            .unwrap_err()
            .to_string()
            .contains("not exist yet")
    );
    assert_eq!(journal.chain_before(next), Ok(journal.chain_head()));
}

#[test]
fn a_buffer_that_is_too_small_is_refused_and_nothing_is_skipped() {
    let mut journal = journal(GEOMETRY);
    journal.append(1, Micros(0), &[5; 100]).unwrap();
    let error = journal.read(0, &mut [0; 99]).unwrap_err();
    assert_eq!(error, JournalError::BufferTooSmall { need: 100 });
    let error = journal.read_encoded(0, &mut [0; 131]).unwrap_err();
    assert_eq!(error, JournalError::BufferTooSmall { need: 132 });
    assert_eq!(
        journal.read(0, &mut [0; 100]).unwrap().entry.payload,
        [5; 100]
    );
}

#[test]
fn the_longest_payload_fits_and_a_longer_one_is_refused() {
    let long = [9; MAX_PAYLOAD + 1];
    let (longest, _) = long.split_at(MAX_PAYLOAD);
    let mut large = journal(Geometry {
        sector_size: 16 * 1024,
        ..GEOMETRY
    });
    assert_eq!(large.max_payload(), MAX_PAYLOAD);
    large.append(1, Micros(0), longest).unwrap();
    let refused = JournalError::PayloadTooLong {
        len: MAX_PAYLOAD + 1,
        max: MAX_PAYLOAD,
    };
    assert_eq!(large.append(1, Micros(0), &long).unwrap_err(), refused);
    assert_eq!(large.next_seq(), 1);
    assert_eq!(
        large.read(0, &mut [0; MAX_PAYLOAD]).unwrap().entry.payload,
        longest
    );
    // In a sector of 1024 bytes, its header and mark and the entry's own 32 are
    // taken off.
    let mut small = journal(GEOMETRY);
    assert_eq!(small.max_payload(), 1024 - 64 - 4 - 32);
    small.append(1, Micros(0), &[9; 924]).unwrap();
    assert_eq!(small.free(), 0);
    fill(&mut small, 1);
    assert_eq!(
        small.read(0, &mut [0; 924]).unwrap().entry.payload,
        [9; 924]
    );
    let refused = JournalError::PayloadTooLong { len: 925, max: 924 };
    assert_eq!(small.append(1, Micros(0), &[9; 925]).unwrap_err(), refused);
}

#[test]
fn a_worn_word_costs_the_rest_of_its_sector_and_no_entry() {
    let mut flash = MockFlash::new(GEOMETRY);
    flash.worn = std::vec![300, 2 * 1024 + 200];
    let (mut journal, _) = Journal::open(flash).unwrap();
    for _ in 0..20 {
        fill(&mut journal, 3);
        check(&mut journal);
        (journal, _) = reopen(journal);
        check(&mut journal);
    }
}

#[test]
fn a_flash_that_keeps_nothing_is_named() {
    let mut flash = MockFlash::new(GEOMETRY);
    flash.worn = (0..4096).step_by(4).collect();
    let (mut journal, _) = Journal::open(flash).unwrap();
    let error = journal.append(1, Micros(0), b"x").unwrap_err();
    assert_eq!(error, JournalError::NotKept { addr: 0 });
    assert!(error.to_string().contains("replace the board"));
}

/// The failed entry may be whole on the flash. It must not hide those after it.
#[test]
fn an_append_that_the_driver_reports_as_failed_leaves_no_doubt_behind() {
    let mut flash = MockFlash::new(GEOMETRY);
    flash.fail_next_program = false;
    let (mut journal, _) = Journal::open(flash).unwrap();
    fill(&mut journal, 3);
    let mut flash = journal.into_flash();
    flash.fail_next_program = true;
    let (mut journal, _) = Journal::open(flash).unwrap();
    let error = journal
        .append(1, Micros(0), b"not acknowledged")
        .unwrap_err();
    assert_eq!(error, JournalError::Flash(MockError::ProgramFailed));
    assert_eq!(journal.next_seq(), 3);
    fill(&mut journal, 3);
    check(&mut journal);
    let (mut journal, recovery) = reopen(journal);
    assert!(recovery.is_clean());
    assert_eq!(journal.next_seq(), 6);
    check(&mut journal);
}

#[test]
fn what_is_not_a_journal_is_left_alone_until_it_is_formatted() {
    let mut flash = MockFlash::new(GEOMETRY);
    flash.data[3000] = 0x12;
    let before = flash.data.clone();
    let error = Journal::open(&mut flash).unwrap_err();
    assert_eq!(error, JournalError::NotAJournal);
    assert!(error.to_string().contains("format"));
    assert_eq!(flash.data, before);
    Journal::format(&mut flash).unwrap();
    let (_, recovery) = Journal::open(flash).unwrap();
    assert!(recovery.fresh);
}

#[test]
fn a_journal_of_another_shape_or_version_is_named_and_left_alone() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 5);
    let data = journal.into_flash().data;

    let mut larger = MockFlash::new(Geometry {
        sectors: 8,
        ..GEOMETRY
    });
    larger.data[..data.len()].copy_from_slice(&data);
    let error = Journal::open(larger).unwrap_err();
    assert_eq!(
        error,
        JournalError::OtherGeometry {
            sectors: 4,
            sector_size: 1024,
            align: 4
        }
    );

    let mut newer = MockFlash::new(GEOMETRY);
    newer.data[..64].copy_from_slice(&data[..64]);
    newer.data[4] = 2;
    let crc = crate::journal::format::chain::CRC32.checksum(&newer.data[..60]);
    newer.data[60..64].copy_from_slice(&crc.to_le_bytes());
    assert_eq!(
        Journal::open(newer).unwrap_err(),
        JournalError::Version { found: 2 }
    );
}

#[test]
fn a_region_that_cannot_hold_a_journal_is_refused_with_the_reason() {
    let cases = [
        (
            Geometry {
                sectors: 1,
                ..GEOMETRY
            },
            GeometryFault::TooFewSectors,
        ),
        (
            Geometry {
                write_size: 3,
                ..GEOMETRY
            },
            GeometryFault::WriteSize,
        ),
        (
            Geometry {
                write_size: 0,
                ..GEOMETRY
            },
            GeometryFault::WriteSize,
        ),
        (
            Geometry {
                write_size: 512,
                page_size: 512,
                ..GEOMETRY
            },
            GeometryFault::WriteSize,
        ),
        (
            Geometry {
                write_size: 8,
                ..GEOMETRY
            },
            GeometryFault::PageSize,
        ),
        (
            Geometry {
                page_size: 2048,
                ..GEOMETRY
            },
            GeometryFault::SectorNotWholePages,
        ),
        (
            Geometry {
                sector_size: 128,
                ..GEOMETRY
            },
            GeometryFault::SectorTooSmall,
        ),
        (
            Geometry {
                sector_size: 0,
                ..GEOMETRY
            },
            GeometryFault::SectorTooSmall,
        ),
        (
            Geometry {
                sectors: u16::MAX,
                sector_size: 1 << 20,
                ..GEOMETRY
            },
            GeometryFault::TooLarge,
        ),
    ];
    for (geometry, fault) in cases {
        let error = Layout::new(geometry).unwrap_err();
        assert_eq!(error, fault);
        assert!(!error.to_string().is_empty());
    }
}

/// RAM is small and does not grow with the flash.
#[test]
fn the_journal_is_small() {
    let without_flash = size_of::<Journal<MockFlash>>() - size_of::<MockFlash>();
    assert!(without_flash <= 208, "{without_flash} bytes");
}
