//! Programs that a control punches: of a length that nobody said before.

use super::*;
use crate::journal::mock::Op;

fn name() -> Name {
    Name::try_from("PART").unwrap()
}

/// Takes a program as a control punches it.
pub(super) fn punch<F: Flash>(
    store: &mut Store<F>,
    number: u32,
    text: &[u8],
) -> Result<Option<Program>, StoreError<F::Error>> {
    store.begin_open()?;
    for piece in text.chunks(173) {
        store.append(piece)?;
    }
    store.end_open(number, name())
}

#[test]
fn punched_programs_are_there_after_a_restart_whatever_their_length() {
    let mut store = store();
    let lengths = [1, 255, 767, 768, 769, 1791, 1793];
    for (number, length) in (1..).zip(lengths) {
        let text = text(number, length);
        let program = punch(&mut store, number as u32, &text).unwrap();
        assert_eq!(program, store.find(number as u32));
    }
    for _ in 0..2 {
        for (number, length) in (1..).zip(lengths) {
            assert_eq!(get(&mut store, number as u32), Some(text(number, length)));
        }
        store = Store::open(store.into_flash()).unwrap();
    }
    // They can be replaced by the host, and deleted.
    put(&mut store, 7, b"M30").unwrap();
    assert_eq!(get(&mut store, 7), Some(b"M30".to_vec()));
    store.delete(1).unwrap();
}

/// The same again is no error, and takes no room; another of its number is refused.
#[test]
fn what_is_there_stays() {
    let mut store = store();
    let old = text(1, 2000);
    put(&mut store, 7, &old).unwrap();
    let room = store.room();
    assert_eq!(punch(&mut store, 7, &old), Ok(None));
    assert_eq!(store.room(), room);
    let crc32 = CRC32.checksum(&old);
    for new in [text(2, 2000), old[..1999].to_vec(), text(2, 10)] {
        let refused = refusal(punch(&mut store, 7, &new));
        assert_eq!(refused, ProgramRefusal::OtherThere { crc32 });
        assert_eq!(store.room(), room);
    }
    let mut store = Store::open(store.into_flash()).unwrap();
    assert_eq!(get(&mut store, 7), Some(old));
    assert_eq!(store.room(), room);
}

/// It takes the longest run, and what is longer is refused with figures; then all is as before.
#[test]
fn as_long_as_there_is_room() {
    let mut store = store();
    for number in 1..4 {
        put(&mut store, number, &text(number.into(), 1700)).unwrap();
    }
    store.delete(1).unwrap();
    // Two free sectors before, six behind.
    let longest = 6 * 1024 - HEAD;
    let room = store.room();
    assert_eq!(room.longest_bytes, longest);
    assert_eq!(store.begin_open(), Ok(longest));
    let long = text(4, longest as usize);
    assert_eq!(store.append(&long), Ok(longest));
    let full = ProgramRefusal::Full {
        needed_bytes: longest + 1,
        longest_bytes: longest,
        free_bytes: 8 * 1024,
    };
    assert_eq!(refusal(store.append(b"X")), full);
    assert_eq!(refusal(store.append(b"X")), ProgramRefusal::NotBegun);
    assert_eq!(store.room(), room);
    punch(&mut store, 4, &long).unwrap();
    assert_eq!(get(&mut store, 4), Some(long));
    // A sector of the two is left; and none at all.
    put(&mut store, 5, &text(5, 100)).unwrap();
    punch(&mut store, 6, &text(6, 768)).unwrap();
    let none = refusal(store.begin_open());
    assert!(matches!(
        none,
        ProgramRefusal::Full {
            longest_bytes: 0,
            ..
        }
    ));
}

/// One erase to begin, and one at most for each piece that is no longer than a sector, and at
/// the end.
#[test]
fn one_erase_at_a_time() {
    for length in [1, 100, 256, 700, 1024] {
        let mut store = store();
        let erases = |store: &mut Store<MockFlash>| {
            let ops = store.flash.take_ops();
            ops.iter()
                .filter(|op| matches!(op, Op::Erase { .. }))
                .count()
        };
        store.begin_open().unwrap();
        assert_eq!(erases(&mut store), 1);
        let mut all = 1;
        let program = text(1, 10_000);
        for piece in program.chunks(length) {
            store.append(piece).unwrap();
            let now = erases(&mut store);
            assert!(now <= 1, "{now} erases for {length} bytes");
            all += now;
        }
        store.end_open(1, name()).unwrap();
        let now = erases(&mut store);
        assert!(now <= 1, "{now} erases at the end");
        all += now;
        assert_eq!(all, (10_000 + HEAD as usize).div_ceil(1024));
        assert_eq!(get(&mut store, 1), Some(program));
    }
}

