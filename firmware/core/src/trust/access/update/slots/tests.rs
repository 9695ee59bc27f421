use super::*;
use crate::journal::Geometry;
use crate::journal::mock::{Cut, ERASE_CUTS, MockFlash, Op, Random};
use crate::trust::board_key::{BoardKey, SEED, key_id};

use ed25519_dalek::{Signer as _, SigningKey};
use std::vec::Vec;
use umi_protocol::job::name;

const STATE: Geometry = Geometry {
    sectors: 2,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

const SLOT: Geometry = Geometry {
    sectors: 2,
    sector_size: 1024,
    write_size: 32,
    page_size: 256,
};

const KIND: ImageKind = ImageKind {
    boards: ["virtual"; 2],
    built_in: Some([0, 1, 0]),
};

/// A board with a boot loader.
const LOADED: ImageKind = ImageKind {
    boards: ["pico-a", "pico-b"],
    built_in: None,
};

/// The flash of a board.
#[derive(Clone)]
struct Areas {
    state: MockFlash,
    slots: [MockFlash; 2],
}

impl Areas {
    fn new() -> Self {
        Self {
            state: MockFlash::new(STATE),
            slots: [MockFlash::new(SLOT), MockFlash::new(SLOT)],
        }
    }

    fn open(&mut self) -> Slots<&mut MockFlash> {
        let [a, b] = &mut self.slots;
        let maker = Maker::First(Some(maker().verifying_key().to_bytes()));
        Slots::open(&mut self.state, [a, b], KIND, maker).unwrap()
    }
}

pub(super) fn maker() -> SigningKey {
    SigningKey::from_bytes(&[5; 32])
}

/// An image of so many bytes, signed by this key.
fn image(by: &SigningKey, board: &str, version: ImageVersion, counter: u32, len: usize) -> Vec<u8> {
    let payload = (0..len).map(|n| (n * 7 + len) as u8).collect();
    signed(by, board, version, counter, payload)
}

/// A payload, signed.
pub(super) fn signed(
    by: &SigningKey,
    board: &str,
    version: ImageVersion,
    counter: u32,
    payload: Vec<u8>,
) -> Vec<u8> {
    let header = ImageHeader {
        board: name(board),
        version,
        counter,
        length: payload.len() as u32,
        sha512: Sha512::digest(&payload).into(),
        key_id: key_id(&by.verifying_key().to_bytes()),
    };
    let signature = by.sign(&header.signed());
    let mut bytes = header
        .encode([*signature.r_bytes(), *signature.s_bytes()])
        .to_vec();
    bytes.extend(payload);
    bytes
}

fn good(version: u16, counter: u32, len: usize) -> Vec<u8> {
    image(&maker(), "virtual", [1, version, 0], counter, len)
}

/// Sends an image to its end.
pub(super) fn send<F: Flash>(
    slots: &mut Slots<F>,
    image: &[u8],
) -> Result<ImageVersion, UpdateError> {
    let (header, payload) = image.split_first_chunk().unwrap();
    let mut at = slots.begin(header)? as usize;
    while at < payload.len() {
        let end = (at + 96).min(payload.len());
        at = slots.piece(at as u32, &payload[at..end])? as usize;
    }
    end(slots)
}

fn end<F: Flash>(slots: &mut Slots<F>) -> Result<ImageVersion, UpdateError> {
    let version = slots.whole()?;
    slots.mark()?;
    Ok(version)
}

pub(super) fn refused(result: Result<ImageVersion, UpdateError>) -> UpdateRefusal {
    match result {
        Err(UpdateError::Refused(refusal)) => refusal,
        other => panic!("{other:?}"),
    }
}

/// An image is received, tried and confirmed, and runs from then on; the next goes to the other
/// slot; one that does not confirm itself is gone at the next start.
#[test]
fn an_image_is_tried_before_it_counts() {
    let mut areas = Areas::new();
    let mut slots = areas.open();
    assert_eq!(slots.start().unwrap().place, ImagePlace::BuiltIn);
    assert_eq!(send(&mut slots, &good(1, 1, 700)), Ok([1, 1, 0]));
    assert_eq!(end(&mut slots), Ok([1, 1, 0]), "asked twice");
    assert_eq!(slots.info().latest, UpdateState::Trial);

    let mut slots = areas.open();
    let started = slots.start().unwrap();
    assert_eq!((started.place, started.on_trial), (ImagePlace::A, true));
    assert!(!slots.info().confirmed);
    assert_eq!(slots.confirm(), Ok(Some(([0, 1, 0], [1, 1, 0]))));
    assert_eq!(slots.confirm(), Ok(None));
    assert_eq!(send(&mut slots, &good(2, 1, 800)), Ok([1, 2, 0]));

    // On trial, and never confirmed.
    let mut slots = areas.open();
    assert_eq!(slots.start().unwrap().place, ImagePlace::B);
    let mut slots = areas.open();
    let started = slots.start().unwrap();
    assert_eq!(started.place, ImagePlace::A);
    assert_eq!(started.reverted, Some([1, 2, 0]));
    let info = slots.info();
    assert_eq!(
        (info.version, info.latest),
        ([1, 1, 0], UpdateState::Reverted)
    );
    // It may be tried again.
    assert_eq!(send(&mut slots, &good(2, 1, 800)), Ok([1, 2, 0]));
}

/// Each fault of an image has its name, and none of them changes what runs.
#[test]
fn what_is_wrong_with_an_image_is_named() {
    let mut areas = Areas::new();
    let mut slots = areas.open();
    slots.start().unwrap();
    send(&mut slots, &good(3, 7, 100)).unwrap();
    let mut slots = areas.open();
    slots.start().unwrap();
    slots.confirm().unwrap();
    let foreign = SigningKey::from_bytes(&[6; 32]);
    let too_long = refused(send(&mut slots, &good(4, 7, 2000)));
    assert_eq!(
        too_long,
        UpdateRefusal::TooLong {
            most_bytes: 2048 - 192
        }
    );
    for (bad, why) in [
        (
            image(&foreign, "virtual", [2, 0, 0], 9, 50),
            UpdateRefusal::Signature,
        ),
        (
            image(&maker(), "pico", [2, 0, 0], 9, 50),
            UpdateRefusal::Board,
        ),
        (good(2, 7, 50), UpdateRefusal::Rollback),
        (good(9, 6, 50), UpdateRefusal::Rollback),
    ] {
        assert_eq!(refused(send(&mut slots, &bad)), why);
    }
    let mut damaged = good(4, 7, 300);
    *damaged.last_mut().unwrap() ^= 1;
    assert_eq!(refused(send(&mut slots, &damaged)), UpdateRefusal::Damaged);
    let mut header = good(4, 7, 300);
    header[30] ^= 1;
    assert_eq!(refused(send(&mut slots, &header)), UpdateRefusal::Signature);
    assert_eq!(refused(end(&mut slots)), UpdateRefusal::NotBegun);
    assert_eq!(slots.info().version, [1, 3, 0]);
    let mut slots = areas.open();
    assert_eq!(slots.start().unwrap().place, ImagePlace::A);
}

/// An image that was changed in its slot does not run.
#[test]
fn what_was_changed_at_rest_does_not_run() {
    for at in [0, 20, 60, 130, 192, 250] {
        let mut areas = Areas::new();
        let mut slots = areas.open();
        slots.start().unwrap();
        send(&mut slots, &good(1, 1, 100)).unwrap();
        areas.slots[0].data[at] ^= 1;
        let mut slots = areas.open();
        assert_eq!(
            slots.start().unwrap().place,
            ImagePlace::BuiltIn,
            "on trial"
        );

        let mut areas = Areas::new();
        let mut slots = areas.open();
        slots.start().unwrap();
        send(&mut slots, &good(1, 1, 100)).unwrap();
        let mut slots = areas.open();
        slots.start().unwrap();
        slots.confirm().unwrap();
        areas.slots[0].data[at] ^= 1;
        // Told at each start, and by what it says of itself.
        for _ in 0..2 {
            let mut slots = areas.open();
            let started = slots.start().unwrap();
            assert_eq!(started.place, ImagePlace::BuiltIn, "confirmed");
            assert_eq!(started.reverted, Some([1, 1, 0]));
            assert_eq!(slots.info().latest, UpdateState::Reverted);
        }
    }
}

impl Areas {
    /// As its boot loader and each of its images open them.
    fn loaded(&mut self) -> Result<Slots<&mut MockFlash>, UpdateError> {
        let [a, b] = &mut self.slots;
        let maker = Maker::Fixed(maker().verifying_key().to_bytes());
        Slots::open(&mut self.state, [a, b], LOADED, maker)
    }

    /// Puts an image into a slot, as who flashes a board does.
    fn put(&mut self, slot: usize, image: &[u8]) {
        self.slots[slot].data[..image.len()].copy_from_slice(image);
    }
}

fn built_for(board: &str, version: u16, counter: u32) -> Vec<u8> {
    image(&maker(), board, [1, version, 0], counter, 300)
}

/// With a boot loader nothing is built in: the first start takes the newest image that is right, it goes
/// on where it was started, and only one that is built for the other slot comes there.
#[test]
fn a_boot_loader_starts_what_stands_in_a_slot() {
    let mut areas = Areas::new();
    assert_eq!(
        areas.loaded().unwrap().start().unwrap().place,
        ImagePlace::BuiltIn,
        "nothing to start"
    );
    areas.put(0, &built_for("pico-a", 1, 3));
    let started = areas.loaded().unwrap().start().unwrap();
    assert_eq!((started.place, started.on_trial), (ImagePlace::A, false));
    let mut slots = areas.loaded().unwrap();
    assert_eq!(
        slots.resume(ImagePlace::B),
        Err(UpdateRefusal::Damaged.into())
    );
    slots.resume(ImagePlace::A).unwrap();
    let info = slots.info();
    assert_eq!((info.version, info.counter), ([1, 1, 0], 3));
    assert!(info.confirmed);
    for (board, counter, why) in [
        // Built for the place that runs.
        ("pico-a", 3, UpdateRefusal::Board),
        ("pico-b", 2, UpdateRefusal::Rollback),
    ] {
        assert_eq!(
            refused(send(&mut slots, &built_for(board, 2, counter))),
            why
        );
    }
    send(&mut slots, &built_for("pico-b", 2, 4)).unwrap();

    let started = areas.loaded().unwrap().start().unwrap();
    assert_eq!((started.place, started.on_trial), (ImagePlace::B, true));
    let mut slots = areas.loaded().unwrap();
    slots.resume(ImagePlace::B).unwrap();
    assert_eq!(slots.trial(), Some(([1, 1, 0], [1, 2, 0])));
    assert!(slots.confirm().unwrap().is_some());
    // The one before is older than the counter: it does not run any more.
    areas.slots[1].data[200] ^= 1;
    assert_eq!(
        areas.loaded().unwrap().start().unwrap().place,
        ImagePlace::BuiltIn
    );
}

/// Of two images that somebody has put there, the first start takes the newer one, or the one that is right.
#[test]
fn the_first_start_takes_the_newest() {
    for (a, b, place) in [
        ((2, 1), (1, 1), ImagePlace::A),
        ((1, 1), (2, 1), ImagePlace::B),
        ((9, 1), (1, 2), ImagePlace::B),
    ] {
        let mut areas = Areas::new();
        areas.put(0, &built_for("pico-a", a.0, a.1));
        areas.put(1, &built_for("pico-b", b.0, b.1));
        assert_eq!(areas.loaded().unwrap().start().unwrap().place, place);
    }
    let mut areas = Areas::new();
    areas.put(0, &built_for("pico-a", 1, 1));
    areas.put(1, &built_for("pico-b", 2, 1));
    areas.slots[1].data[250] ^= 1;
    let started = areas.loaded().unwrap().start().unwrap();
    assert_eq!(started.place, ImagePlace::A);
}

/// Where what counts cannot be read, the newest image runs and none is taken. The boot loader's key counts,
/// whatever else was kept.
#[test]
fn without_what_counts_the_newest_runs_and_none_is_taken() {
    let mut areas = Areas::new();
    areas.put(0, &built_for("pico-a", 1, 3));
    let [a, b] = &mut areas.slots;
    let maker = Maker::Fixed(maker().verifying_key().to_bytes());
    let mut slots = Slots::stateless([a, b], LOADED, maker);
    assert_eq!(slots.start().unwrap().place, ImagePlace::A);
    let mut slots = slots;
    let sent = send(&mut slots, &built_for("pico-b", 2, 4));
    assert_eq!(sent, Err(UpdateError::Flash));

    let mut areas = Areas::new();
    areas.put(0, &built_for("pico-a", 1, 3));
    areas.loaded().unwrap().start().unwrap();
    let other = SigningKey::from_bytes(&[6; 32]).verifying_key().to_bytes();
    let [a, b] = &mut areas.slots;
    let mut slots = Slots::open(&mut areas.state, [a, b], LOADED, Maker::Fixed(other)).unwrap();
    assert_eq!(slots.start().unwrap().place, ImagePlace::BuiltIn);
}

/// The power goes at every operation of the first start, and once more of the second: the image that stands there starts,
/// and counts from then on.
#[test]
fn a_power_cut_at_the_first_start_leaves_an_image_that_runs() {
    let starts = |areas: &mut Areas| areas.loaded().and_then(|mut slots| slots.start());
    let mut new = Areas::new();
    new.put(0, &built_for("pico-a", 1, 3));
    let ops = operations(&new, 0, |areas| _ = starts(areas));
    assert!(ops.len() > 2, "{ops:?}");
    for (at, op) in ops.iter().enumerate() {
        for way in ways(op) {
            let mut areas = new.clone();
            areas.state.cut_power_at(at, way, at as u64 + 1);
            let _ = starts(&mut areas);
            areas.power_up();
            let again = operations(&areas, 0, |areas| _ = starts(areas));
            for (at, op) in again.iter().enumerate() {
                for way in ways(op) {
                    let mut areas = areas.clone();
                    areas.state.cut_power_at(at, way, at as u64 + 1);
                    let _ = starts(&mut areas);
                    areas.power_up();
                    assert_eq!(starts(&mut areas).unwrap().place, ImagePlace::A);
                }
            }
            assert_eq!(starts(&mut areas).unwrap().place, ImagePlace::A);
            assert_eq!(areas.loaded().unwrap().kept.counter, 3);
        }
    }
}

/// Where a trial cannot be kept any more, none begins: the image that was confirmed starts, and not the newer one, which
/// would be tried without end.
#[test]
fn without_a_state_that_is_written_no_trial_begins() {
    let mut areas = Areas::new();
    areas.put(0, &built_for("pico-a", 1, 3));
    areas.loaded().unwrap().start().unwrap();
    let mut slots = areas.loaded().unwrap();
    slots.resume(ImagePlace::A).unwrap();
    send(&mut slots, &built_for("pico-b", 2, 4)).unwrap();
    areas.state.take_ops();
    areas.state.cut_power_at(0, Cut::AtByte(0), 1);
    let mut slots = areas.loaded().unwrap();
    assert_eq!(slots.start(), Err(UpdateError::Flash));
    let started = slots.start_confirmed();
    assert_eq!((started.place, started.on_trial), (ImagePlace::A, false));
}

/// What can happen to an operation: torn at any of its ends, in a word that still reads as erased, in
/// a page in no order, or done and not told.
pub(super) fn ways(op: &Op) -> Vec<Cut> {
    match op {
        Op::Erase { .. } => ERASE_CUTS.to_vec(),
        Op::Program { len, .. } => {
            let at = [0, 1, len / 2, len - 1, *len].map(Cut::AtByte);
            let others = [
                Cut::Unseen(0),
                Cut::Unseen(len / 2),
                Cut::Page(0),
                Cut::Page(len - 1),
            ];
            [&at[..], &others[..]].concat()
        }
    }
}

/// The operations on an area from here to the end of an update.
fn operations(areas: &Areas, area: usize, goes_on: impl Fn(&mut Areas)) -> Vec<Op> {
    let mut dry = areas.clone();
    dry.area(area).take_ops();
    goes_on(&mut dry);
    dry.area(area).take_ops()
}

/// The power goes at every operation on any of the three areas, from the first piece of the second
/// update to its confirmation, and once more at every operation of the start behind that: what
/// starts is whole, is the version before or the new one, and the counter never goes back; and the
/// update can be done again.
#[test]
fn a_power_cut_leaves_an_image_that_runs() {
    let before = updated_once();
    let mut cuts = [0, 0];
    for area in 0..3 {
        let ops = operations(&before, area, |areas| second(areas).unwrap());
        assert!(area == 1 || ops.len() > 4, "{ops:?}");
        for (at, op) in ops.iter().enumerate() {
            for way in ways(op) {
                let mut areas = before.clone();
                areas.area(area).take_ops();
                areas.area(area).cut_power_at(at, way, at as u64 + 1);
                assert!(second(&mut areas).is_err(), "{op:?} {way:?}");
                areas.power_up();
                cuts[0] += 1;
                let again = operations(&areas, 0, |areas| _ = starts(areas));
                for (at, op) in again.iter().enumerate() {
                    for way in ways(op) {
                        let mut areas = areas.clone();
                        areas.state.cut_power_at(at, way, at as u64 + 1);
                        let _ = starts(&mut areas);
                        areas.power_up();
                        cuts[1] += 1;
                        is_one(&mut areas);
                    }
                }
                is_one(&mut areas);
                second(&mut areas).unwrap();
                let mut slots = areas.open();
                slots.start().unwrap();
                assert_eq!(slots.info().version, [1, 2, 0]);
            }
        }
    }
    assert!(cuts[0] > 100 && cuts[1] > 300, "{cuts:?}");
}

/// However often it starts, what runs is the one before or the new one, whole.
fn is_one(areas: &mut Areas) {
    let mut counter = 0;
    for _ in 0..3 {
        let mut slots = areas.open();
        slots.start().unwrap();
        let info = slots.info();
        let either = [([1, 1, 0], 1), ([1, 2, 0], 5)];
        assert!(either.contains(&(info.version, info.counter)), "{info:?}");
        assert!(slots.kept.counter >= counter, "the counter went back");
        counter = slots.kept.counter;
    }
}

/// A board that is updated again and again while the power goes: so often, from this seed.
fn cut_often(times: u32, seed: u64) {
    let mut random = Random(seed);
    let mut areas = updated_once();
    let (mut version, mut kept) = (1, 1);
    for n in 0..times {
        let next = good(
            version + 1,
            u32::from(version) + 1,
            64 + random.below(900) as usize,
        );
        let goes_on = |areas: &mut Areas| update(areas, &next);
        let area = random.below(3) as usize;
        let ops = operations(&areas, area, |areas| _ = goes_on(areas));
        if !ops.is_empty() {
            let at = random.below(ops.len() as u64) as usize;
            let ways = ways(&ops[at]);
            let way = ways[random.below(ways.len() as u64) as usize];
            areas.area(area).take_ops();
            areas.area(area).cut_power_at(at, way, random.bits());
        }
        let _ = goes_on(&mut areas);
        areas.power_up();
        let mut slots = areas.open();
        slots.start().unwrap();
        let info = slots.info();
        assert!(
            info.version == [1, version, 0] || info.version == [1, version + 1, 0],
            "{n}: {info:?}"
        );
        assert!(slots.kept.counter >= kept, "{n}: the counter went back");
        kept = slots.kept.counter;
        if slots.trial().is_none() && info.version == [1, version + 1, 0] {
            version += 1;
        }
    }
    assert!(u32::from(version) > times / 20, "{version}");
}

/// 100 cuts, one behind the other.
#[test]
fn power_cuts_behind_each_other_leave_an_image_that_runs() {
    cut_often(100, 1);
}

/// As above, 10^5 of them. By hand: `cargo test --release -p umi-core long_power_cuts -- --ignored`.
#[test]
#[ignore = "minutes"]
fn long_power_cuts_behind_each_other() {
    for seed in 0..10 {
        cut_often(10_000, seed);
    }
}

/// A board that runs a first update.
fn updated_once() -> Areas {
    let mut areas = Areas::new();
    update(&mut areas, &good(1, 1, 300)).unwrap();
    areas
}

/// From the first piece of an update to its confirmation.
fn update(areas: &mut Areas, image: &[u8]) -> Result<(), UpdateError> {
    let mut slots = areas.open_or()?;
    slots.start()?;
    send(&mut slots, image)?;
    starts(areas)
}

fn second(areas: &mut Areas) -> Result<(), UpdateError> {
    update(areas, &good(2, 5, 400))
}

/// A start; what is on trial is confirmed.
fn starts(areas: &mut Areas) -> Result<(), UpdateError> {
    let mut slots = areas.open_or()?;
    slots.start()?;
    slots.confirm()?;
    Ok(())
}

impl Areas {
    fn area(&mut self, area: usize) -> &mut MockFlash {
        match area {
            0 => &mut self.state,
            1 => &mut self.slots[0],
            _ => &mut self.slots[1],
        }
    }

    fn power_up(&mut self) {
        for area in 0..3 {
            self.area(area).power_up();
        }
    }

    /// As [`Self::open`], where the power may be gone.
    fn open_or(&mut self) -> Result<Slots<&mut MockFlash>, UpdateError> {
        let [a, b] = &mut self.slots;
        let maker = Maker::First(Some(maker().verifying_key().to_bytes()));
        Slots::open(&mut self.state, [a, b], KIND, maker)
    }
}

/// Two sectors of an STM32H743's own flash, smaller: words of 32 bytes that are programmed once.
const WORDS: Geometry = Geometry {
    sectors: 2,
    sector_size: 1024,
    write_size: 32,
    page_size: 32,
};

impl Areas {
    /// A board with such a flash: its key and which image counts share two sectors, and one place is longer than the other.
    /// With image A, as who flashes a board leaves it.
    fn in_words(torn_reads_zero: bool) -> Self {
        let flash = |sectors| {
            let mut flash = MockFlash::new(Geometry { sectors, ..WORDS });
            flash.torn_reads_zero = torn_reads_zero;
            flash
        };
        let mut areas = Self {
            state: flash(2),
            slots: [flash(3), flash(2)],
        };
        areas.put(0, &built_for("pico-a", 1, 1));
        areas
    }

    /// As its boot loader opens them, and each image behind the board's key.
    fn behind_key(&mut self) -> Result<Slots<&mut MockFlash>, UpdateError> {
        let [a, b] = &mut self.slots;
        let maker = Maker::Fixed(maker().verifying_key().to_bytes());
        Slots::open_behind_key(&mut self.state, [a, b], LOADED, maker)
    }

    /// A start: the boot loader's, then the image's, whose key is drawn from this number if it has none.
    fn run(&mut self, draws: u8) -> Result<(BoardKey, Slots<&mut MockFlash>), UpdateError> {
        let started = self.behind_key()?.start()?;
        let draw = |seed: &mut [u8; SEED]| {
            seed.fill(draws);
            seed[0] = !draws;
            Ok(())
        };
        let key = BoardKey::open(&mut self.state, draw).map_err(|_| UpdateError::Flash)?;
        let mut slots = self.behind_key()?;
        slots.resume(started.place)?;
        Ok((key, slots))
    }

    /// From wherever it was left to the second image, confirmed.
    fn second_behind_key(&mut self) -> Result<(), UpdateError> {
        let (_, mut slots) = self.run(2)?;
        if slots.trial().is_none() && slots.info().version == [1, 1, 0] {
            send(&mut slots, &built_for("pico-b", 2, 5))?;
            (_, slots) = self.run(3)?;
        }
        slots.confirm()?;
        Ok(())
    }

    /// However often it starts: the key of before, no start forgotten that was whole, and an image that is whole; the
    /// counter never goes back.
    fn is_whole(&mut self, public: [u8; 32], starts: u32) {
        let (mut starts, mut counter) = (starts, 0);
        for _ in 0..2 {
            let (key, mut slots) = self.run(4).unwrap();
            assert_eq!(key.public(), public, "another key");
            assert!(key.boot() > starts, "{} after {starts}", key.boot());
            starts = key.boot();
            let info = slots.info();
            let either = [([1, 1, 0], 1), ([1, 2, 0], 5)];
            assert!(either.contains(&(info.version, info.counter)), "{info:?}");
            assert!(slots.kept.counter >= counter, "the counter went back");
            counter = slots.kept.counter;
        }
    }
}

/// As [`a_power_cut_leaves_an_image_that_runs`], where the board's key stands in the same journal, in words of 32 bytes of
/// which a torn one reads as zeros, or as anything: the key is there, too, and no start is forgotten.
#[test]
fn a_power_cut_costs_neither_key_nor_image() {
    for torn_reads_zero in [false, true] {
        let mut before = Areas::in_words(torn_reads_zero);
        let (key, _) = before.run(1).unwrap();
        let (public, starts) = (key.public(), key.boot());
        assert_eq!(starts, 1);
        let mut cuts = [0, 0];
        for area in 0..3 {
            let ops = operations(&before, area, |areas| areas.second_behind_key().unwrap());
            assert!(area == 1 || ops.len() > 4, "{ops:?}");
            for (at, op) in ops.iter().enumerate() {
                for way in ways(op) {
                    let mut areas = before.clone();
                    areas.area(area).take_ops();
                    areas.area(area).cut_power_at(at, way, at as u64 + 1);
                    assert!(areas.second_behind_key().is_err(), "{op:?} {way:?}");
                    areas.power_up();
                    cuts[0] += 1;
                    let again = operations(&areas, 0, |areas| _ = areas.run(5));
                    for (at, op) in again.iter().enumerate() {
                        for way in ways(op) {
                            let mut areas = areas.clone();
                            areas.state.cut_power_at(at, way, at as u64 + 1);
                            let _ = areas.run(6);
                            areas.power_up();
                            cuts[1] += 1;
                            areas.is_whole(public, starts);
                        }
                    }
                    areas.clone().is_whole(public, starts);
                    areas.second_behind_key().unwrap();
                    assert_eq!(areas.run(7).unwrap().1.info().version, [1, 2, 0]);
                }
            }
        }
        assert!(cuts[0] > 150 && cuts[1] > 3500, "{cuts:?}");
    }
}

/// The power goes at every operation of the first start of such a board, and once more of the second: it has a key in the
/// end, which stays, and the image runs.
#[test]
fn a_power_cut_at_the_first_start_leaves_a_board_with_a_key() {
    for torn_reads_zero in [false, true] {
        let new = Areas::in_words(torn_reads_zero);
        let ops = operations(&new, 0, |areas| _ = areas.run(1).unwrap());
        assert!(ops.len() > 4, "{ops:?}");
        for (at, op) in ops.iter().enumerate() {
            for way in ways(op) {
                let mut areas = new.clone();
                areas.state.cut_power_at(at, way, at as u64 + 1);
                assert!(areas.run(1).is_err(), "{op:?} {way:?}");
                areas.power_up();
                let again = operations(&areas, 0, |areas| _ = areas.run(2));
                for (at, op) in again.iter().enumerate() {
                    for way in ways(op) {
                        let mut areas = areas.clone();
                        areas.state.cut_power_at(at, way, at as u64 + 1);
                        let _ = areas.run(2);
                        areas.power_up();
                        let (key, _) = areas.run(3).unwrap();
                        areas.is_whole(key.public(), key.boot());
                    }
                }
            }
        }
    }
}

/// Who has flashed a board without boot loader before finds its key again behind one.
#[test]
fn a_key_from_before_the_boot_loader_stays() {
    let draw = |seed: &mut [u8; SEED]| {
        *seed = core::array::from_fn(|n| n as u8);
        Ok(())
    };
    let mut areas = Areas::in_words(true);
    let public = BoardKey::open(&mut areas.state, draw).unwrap().public();
    assert_eq!(areas.run(9).unwrap().0.public(), public);
    areas.is_whole(public, 2);
}

/// Each place has its own length: what is told and taken is that of the place where the next image goes.
#[test]
fn a_shorter_place_takes_less() {
    let mut areas = Areas::in_words(true);
    let (_, mut slots) = areas.run(1).unwrap();
    let most_bytes = 2 * 1024 - IMAGE_HEADER as u32;
    assert_eq!(slots.info().most_bytes, most_bytes);
    let sized = |board, version, len| image(&maker(), board, [1, version, 0], 1, len);
    let longest = most_bytes as usize;
    assert_eq!(
        refused(send(&mut slots, &sized("pico-b", 2, longest + 1))),
        UpdateRefusal::TooLong { most_bytes }
    );
    send(&mut slots, &sized("pico-b", 2, longest)).unwrap();
    let (_, mut slots) = areas.run(1).unwrap();
    slots.confirm().unwrap();
    assert_eq!(slots.info().most_bytes, most_bytes + 1024);
    send(&mut slots, &sized("pico-a", 3, longest + 1024)).unwrap();
}

/// A flash that fails at a piece: the same image begins anew, and no word is programmed twice.
#[test]
fn an_image_begins_anew_where_the_flash_failed() {
    let mut areas = Areas::in_words(true);
    let (_, mut slots) = areas.run(1).unwrap();
    let next = built_for("pico-b", 2, 5);
    let (header, payload) = next.split_first_chunk().unwrap();
    assert_eq!(slots.begin(header), Ok(0));
    assert_eq!(slots.piece(0, &payload[..96]), Ok(96));
    assert_eq!(slots.begin(header), Ok(96), "it goes on");
    slots.flash(true).fail_next_program = true;
    assert_eq!(slots.piece(96, &payload[96..192]), Err(UpdateError::Flash));
    assert_eq!(slots.begin(header), Ok(0), "it begins anew");
    assert_eq!(send(&mut slots, &next), Ok([1, 2, 0]));
}

/// Where what counts is an older copy, or was erased, images that the board has bar older ones all the same; one that was
/// given up bars none.
#[test]
fn an_older_state_takes_no_older_image() {
    let mut areas = Areas::new();
    let mut older = None;
    for n in 1_u16..=7 {
        let mut slots = areas.open();
        slots.start().unwrap();
        send(&mut slots, &good(n, n.into(), 300)).unwrap();
        let mut slots = areas.open();
        slots.start().unwrap();
        slots.confirm().unwrap();
        if n == 1 {
            older = Some(areas.state.clone());
        }
    }
    let erased = Some(MockFlash::new(STATE));
    for (state, counter) in [(older, 7), (erased, 0)] {
        let mut areas = areas.clone();
        areas.state = state.unwrap();
        let mut slots = areas.open();
        slots.start().unwrap();
        assert_eq!(slots.info().counter, counter);
        for n in [2_u16, 6] {
            let refused = refused(send(&mut slots, &good(n, n.into(), 300)));
            assert_eq!(refused, UpdateRefusal::Rollback, "{counter} {n}");
        }
        assert_eq!(slots.info().counter, counter);
        send(&mut slots, &good(8, 7, 300)).unwrap();
        let mut slots = areas.open();
        assert!(slots.start().unwrap().on_trial);
    }
    // A new board gives an image up: it takes an older one.
    let mut areas = Areas::new();
    for (n, is_confirmed) in [(9_u16, false), (1, true)] {
        let mut slots = areas.open();
        slots.start().unwrap();
        send(&mut slots, &good(n, n.into(), 300)).unwrap();
        let mut slots = areas.open();
        assert!(slots.start().unwrap().on_trial);
        if is_confirmed {
            slots.confirm().unwrap();
        }
        areas.open().start().unwrap();
    }
    assert_eq!(areas.open().kept.counter, 1);
}
