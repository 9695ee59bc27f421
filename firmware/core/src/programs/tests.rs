//! The store on a flash that works, and on one whose power is cut everywhere.

mod cuts;
mod punched;

use std::vec::Vec;

use umi_protocol::job::Name;
use umi_protocol::program::{IntegerRule, Release, RewriteSpec, Stated, StatedDialect, UnitRule};

use super::*;
use crate::journal::Geometry;
use crate::journal::mock::{MockError, MockFlash, Random};

/// Serial NOR with small sectors.
const GEOMETRY: Geometry = Geometry {
    sectors: 12,
    sector_size: 1024,
    write_size: 1,
    page_size: 256,
};

/// What is kept of the first sector.
const HEAD: u32 = 256;

fn store() -> Store<MockFlash> {
    Store::open(MockFlash::new(GEOMETRY)).unwrap()
}

/// Part program text of so many bytes.
fn text(seed: u64, bytes: usize) -> Vec<u8> {
    let mut random = Random(seed);
    (0..bytes)
        .map(|_| b"G01XYZ.-0123456789\n"[random.below(19) as usize])
        .collect()
}

fn info(number: u32, text: &[u8]) -> ProgramInfo {
    ProgramInfo {
        number,
        name: Name::try_from("PART").unwrap(),
        bytes: text.len() as u32,
        crc32: CRC32.checksum(text),
        release: Release::Rewritten(RewriteSpec {
            decimals_mm: 4,
            chord_um: 0x1234,
            clearance_um: 0x5678,
            integers: IntegerRule::Increments,
            unit: UnitRule::Inch,
        }),
        hold_s: 600,
        stated: Stated {
            start_packed: 45_359,
            dialect: StatedDialect::LinuxCnc,
            allow_call: 0xFEDC,
        },
    }
}

/// Uploads a program in pieces that fit nothing; from where it went on.
fn put<F: Flash>(
    store: &mut Store<F>,
    number: u32,
    text: &[u8],
) -> Result<u32, StoreError<F::Error>> {
    let info = info(number, text);
    let begun = store.begin(&info)?;
    let mut offset = begun;
    while offset < info.bytes {
        let piece = &text[offset as usize..];
        let piece = &piece[..piece.len().min(173)];
        offset = store.piece(offset, piece)?;
    }
    store.end(number, info.crc32)?;
    Ok(begun)
}

/// A whole program, read in pieces that fit nothing.
fn get<F: Flash>(store: &mut Store<F>, number: u32) -> Option<Vec<u8>> {
    let program = store.find(number)?;
    let mut text = Vec::new();
    let mut buffer = [0; 97];
    loop {
        let read = store.read(&program, text.len() as u32, &mut buffer);
        let read = read.ok().unwrap();
        if read.is_empty() {
            break;
        }
        text.extend_from_slice(read);
    }
    assert_eq!(CRC32.checksum(&text), program.crc32);
    let named = store.info(&program).ok().unwrap();
    let put = info(number, &text);
    let punched = ProgramInfo {
        release: Release::Never,
        hold_s: 5,
        stated: Stated::default(),
        ..put.clone()
    };
    assert!(named == put || named == punched, "{named:?}");
    Some(text)
}

fn refusal<T: core::fmt::Debug>(result: Result<T, StoreError<MockError>>) -> ProgramRefusal {
    match result {
        Err(StoreError::Refused(refusal)) => refusal,
        other => panic!("{other:?}"),
    }
}

/// A number that is none of packed modes.
#[test]
fn modes_that_are_none_are_refused() {
    let mut store = store();
    for start_packed in [45_360, u16::MAX] {
        let mut info = info(7, b"%");
        info.stated.start_packed = start_packed;
        assert_eq!(refusal(store.begin(&info)), ProgramRefusal::BadStart);
    }
    assert!(store.programs().is_empty());
}

#[test]
fn programs_are_there_after_a_restart_whatever_their_length() {
    let mut store = store();
    let lengths = [1, 767, 768, 769, 1791, 1792, 1793];
    for (number, length) in (1..).zip(lengths) {
        let text = text(number, length);
        assert_eq!(put(&mut store, number as u32, &text).unwrap(), 0);
    }
    for _ in 0..2 {
        for (number, length) in (1..).zip(lengths) {
            assert_eq!(get(&mut store, number as u32), Some(text(number, length)));
        }
        store = Store::open(store.into_flash()).unwrap();
    }
}

