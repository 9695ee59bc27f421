//! A model of the RP2350's boot ROM chooses, by the rules of its data sheet (5.1.7, 5.1.15 to 5.1.17); the slots are the
//! real ones.

use super::super::tests::{maker, refused, send, signed, ways};
use super::*;
use crate::journal::Geometry;
use crate::journal::mock::{Cut, MockFlash, Op};
use crate::trust::access::update::slots::{ImageKind, Maker};

use sha2::{Digest as _, Sha512};
use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;
use umi_protocol::update::{IMAGE_HEADER, UpdateRefusal};

const AREA: Geometry = Geometry {
    sectors: 2,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};
const KIND: ImageKind = ImageKind {
    boards: ["pico2"; 2],
    built_in: None,
};
/// Bytes of a seal: a word to know it by, one with the mark, counter, version, length, and the hash.
const SEAL: usize = 52;

/// A payload with its seal, marked.
fn sealed(version: u16, counter: u32, length: usize) -> Vec<u8> {
    let mut payload: Vec<u8> = (0..length).map(|n| (n * 3 + length) as u8).collect();
    payload[..4].copy_from_slice(b"seal");
    payload[4..8].copy_from_slice(&[1, 2, 3, 0x10]);
    payload[8..12].copy_from_slice(&counter.to_le_bytes());
    payload[12..16].copy_from_slice(&u32::from(version).to_le_bytes());
    payload[16..20].copy_from_slice(&(length as u32).to_le_bytes());
    let hash = hash(&payload);
    payload[20..SEAL].copy_from_slice(&hash);
    payload[7] |= TRIAL_MARK;
    payload
}

/// Of all but the mark and itself.
fn hash(payload: &[u8]) -> [u8; 32] {
    let mut start = payload[..20].to_vec();
    start[7] &= !TRIAL_MARK;
    let hash = Sha512::new().chain_update(start);
    let hash: [u8; 64] = hash.chain_update(&payload[SEAL..]).finalize().into();
    *hash.first_chunk().unwrap()
}

fn good(version: u16, counter: u32) -> Vec<u8> {
    let payload = sealed(version, counter, 600 + usize::from(version));
    signed(&maker(), "pico2", [1, version, 0], counter, payload)
}

/// What the ROM reads of a place: counter and version, marked, verified.
struct Seen {
    newness: (u32, u32),
    marked: bool,
    verified: bool,
}

fn see(place: &MockFlash) -> Option<Seen> {
    let payload = &place.data[IMAGE_HEADER..];
    let word = |at: usize| u32::from_le_bytes(*payload[at..].first_chunk().unwrap());
    payload.starts_with(b"seal").then(|| Seen {
        newness: (word(8), word(12)),
        marked: payload[7] & TRIAL_MARK != 0,
        verified: payload
            .get(..word(16) as usize)
            .is_some_and(|of| of.len() > SEAL && hash(of) == of[20..SEAL]),
    })
}

type Shared = Rc<RefCell<MockFlash>>;

/// An area that the firmware reads as signed, if it is an image's.
struct Area(Shared, bool);

impl Flash for Area {
    type Error = <MockFlash as Flash>::Error;

    fn geometry(&self) -> Geometry {
        AREA
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        self.0.borrow_mut().read(addr, into)?;
        if self.1 {
            as_signed(addr, into);
        }
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.borrow_mut().program(addr, bytes)
    }

    fn erase(&mut self, sector: u32) -> Result<(), Self::Error> {
        self.0.borrow_mut().erase(sector)
    }
}

/// What counts, and the places.
struct Board {
    areas: [Shared; 3],
    /// The restarts since the supply came.
    starts: u32,
}

/// The image that goes on, and what it was told of a trial before.
type Started = (Slots<Area>, Option<ImageVersion>);

/// What the ROM has in its memory for who buys: the image that is to be bought, and the place that loses its first sector then.
#[derive(Default)]
struct Buying {
    image: Option<Shared>,
    erased: Option<Shared>,
}

std::thread_local! {
    static BUYING: RefCell<Buying> = RefCell::default();
}

