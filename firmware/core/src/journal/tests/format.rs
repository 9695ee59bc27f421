//! The bytes that outlive a build. The expected ones were computed from the
//! drawings in `entry.rs`, `sector.rs` and `export.rs` with Python's struct,
//! hashlib and zlib. If one of these fails, journals in the field cannot be read:
//! count `VERSION` up instead of changing them.

use std::string::String;
use std::vec::Vec;

use super::*;

const ENTRY_0: &str = "a5070000000000000000000040420f0000000000f54529d420db3982084aa372";
const ENTRY_1: &str = "a5200900010000000000000087d6120000000000582d31322e33343530\
                       bfe44517995c5f7b1a54ea1d";
const CHAIN_0: &str = "f54529d420db398215f497575f4625b6376af99fac2fbc2cc6045424c31d30c9";
const CHAIN_1: &str = "bfe44517995c5f7b59f7213acf69cb3042ca9c86b0118a15fd635e7727fab3be";
const SECTOR_HEADER: &str = "554d4a530103040000040000010000000000000000000000000000000000000000\
                             000000000000000000000000000000000000000000000000000000e5d419d4";
const FILE_HEADER_1: &str = "554d494a010000000100000000000000\
                           f54529d420db398215f497575f4625b6376af99fac2fbc2cc6045424c31d30c9f5df8141";
const FILE_HEADER: &str = "554d494a020000000100000000000000\
                           f54529d420db398215f497575f4625b6376af99fac2fbc2cc6045424c31d30c9\
                           5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5a5af7941158";
const GAP: &str = "5a00000007000000000000000900000000000000\
                   f54529d420db398215f497575f4625b6376af99fac2fbc2cc6045424c31d30c95decb2eb";

fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .map(|byte| std::format!("{byte:02x}"))
        .collect()
}

/// Two entries, the first without a payload.
fn two() -> Journal<MockFlash> {
    let mut journal = journal(Geometry {
        write_size: 8,
        page_size: 8,
        ..GEOMETRY
    });
    journal.append(7, Micros(1_000_000), b"").unwrap();
    journal
        .append(0x20, Micros(1_234_567), b"X-12.3450")
        .unwrap();
    journal
}

#[test]
fn flash() {
    let journal = two();
    let cells = &journal.flash().data;
    assert_eq!(hex(&cells[..64]), SECTOR_HEADER);
    // The mark is not set yet.
    assert_eq!(hex(&cells[64..72]), "ff".repeat(8));
    assert_eq!(hex(&cells[72..104]), ENTRY_0);
    // Padded to eight bytes.
    assert_eq!(hex(&cells[104..152]), [ENTRY_1, &"ff".repeat(7)].concat());
    assert!(cells[152..].iter().all(|byte| *byte == ERASED));
    assert_eq!(std::format!("{}", journal.chain_head()), CHAIN_1);
}

#[test]
fn mark_before_the_next_sector_is_erased() {
    let mut journal = two();
    journal.prepare(u32::MAX).unwrap();
    assert_eq!(hex(&journal.flash().data[64..72]), "00".repeat(8));
}

#[test]
fn file() {
    let mut journal = two();
    let header = FileHeader {
        first_seq: 1,
        chain_before: journal.chain_before(1).unwrap(),
        nonce: Some([0x5A; 32]),
    };
    assert_eq!(hex(&header.chain_before.0), CHAIN_0);
    assert_eq!(hex(&header.encode()), FILE_HEADER);
    assert_eq!(
        FileHeader::decode(&header.encode()),
        Ok((header, FILE_HEADER_SIZE))
    );
    let first: Vec<u8> = (0..FILE_HEADER_1.len() / 2)
        .map(|n| u8::from_str_radix(&FILE_HEADER_1[2 * n..2 * n + 2], 16).unwrap())
        .collect();
    let header = FileHeader {
        nonce: None,
        ..header
    };
    assert_eq!(FileHeader::decode(&first), Ok((header, FILE_HEADER_SIZE_1)));
    let gap = Gap {
        first: 7,
        next: 9,
        chain_before: header.chain_before,
    };
    assert_eq!(hex(&gap.encode()), GAP);
    let mut buffer = [0; 64];
    assert_eq!(hex(journal.read_encoded(0, &mut buffer).unwrap()), ENTRY_0);
    assert_eq!(hex(journal.read_encoded(1, &mut buffer).unwrap()), ENTRY_1);
}