#[test]
fn a_program_is_replaced_and_its_room_is_free_again() {
    let mut store = store();
    for round in 0..20 {
        let text = text(round, 2000 + round as usize);
        put(&mut store, 7, &text).unwrap();
        assert_eq!(get(&mut store, 7), Some(text));
        let room = store.room();
        assert_eq!((room.programs, room.free_bytes), (1, 9 * 1024));
    }
    store.delete(7).unwrap();
    assert_eq!(get(&mut store, 7), None);
    assert_eq!(store.room().longest_bytes, 12 * 1024 - HEAD);
    assert_eq!(refusal(store.delete(7)), ProgramRefusal::NotThere);
    // Also after a restart.
    let store = Store::open(store.into_flash()).unwrap();
    assert_eq!(store.programs(), []);
}

/// A program that was replaced or deleted is not read on, whatever lies in its place.
#[test]
fn who_reads_an_old_program_is_told() {
    let mut store = store();
    put(&mut store, 7, &text(1, 500)).unwrap();
    let old = store.find(7).unwrap();
    put(&mut store, 7, &text(2, 500)).unwrap();
    let read = store.read(&old, 100, &mut [0; 8]).map(<[u8]>::len);
    assert_eq!(refusal(read), ProgramRefusal::NotThere);
}

#[test]
fn a_store_without_room_says_how_much_there_is() {
    let mut store = store();
    put(&mut store, 1, &text(1, 4000)).unwrap();
    put(&mut store, 2, &text(2, 3000)).unwrap();
    put(&mut store, 3, &text(3, 2800)).unwrap();
    store.delete(1).unwrap();
    // Five sectors free before the others, none behind.
    let full = refusal(store.begin(&info(4, &text(4, 5 * 1024))));
    assert_eq!(
        full,
        ProgramRefusal::Full {
            needed_bytes: 5 * 1024,
            longest_bytes: 5 * 1024 - HEAD,
            free_bytes: 5 * 1024,
        }
    );
    // What was there is there, and what fits goes in.
    assert_eq!(get(&mut store, 2), Some(text(2, 3000)));
    put(&mut store, 4, &text(4, 5 * 1024 - HEAD as usize)).unwrap();
}

#[test]
fn what_cannot_be_a_program_is_refused() {
    let mut store = store();
    for number in [0, MAX_NUMBER + 1] {
        let program = info(number, b"M30");
        assert_eq!(refusal(store.begin(&program)), ProgramRefusal::BadNumber);
    }
    let empty = info(1, b"");
    assert_eq!(refusal(store.begin(&empty)), ProgramRefusal::Empty);
    assert_eq!(refusal(store.piece(0, b"M30")), ProgramRefusal::NotBegun);
    assert_eq!(refusal(store.end(1, 0)), ProgramRefusal::NotBegun);
}

#[test]
fn a_store_keeps_as_many_programs_as_it_says() {
    let geometry = Geometry {
        sectors: 40,
        ..GEOMETRY
    };
    let mut store = Store::open(MockFlash::new(geometry)).unwrap();
    let most = MAX_PROGRAMS as u16;
    for number in 1..=u32::from(most) {
        put(&mut store, number, &text(number.into(), 300)).unwrap();
    }
    let more = refusal(store.begin(&info(99, b"M30")));
    assert_eq!(more, ProgramRefusal::TooMany { most });
    put(&mut store, 5, &text(5, 600)).unwrap();
    let store = Store::open(store.into_flash()).unwrap();
    assert_eq!(store.programs().len(), MAX_PROGRAMS);
}

