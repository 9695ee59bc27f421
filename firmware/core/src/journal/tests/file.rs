//! The journal as a file: `umi log` writes it, `umi replay` reads it.

use std::string::ToString;

use super::*;

/// Pulls entries `first..` as `umi log` does.
fn pull(journal: &mut Journal<MockFlash>, first_seq: u64) -> Vec<u8> {
    let header = FileHeader {
        first_seq,
        chain_before: journal.chain_before(first_seq).unwrap(),
        nonce: None,
    };
    let mut file = header.encode().to_vec();
    let mut buffer = [0; MAX_PAYLOAD + OVERHEAD];
    for seq in first_seq..journal.next_seq() {
        file.extend_from_slice(journal.read_encoded(seq, &mut buffer).unwrap());
    }
    file
}

/// A file of entries 20..50 as `content` has them, and where each starts.
fn sample() -> (Vec<u8>, Vec<usize>) {
    let mut chain = Chain::GENESIS;
    let mut file = Vec::new();
    let mut starts = Vec::new();
    let mut buffer = [0; MAX_PAYLOAD + OVERHEAD];
    for seq in 0..50 {
        if seq == 20 {
            file = FileHeader {
                first_seq: 20,
                chain_before: chain,
                nonce: None,
            }
            .encode()
            .to_vec();
        }
        let (kind, t, payload) = content(seq);
        let payload = &payload;
        let len = encode_entry(
            &Entry {
                seq,
                t,
                kind,
                payload,
            },
            &mut chain,
            &mut buffer,
        )
        .unwrap();
        if seq >= 20 {
            starts.push(file.len());
            file.extend_from_slice(&buffer[..len]);
        }
    }
    (file, starts)
}

/// Reads all entries; returns how many were good, and what stopped it.
fn read(file: &[u8]) -> (u64, Option<JournalFault>) {
    let (header, mut entries) = decode_file(file).unwrap();
    let fault = entries.by_ref().find_map(Result::err);
    assert!(entries.next().is_none(), "nothing behind a fault");
    (entries.next_seq() - header.first_seq, fault)
}

/// Makes the CRC of the entry in `bytes` right again, as a careful forger would.
fn fix_crc(bytes: &mut [u8]) {
    let (content, crc) = bytes.split_last_chunk_mut::<4>().unwrap();
    *crc = crate::journal::format::chain::CRC32
        .checksum(content)
        .to_le_bytes();
}

#[test]
fn a_pulled_journal_reads_back_and_proves_itself() {
    let mut journal = journal(GEOMETRY);
    fill(&mut journal, 100);
    for first in journal.first_seq()..=journal.next_seq() {
        let file = pull(&mut journal, first);
        let (header, mut entries) = decode_file(&file).unwrap();
        assert_eq!(header.first_seq, first);
        for (seq, entry) in (first..).zip(entries.by_ref()) {
            let (kind, t, payload) = content(seq);
            let payload = &payload;
            assert_eq!(
                entry,
                Ok(Entry {
                    seq,
                    t,
                    kind,
                    payload
                })
            );
        }
        assert_eq!(entries.next_seq(), 100);
        assert_eq!(entries.chain_head(), journal.chain_head());
        assert_eq!(entries.offset(), file.len() - FILE_HEADER_SIZE);
    }
}

#[test]
fn host_and_board_encode_the_same_bytes() {
    let mut journal = journal(Geometry {
        sectors: 16,
        ..GEOMETRY
    });
    fill(&mut journal, 50);
    assert_eq!(pull(&mut journal, 20), sample().0);
}

#[test]
fn any_changed_byte_is_found_at_its_entry() {
    let (file, starts) = sample();
    for at in FILE_HEADER_SIZE..file.len() {
        for bits in [0x01, 0x80, 0xFF] {
            let mut file = file.clone();
            file[at] ^= bits;
            let good = starts.iter().filter(|start| **start <= at).count() as u64 - 1;
            let (read, fault) = read(&file);
            assert_eq!(
                (read, fault.map(|fault| fault.seq())),
                (good, Some(20 + good)),
                "{at}"
            );
        }
    }
}