/// As the ROM does it: the first sector is erased and written again without the mark. Another place that it would prefer goes.
fn buy() -> Result<(), UpdateError> {
    #[repr(align(4))]
    struct Sector([u8; 4096]);

    BUYING.with_borrow_mut(|buying| {
        if let Some(image) = &buying.image {
            let mut image = image.borrow_mut();
            let mut sector = Sector([0; 4096]);
            image
                .read(0, &mut sector.0)
                .map_err(|_| UpdateError::Flash)?;
            sector.0[TRIAL_MARK_AT as usize] &= !TRIAL_MARK;
            image.erase(0).map_err(|_| UpdateError::Flash)?;
            for (at, page) in (0..).step_by(256).zip(sector.0.chunks(256)) {
                image.program(at, page).map_err(|_| UpdateError::Flash)?;
            }
        }
        if let Some(other) = &buying.erased {
            let erased = other.borrow_mut().erase(0);
            erased.map_err(|_| UpdateError::Flash)?;
        }
        *buying = Buying::default();
        Ok(())
    })
}

impl Board {
    /// As a new board is flashed: one image, which is not marked.
    fn new(first: &[u8]) -> Self {
        let board = Self {
            areas: [(); 3].map(|()| Rc::new(RefCell::new(MockFlash::new(AREA)))),
            starts: 0,
        };
        let mut a = board.areas[1].borrow_mut();
        a.data[..first.len()].copy_from_slice(first);
        a.data[TRIAL_MARK_AT as usize] &= !TRIAL_MARK;
        drop(a);
        board
    }

    /// The same moment once more.
    fn again(&self) -> Self {
        let areas = self.areas.each_ref();
        Self {
            areas: areas.map(|area| Rc::new(RefCell::new(area.borrow().clone()))),
            starts: 0,
        }
    }

    /// The image that the ROM starts, after a restart that has named a place.
    fn choose(&self, named: Option<ImagePlace>) -> Option<RomStart> {
        let [x, y] = [1, 2].map(|at| see(&self.areas[at].borrow()));
        let names = |place| named == Some(place);
        let is_right = |seen: &Option<Seen>| seen.as_ref().is_some_and(|of| of.verified);
        let newness = |seen: &Option<Seen>| seen.as_ref().map(|of| of.newness);
        let is_marked = |seen: &Option<Seen>| seen.as_ref().is_some_and(|of| of.marked);
        let y_is_newer = newness(&y) > newness(&x);
        let mut erased = None;
        let takes_y = if y.is_none() {
            false
        } else if x.is_some() && names(ImagePlace::A) && is_right(&x) {
            erased = y_is_newer.then(|| self.areas[2].clone());
            false
        } else {
            let asks = names(ImagePlace::A) && x.is_some()
                || names(ImagePlace::B)
                || is_marked(&x)
                || y_is_newer && !is_marked(&y)
                || !is_right(&x);
            let takes = asks && is_right(&y);
            if takes && names(ImagePlace::B) && !y_is_newer {
                erased = Some(self.areas[1].clone());
            }
            takes
        };
        let (place, seen) = match takes_y {
            true => (ImagePlace::B, y),
            false => (ImagePlace::A, x),
        };
        let seen = seen.filter(|of| of.verified)?;
        if !names(place) {
            erased = None;
            if seen.marked {
                return None;
            }
        }
        let area = usize::from(takes_y) + 1;
        BUYING.set(Buying {
            image: seen.marked.then(|| self.areas[area].clone()),
            erased,
        });
        Some(RomStart {
            place,
            to_be_bought: seen.marked,
        })
    }

    fn open(&self) -> Result<Slots<Area>, UpdateError> {
        let [state, a, b] = self.areas.each_ref().map(Rc::clone);
        let maker = Maker::Fixed(maker().verifying_key().to_bytes());
        let slots = [Area(a, true), Area(b, true)];
        Ok(Slots::open(Area(state, false), slots, KIND, maker)?.bought_by(buy))
    }

    /// A start to the image that goes on; none: nothing runs.
    fn start(&mut self) -> Result<Option<Started>, UpdateError> {
        let mut named = None;
        for _ in 0..4 {
            self.starts += 1;
            let Some(rom) = self.choose(named.take()) else {
                return Ok(None);
            };
            let mut slots = self.open()?;
            match slots.take_over(rom)? {
                Onwards::Runs { reverted } => return Ok(Some((slots, reverted))),
                Onwards::Try(place) => named = Some(place),
                Onwards::Restart => {}
                Onwards::Stop => return Ok(None),
            }
        }
        panic!("it restarts without end")
    }

    fn runs(&mut self) -> Slots<Area> {
        self.start().unwrap().expect("an image that runs").0
    }

    /// The version that runs, and where.
    fn version(&mut self) -> (u16, ImagePlace) {
        let info = self.runs().info();
        (info.version[1], info.place)
    }

    fn power_up(&self) {
        for area in &self.areas {
            area.borrow_mut().power_up();
        }
    }