/// Bytes that come twice, too early or behind the end change nothing: a host repeats what
/// was not answered.
#[test]
fn pieces_may_come_twice() {
    let mut store = store();
    let text = text(3, 2000);
    let program = info(3, &text);
    store.begin(&program).unwrap();
    assert_eq!(store.piece(0, &text[..300]), Ok(300));
    assert_eq!(store.piece(0, &text[..300]), Ok(300));
    assert_eq!(store.piece(900, &text[900..]), Ok(300));
    let early = refusal(store.end(3, program.crc32));
    assert_eq!(early, ProgramRefusal::Incomplete { offset: 300 });
    let mut long = text[300..].to_vec();
    long.extend_from_slice(b"X");
    assert_eq!(store.piece(300, &long), Ok(2000));
    assert!(store.end(3, program.crc32).unwrap().is_some());
    assert_eq!(store.end(3, program.crc32), Ok(None));
    assert_eq!(get(&mut store, 3), Some(text));
}

#[test]
fn an_upload_with_another_check_value_leaves_the_old_program() {
    let mut store = store();
    let old = text(1, 900);
    put(&mut store, 3, &old).unwrap();
    let mut new = text(2, 900);
    let program = info(3, &new);
    new[400] ^= 1;
    store.begin(&program).unwrap();
    store.piece(0, &new).unwrap();
    let damaged = refusal(store.end(3, program.crc32));
    let crc32 = CRC32.checksum(&new);
    assert_eq!(damaged, ProgramRefusal::Damaged { crc32 });
    assert_eq!(get(&mut store, 3), Some(old.clone()));
    assert_eq!(store.room().free_bytes, 10 * 1024);
    let mut store = Store::open(store.into_flash()).unwrap();
    assert_eq!(get(&mut store, 3), Some(old));
}

/// An upload goes on where it broke off if it is the same, and begins anew if it is another.
#[test]
fn an_upload_that_broke_off_goes_on_at_a_sector() {
    let text = text(4, 6000);
    let program = info(4, &text);
    for cut in [100, 768, 1000, 2000, 5999, 6000] {
        let mut store = store();
        store.begin(&program).unwrap();
        store.piece(0, &text[..cut]).unwrap();
        let mut store = Store::open(store.into_flash()).unwrap();
        assert_eq!(store.programs(), []);
        let not_begun = refusal(store.piece(0, &text));
        assert_eq!(not_begun, ProgramRefusal::NotBegun);
        let mut other = store.clone();
        let on = put(&mut store, 4, &text).unwrap();
        assert!(on as usize <= cut && cut - (on as usize) < 1024 + 256);
        assert_eq!(on == 0, cut <= 1000, "{cut}: {on}");
        assert_eq!(get(&mut store, 4).unwrap(), text);
        // Only the bytes tell that it is another.
        let changed: Vec<u8> = text.iter().map(|byte| byte ^ 1).collect();
        assert_eq!(put(&mut other, 4, &changed).unwrap(), 0);
        assert_eq!(get(&mut other, 4).unwrap(), changed);
    }
}

/// Flash that reports a failure: the upload goes on from a sector, and what was there stays.
#[test]
fn a_failure_of_the_flash_costs_a_sector() {
    let mut store = store();
    let old = text(1, 300);
    put(&mut store, 6, &old).unwrap();
    let text = text(2, 3000);
    let program = info(6, &text);
    store.begin(&program).unwrap();
    store.piece(0, &text[..2000]).unwrap();
    store.flash.fail_next_program = true;
    assert_eq!(
        store.piece(2000, &text[2000..]),
        Err(StoreError::Flash(MockError::ProgramFailed))
    );
    let closed = refusal(store.piece(2000, &text[2000..]));
    assert_eq!(closed, ProgramRefusal::NotBegun);
    assert_eq!(get(&mut store, 6), Some(old));
    assert!(put(&mut store, 6, &text).unwrap() > 0);
    assert_eq!(get(&mut store, 6), Some(text));
}

#[test]
fn a_region_that_cannot_hold_programs_is_refused() {
    let with = |change: fn(&mut Geometry)| {
        let mut geometry = GEOMETRY;
        change(&mut geometry);
        let flash = MockFlash::new(geometry);
        match Store::open(flash) {
            Err(StoreError::Geometry(fault)) => fault,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(with(|g| g.sectors = 1), GeometryFault::TooFewSectors);
    assert_eq!(with(|g| g.write_size = 512), GeometryFault::WriteSize);
    assert_eq!(
        with(|g| g.sector_size = 900),
        GeometryFault::SectorNotWholePages
    );
    assert_eq!(with(|g| g.sector_size = 256), GeometryFault::SectorTooSmall);
}