/// Until its end nothing of it can be seen, and a host has to wait.
#[test]
fn a_host_waits_for_the_end() {
    let mut store = store();
    let begun = text(1, 3000);
    store.begin(&info(1, &begun)).unwrap();
    store.piece(0, &begun[..2000]).unwrap();
    // What the host did not finish is given up.
    store.begin_open().unwrap();
    assert!(store.is_punched());
    store.append(&begun[..1000]).unwrap();
    let busy = refusal(store.begin(&info(1, &begun)));
    assert_eq!(busy, ProgramRefusal::Busy);
    let not_begun = ProgramRefusal::NotBegun;
    assert_eq!(refusal(store.piece(1000, b"X")), not_begun);
    assert_eq!(refusal(store.end(0, 0)), not_begun);
    assert_eq!(store.programs(), []);
    let restarted = Store::open(store.clone().into_flash()).unwrap();
    assert_eq!(restarted.programs(), []);
    assert_eq!(restarted.room().free_bytes, 12 * 1024);
    store.give_up_open();
    assert!(!store.is_punched());
    assert_eq!(refusal(store.append(b"X")), not_begun);
    assert_eq!(refusal(store.end_open(1, name())), not_begun);
    assert_eq!(put(&mut store, 1, &begun), Ok(0));
    // And what a host has not finished does not end by this.
    store.begin(&info(2, &begun)).unwrap();
    store.give_up_open();
    assert_eq!(store.piece(0, b"X"), Ok(1));
}

#[test]
fn what_cannot_be_a_punched_program_is_refused() {
    let mut store = store();
    for number in [0, MAX_NUMBER + 1] {
        let refused = refusal(punch(&mut store, number, b"M30"));
        assert_eq!(refused, ProgramRefusal::BadNumber);
    }
    assert_eq!(refusal(punch(&mut store, 1, b"")), ProgramRefusal::Empty);
    assert_eq!(store.programs(), []);
    let geometry = Geometry {
        sectors: 40,
        ..GEOMETRY
    };
    let mut store = Store::open(MockFlash::new(geometry)).unwrap();
    let most = MAX_PROGRAMS as u32;
    for number in 1..=most / 2 {
        punch(&mut store, number, b"M30").unwrap();
    }
    assert_eq!(refusal(store.begin_open()), ProgramRefusal::PunchedFull);
    // The host finds room: what it puts in place of one is nobody's noise.
    for number in most / 2..=most {
        put(&mut store, number, b"M30").unwrap();
    }
    let most = most as u16;
    assert_eq!(
        refusal(store.begin_open()),
        ProgramRefusal::TooMany { most }
    );
}

/// However much is punched, an eighth of the flash is left for the host.
#[test]
fn punched_programs_leave_room_for_the_host() {
    let geometry = Geometry {
        sectors: 32,
        ..GEOMETRY
    };
    let mut store = Store::open(MockFlash::new(geometry)).unwrap();
    let longest = store.begin_open().unwrap();
    assert_eq!(longest, 28 * 1024 - HEAD);
    store.give_up_open();
    punch(&mut store, 1, &text(1, longest as usize)).unwrap();
    assert_eq!(refusal(store.begin_open()), ProgramRefusal::PunchedFull);
    put(&mut store, 2, &text(2, 3000)).unwrap();
    store.delete(1).unwrap();
    assert!(store.begin_open().is_ok());
}

/// Flash that fails or forgets: nothing is left, and it can be punched again.
#[test]
fn a_failure_of_the_flash_ends_it() {
    let mut store = store();
    let text = text(1, 3200);
    store.begin_open().unwrap();
    store.append(&text[..700]).unwrap();
    store.flash.fail_next_program = true;
    let failed = Err(StoreError::Flash(MockError::ProgramFailed));
    assert_eq!(store.append(&text[700..1500]), failed);
    assert_eq!(refusal(store.append(b"X")), ProgramRefusal::NotBegun);
    // In the last page, in the header, and in the mark.
    for programs_before in 0..3 {
        store.begin_open().unwrap();
        store.append(&text).unwrap();
        let mut ending = store.clone();
        ending.flash.take_ops();
        ending.end_open(1, name()).unwrap();
        let Op::Program { addr, .. } = ending.flash.take_ops()[programs_before] else {
            panic!("an erase at the end");
        };
        store.flash.worn.push(addr);
        let failed = store.end_open(1, name());
        assert_eq!(failed, Err(StoreError::NotKept { addr }));
        store.flash.worn.clear();
        assert_eq!(store.programs(), []);
        let restarted = Store::open(store.clone().into_flash()).unwrap();
        assert_eq!(restarted.programs(), []);
    }
    // A bit that falls after it was programmed and read back.
    store.begin_open().unwrap();
    store.append(&text).unwrap();
    store.flash.data[HEAD as usize + 5] ^= 1;
    let damaged = refusal(store.end_open(1, name()));
    assert!(matches!(damaged, ProgramRefusal::Damaged { .. }));
    punch(&mut store, 1, &text).unwrap();
    assert_eq!(get(&mut store, 1), Some(text));
}