#[test]
fn any_changed_byte_of_the_header_is_found() {
    let (file, _) = sample();
    for at in 0..FILE_HEADER_SIZE {
        let mut file = file.clone();
        file[at] ^= 0x04;
        let expected = if at < 4 {
            FileError::NotAJournal
        } else {
            FileError::HeaderDamaged
        };
        assert_eq!(decode_file(&file).unwrap_err(), expected);
        assert!(!expected.to_string().is_empty());
    }
    let mut newer = file.clone();
    newer[4] = 3;
    fix_crc(&mut newer[..FILE_HEADER_SIZE]);
    assert_eq!(
        decode_file(&newer).unwrap_err(),
        FileError::Version { found: 3 }
    );
    assert_eq!(
        decode_file(&file[..83]).unwrap_err(),
        FileError::HeaderDamaged
    );
    for length in 0..4 {
        assert_eq!(
            decode_file(&file[..length]).unwrap_err(),
            FileError::HeaderDamaged
        );
    }
    assert_eq!(decode_file(b"UX").unwrap_err(), FileError::NotAJournal);
}

/// A forger who makes every CRC right is found by the chain.
#[test]
fn an_edited_entry_breaks_the_chain() {
    let (mut file, starts) = sample();
    file[starts[5] + 21] ^= 1;
    fix_crc(&mut file[starts[5]..starts[6]]);
    assert_eq!(
        read(&file),
        (5, Some(JournalFault::ChainBroken { seq: 25 }))
    );
}

#[test]
fn a_deleted_entry_is_missing_and_a_renumbered_one_breaks_the_chain() {
    let (file, starts) = sample();
    let mut deleted = [&file[..starts[5]], &file[starts[6]..]].concat();
    assert_eq!(
        read(&deleted),
        (
            5,
            Some(JournalFault::Missing {
                first: 25,
                next: 26
            })
        )
    );
    let end = starts[5] + starts[7] - starts[6];
    deleted[starts[5] + 4] = 25;
    fix_crc(&mut deleted[starts[5]..end]);
    assert_eq!(
        read(&deleted),
        (5, Some(JournalFault::ChainBroken { seq: 25 }))
    );
}

#[test]
fn exchanged_and_repeated_entries_are_found() {
    let (file, starts) = sample();
    let entry = |k: usize| &file[starts[k]..starts[k + 1]];
    let swapped = [&file[..starts[5]], entry(6), entry(5), &file[starts[7]..]].concat();
    assert_eq!(
        read(&swapped),
        (
            5,
            Some(JournalFault::Missing {
                first: 25,
                next: 26
            })
        )
    );
    let repeated = [&file[..starts[6]], entry(5), &file[starts[6]..]].concat();
    assert_eq!(
        read(&repeated),
        (6, Some(JournalFault::ChainBroken { seq: 26 }))
    );
}

/// Who forges everything behind an edit too cannot give the noted chain value.
#[test]
fn a_forged_file_ends_in_another_chain_value() {
    let (file, _) = sample();
    let (header, mut entries) = decode_file(&file).unwrap();
    let entries_good: Vec<_> = entries.by_ref().map(Result::unwrap).collect();
    let mut chain = header.chain_before;
    let mut forged = header.encode().to_vec();
    let mut buffer = [0; MAX_PAYLOAD + OVERHEAD];
    for mut entry in entries_good {
        entry.t.0 += u64::from(entry.seq == 25);
        let len = encode_entry(&entry, &mut chain, &mut buffer).unwrap();
        forged.extend_from_slice(&buffer[..len]);
    }
    assert_eq!(read(&forged), (30, None));
    let (_, mut forged) = decode_file(&forged).unwrap();
    forged.by_ref().for_each(drop);
    assert_ne!(forged.chain_head(), entries.chain_head());
}