    /// The operations on an area that this leads to.
    fn operations(&self, area: usize, goes_on: impl Fn(&mut Self)) -> Vec<Op> {
        let mut dry = self.again();
        dry.power_up();
        goes_on(&mut dry);
        let dry = dry.areas[area].borrow();
        dry.take_ops()
    }

    /// The power goes at this operation.
    fn cut(&self, area: usize, at: usize, way: Cut) -> Self {
        let board = self.again();
        board.power_up();
        let area = board.areas[area].borrow();
        area.cut_power_at(at, way, at as u64 + 1);
        drop(area);
        board
    }
}

/// From the first piece of an update to its confirmation.
fn update(board: &mut Board, image: &[u8]) -> Result<(), UpdateError> {
    let (mut slots, _) = board.start()?.ok_or(UpdateError::Flash)?;
    send(&mut slots, image)?;
    starts(board)
}

/// A start; what is on trial is confirmed.
fn starts(board: &mut Board) -> Result<(), UpdateError> {
    let (mut slots, _) = board.start()?.ok_or(UpdateError::Flash)?;
    slots.confirm().map(|_| ())
}

/// An update is tried by a restart that names it, bought, and starts by itself from then on; the next comes to the other
/// place. One that is never bought is gone at the next start, and that is told.
#[test]
fn an_update_is_tried_and_bought() {
    let mut board = Board::new(&good(1, 1));
    assert_eq!(board.version(), (1, ImagePlace::A));
    for (version, place) in [(2, ImagePlace::B), (3, ImagePlace::A), (4, ImagePlace::B)] {
        let mut slots = board.runs();
        send(&mut slots, &good(version, 1)).unwrap();
        board.starts = 0;
        let mut slots = board.runs();
        assert_eq!(
            board.starts, 2,
            "one that asks for the trial, and the trial"
        );
        assert_eq!(slots.trial(), Some(([1, version - 1, 0], [1, version, 0])));
        assert!(slots.confirm().unwrap().is_some());
        board.starts = 0;
        assert_eq!((board.version(), board.starts), ((version, place), 1));
    }
    let mut slots = board.runs();
    send(&mut slots, &good(5, 1)).unwrap();
    assert!(board.runs().trial().is_some());
    let (mut slots, reverted) = board.start().unwrap().unwrap();
    assert_eq!(reverted, Some([1, 5, 0]));
    assert_eq!(slots.info().version, [1, 4, 0]);
    assert_eq!(slots.info().latest, UpdateState::Reverted);
    // It may be tried again.
    send(&mut slots, &good(5, 1)).unwrap();
    starts(&mut board).unwrap();
    assert_eq!(board.version(), (5, ImagePlace::A));
}

/// The same version once more, from either place: the ROM would start the image before, and takes it away.
#[test]
fn the_same_version_takes_the_place_of_the_one_before() {
    let mut board = Board::new(&good(1, 1));
    update(&mut board, &good(2, 1)).unwrap();
    assert_eq!(board.version(), (2, ImagePlace::B));
    update(&mut board, &good(2, 1)).unwrap();
    assert_eq!(board.version(), (2, ImagePlace::A));
    update(&mut board, &good(2, 1)).unwrap();
    assert_eq!(board.version(), (2, ImagePlace::B));
}

/// Whatever the ROM has started: an older image does not run once a newer one counts, and none is taken that is older.
#[test]
fn an_older_image_does_not_run() {
    let mut board = Board::new(&good(3, 3));
    let mut slots = board.runs();
    for old in [good(2, 3), good(4, 2)] {
        assert_eq!(refused(send(&mut slots, &old)), UpdateRefusal::Rollback);
    }
    update(&mut board, &good(4, 4)).unwrap();
    assert_eq!(board.version(), (4, ImagePlace::B));
    let mut damaged = board.again();
    damaged.areas[2].borrow_mut().data[IMAGE_HEADER + 300] ^= 1;
    assert_eq!(damaged.choose(None).unwrap().place, ImagePlace::A);
    assert!(damaged.start().unwrap().is_none());
    // Where no newer one was confirmed, the one that is there runs.
    let mut first = Board::new(&good(3, 3));
    first.areas[2].borrow_mut().data[..700].copy_from_slice(&good(4, 4)[..700]);
    assert_eq!(first.version(), (3, ImagePlace::A));
}