#[test]
fn a_file_cut_anywhere_ends_at_its_last_whole_entry() {
    let (file, starts) = sample();
    for end in FILE_HEADER_SIZE..file.len() {
        let whole = starts.iter().filter(|start| **start <= end).count() as u64 - 1;
        let (read, fault) = read(&file[..end]);
        assert_eq!(read, whole);
        let cut = JournalFault::CutShort { seq: 20 + whole };
        assert_eq!(fault, (!starts.contains(&end)).then_some(cut));
    }
}

#[test]
fn encoding_refuses_what_does_not_fit() {
    let mut chain = Chain::GENESIS;
    let entry = |payload| Entry {
        seq: 0,
        t: Micros(0),
        kind: 0,
        payload,
    };
    assert_eq!(
        encode_entry(&entry(&[0; 10]), &mut chain, &mut [0; 41]),
        None
    );
    assert_eq!(
        encode_entry(
            &entry(&[0; MAX_PAYLOAD + 1]),
            &mut chain,
            &mut [0; MAX_PAYLOAD + 100]
        ),
        None
    );
    assert_eq!(chain, Chain::GENESIS);
    assert_eq!(
        encode_entry(&entry(&[0; 10]), &mut chain, &mut [0; 42]),
        Some(42)
    );
}

/// A file of version 1: as `sample`, with the header that it had then.
#[test]
fn version_1_is_read_for_ever() {
    let (file, _) = sample();
    let mut old = b"UMIJ\x01\0\0\0".to_vec();
    old.extend_from_slice(&file[8..48]);
    old.extend_from_slice(&[0; 4]);
    fix_crc(&mut old);
    assert_eq!(old.len(), FILE_HEADER_SIZE_1);
    old.extend_from_slice(&file[FILE_HEADER_SIZE..]);
    assert_eq!(read(&old), (30, None));
    // A gap is no part of it.
    let gap = Gap {
        first: 50,
        next: 60,
        chain_before: Chain::GENESIS,
    };
    old.extend_from_slice(&gap.encode());
    assert_eq!(read(&old).1, Some(JournalFault::Damaged { seq: 50 }));
}

/// Entries that were overwritten are named, and what is behind them is read; a gap that does not
/// begin where it stands, or whose bytes were changed, is none.
#[test]
fn a_gap_is_passed_and_named() {
    let (file, starts) = sample();
    let (_, mut entries) = decode_file(&file).unwrap();
    let mut chain = Chain::GENESIS;
    while entries.next_seq() < 28 {
        entries.next().unwrap().unwrap();
        chain = entries.chain_head();
    }
    let gap = Gap {
        first: 25,
        next: 28,
        chain_before: chain,
    };
    let with = |gap: &[u8]| [&file[..starts[5]], gap, &file[starts[8]..]].concat();
    let whole = with(&gap.encode());
    let (_, mut entries) = decode_file(&whole).unwrap();
    let mut gaps = Vec::new();
    let mut seqs = Vec::new();
    while let Some(entry) = entries.next() {
        seqs.push(entry.unwrap().seq);
        gaps.extend(entries.take_gap());
    }
    assert_eq!(gaps, [gap]);
    assert_eq!(seqs, (20..25).chain(28..50).collect::<Vec<_>>());
    for at in 0..GAP_SIZE {
        let mut bytes = gap.encode();
        bytes[at] ^= 0x10;
        assert_eq!(
            read(&with(&bytes)).1.map(|fault| fault.seq()),
            Some(25),
            "{at}"
        );
    }
    for wrong in [Gap { first: 24, ..gap }, Gap { next: 25, ..gap }] {
        let found = read(&with(&wrong.encode())).1;
        assert_eq!(found, Some(JournalFault::Damaged { seq: 25 }));
    }
    // At the end of a file it says how far the board was.
    let end = [&file[..starts[5]], &gap.encode()[..]].concat();
    let (_, mut entries) = decode_file(&end).unwrap();
    assert_eq!(entries.by_ref().count(), 5);
    assert_eq!((entries.take_gap(), entries.next_seq()), (Some(gap), 28));
    let cut = JournalFault::CutShort { seq: 25 };
    assert_eq!(read(&end[..end.len() - 1]).1, Some(cut));
}