/// A trial that no update here has asked for ends, and an image that is signed but whose seal is not the ROM's is told as
/// one that has failed.
#[test]
fn a_trial_that_nobody_asked_for_ends() {
    let mut board = Board::new(&good(1, 1));
    board.runs();
    let marked = good(2, 1);
    board.areas[2].borrow_mut().data[..marked.len()].copy_from_slice(&marked);
    let rom = board.choose(Some(ImagePlace::B)).unwrap();
    assert!(rom.to_be_bought && rom.place == ImagePlace::B);
    let onwards = board.open().unwrap().take_over(rom);
    assert_eq!(onwards, Ok(Onwards::Restart));
    assert_eq!(board.version(), (1, ImagePlace::A));

    let mut payload = sealed(3, 1, 700);
    payload[30] ^= 1;
    let mut slots = board.runs();
    send(
        &mut slots,
        &signed(&maker(), "pico2", [1, 3, 0], 1, payload),
    )
    .unwrap();
    let (mut slots, reverted) = board.start().unwrap().unwrap();
    assert_eq!(reverted, Some([1, 3, 0]));
    assert_eq!(slots.info().version, [1, 1, 0]);
}

/// Every bit of an image in its place but its mark is found when it takes over, marked or bought.
#[test]
fn every_bit_but_the_mark_is_found() {
    let board = Board::new(&good(1, 1));
    let rom = board.choose(None).unwrap();
    let len = good(1, 1).len();
    for bit in 0..len * 8 {
        let flip = |on: bool| {
            let mut area = board.areas[1].borrow_mut();
            area.data[bit / 8] ^= if on { 1 << (bit % 8) } else { 0 };
        };
        flip(true);
        let onwards = board.again().open().unwrap().take_over(rom).unwrap();
        flip(true);
        let is_mark = bit == TRIAL_MARK_AT as usize * 8 + 7;
        assert_eq!(
            matches!(onwards, Onwards::Runs { .. }),
            is_mark,
            "bit {bit}"
        );
    }
}

/// The power goes at every operation on any of the three areas, from the first piece of an update to its confirmation, the
/// ROM's own included, from either place and also to the same version; to a newer one from B and the same one from A once
/// more at every operation of the start behind that: what starts is whole, is the version before or the new one, and the
/// counter never goes back; and the update can be done again.
#[test]
fn a_power_cut_leaves_an_image_that_runs() {
    let mut in_b = Board::new(&good(1, 1));
    update(&mut in_b, &good(2, 1)).unwrap();
    let mut in_a = Board::new(&good(2, 1));
    in_a.runs();
    for (before, running) in [(in_b, 2), (in_a, 1)] {
        for (next, counter) in [(3, 5), (2, 1)] {
            // The ROM takes one of the same version away that it would start instead.
            let is_taken = running == 1 && next == 2;
            let ops = before.operations(running, |board| {
                update(board, &good(next, counter)).unwrap();
            });
            assert_eq!(ops.len(), usize::from(is_taken), "{ops:?}");
            let twice = is_taken || running == 2 && next == 3;
            cut_everywhere(&before, &good(next, counter), (next, counter), twice);
        }
    }
}

fn cut_everywhere(before: &Board, image: &[u8], next: (u16, u32), twice: bool) {
    let mut cuts = [0, 0];
    for area in 0..3 {
        let ops = before.operations(area, |board| update(board, image).unwrap());
        for (at, op) in ops.iter().enumerate() {
            for way in ways(op) {
                let mut board = before.cut(area, at, way);
                assert!(update(&mut board, image).is_err(), "{op:?} {way:?}");
                board.power_up();
                cuts[0] += 1;
                let again = match twice {
                    true => board.operations(0, |board| _ = starts(board)),
                    false => Vec::new(),
                };
                for (at, op) in again.iter().enumerate() {
                    for way in ways(op) {
                        let mut board = board.cut(0, at, way);
                        let _ = starts(&mut board);
                        board.power_up();
                        cuts[1] += 1;
                        is_one(&mut board, next);
                    }
                }
                is_one(&mut board, next);
                update(&mut board, image).unwrap();
                assert_eq!(board.version().0, next.0);
            }
        }
    }
    assert!(cuts[0] > 100 && (cuts[1] > 300 || !twice), "{cuts:?}");
}

/// However often it starts, what runs is the one before or the new one, whole.
fn is_one(board: &mut Board, next: (u16, u32)) {
    let mut counter = 0;
    for _ in 0..2 {
        let mut slots = board.runs();
        let info = slots.info();
        let either = [(2, 1), next];
        assert!(
            either.contains(&(info.version[1], info.counter)),
            "{info:?}"
        );
        assert!(slots.kept.counter >= counter, "the counter went back");
        counter = slots.kept.counter;
    }
}
