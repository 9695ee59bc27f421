//! Power is cut at every operation that changes the flash, in every way. After each cut:
//! every program is there whole, the one at work as it was or as it was to become; the same
//! step then succeeds; and the next one does.

use std::collections::BTreeMap;
use std::vec::Vec;

use super::punched::punch;
use super::*;
use crate::journal::mock::{Cut, ERASE_CUTS, Op};

#[derive(Clone, Debug)]
enum Step {
    Put(u32, Vec<u8>),
    /// An upload that ends after so many bytes.
    Part(u32, Vec<u8>, usize),
    /// A control punches, to the end or not.
    Punch(u32, Vec<u8>, bool),
    Delete(u32),
}

impl Step {
    fn random(random: &mut Random) -> Self {
        let number = 1 + random.below(4) as u32;
        let length = 1 + random.below(3000) as usize;
        let text = text(random.bits(), length);
        match random.below(9) {
            0 | 1 => Self::Delete(number),
            2 => Self::Part(number, text, random.below(length as u64) as usize),
            3..6 => Self::Punch(number, text, random.below(4) > 0),
            _ => Self::Put(number, text),
        }
    }

    /// Does it; a store without room or such a program has done nothing.
    fn run(&self, store: &mut Store<MockFlash>) -> Result<(), MockError> {
        let done = match self {
            Self::Put(number, text) => put(store, *number, text).map(drop),
            Self::Punch(number, text, true) => punch(store, *number, text).map(drop),
            Self::Punch(_, text, false) => store
                .begin_open()
                .and_then(|_| store.append(text))
                .map(|_| store.give_up_open()),
            Self::Delete(number) => store.delete(*number),
            Self::Part(number, text, length) => store.begin(&info(*number, text)).and_then(|at| {
                match text.get(at as usize..*length) {
                    Some(part) => store.piece(at, part).map(drop),
                    None => Ok(()),
                }
            }),
        };
        match done {
            Ok(()) => Ok(()),
            Err(StoreError::Flash(error)) => Err(error),
            Err(StoreError::Refused(
                ProgramRefusal::Full { .. }
                | ProgramRefusal::NotThere
                | ProgramRefusal::OtherThere { .. },
            )) => Ok(()),
            Err(error) => panic!("{error:?}"),
        }
    }

    const fn number(&self) -> u32 {
        match self {
            Self::Put(number, _)
            | Self::Part(number, ..)
            | Self::Punch(number, ..)
            | Self::Delete(number) => *number,
        }
    }
}

type Content = BTreeMap<u32, Vec<u8>>;

fn content(store: &mut Store<MockFlash>) -> Content {
    let numbers: Vec<u32> = store.programs().iter().map(|p| p.number).collect();
    numbers
        .into_iter()
        .map(|number| (number, get(store, number).unwrap()))
        .collect()
}

/// Every way in which power can go in these operations, thinned out within one program.
fn cuts(ops: &[Op], random: &mut Random) -> Vec<(usize, Cut)> {
    let mut cuts = Vec::new();
    for (index, op) in ops.iter().enumerate() {
        match *op {
            Op::Erase { .. } => cuts.extend(ERASE_CUTS.map(|cut| (index, cut))),
            Op::Program { len, .. } => {
                let inside = random.below(len as u64) as usize;
                for at in [0, 1, len / 2, len - 1, len, inside] {
                    cuts.push((index, Cut::AtByte(at)));
                }
                cuts.push((index, Cut::Unseen(inside)));
                cuts.push((index, Cut::Page(inside)));
            }
        }
    }
    cuts
}

/// How often what is to be tried was tried.
#[derive(Default)]
struct Tried {
    cuts: u32,
    olds: u32,
    news: u32,
    resumed: u32,
    punched: u32,
}

fn cut_everywhere(geometry: Geometry, torn_reads_zero: bool) {
    let mut tried = Tried::default();
    for seed in 0..3 {
        cut_everywhere_in(geometry, torn_reads_zero, seed, &mut tried);
    }
    // It was all there: both outcomes, uploads that went on, and programs that were punched.
    assert!(tried.cuts > 3000 && tried.olds > 300 && tried.news > 60);
    assert!(tried.resumed > 60 && tried.punched > 2);
}

fn cut_everywhere_in(geometry: Geometry, torn_reads_zero: bool, seed: u64, tried: &mut Tried) {
    let mut random = Random(seed);
    let mut flash = MockFlash::new(geometry);
    flash.torn_reads_zero = torn_reads_zero;
    let mut store = Store::open(flash).unwrap();
    for _ in 0..30 {
        let step = Step::random(&mut random);
        let before = content(&mut store);
        store.flash.take_ops();
        let mut whole = store.clone();
        step.run(&mut whole).unwrap();
        let ops = whole.flash.take_ops();
        let after = content(&mut whole);
        tried.punched += u32::from(matches!(step, Step::Punch(..)) && after != before);
        for (op, cut) in cuts(&ops, &mut random) {
            tried.cuts += 1;
            let mut store = store.clone();
            store.flash.cut_power_at(op, cut, random.bits());
            assert_eq!(step.run(&mut store), Err(MockError::PowerLost));
            let mut flash = store.into_flash();
            flash.power_up();
            let mut store = Store::open(flash).unwrap();
            let found = content(&mut store);
            let number = step.number();
            if found.get(&number) == before.get(&number) {
                assert_eq!(found, before, "{step:?} {op} {cut:?}");
                tried.olds += 1;
            } else {
                assert_eq!(found, after, "{step:?} {op} {cut:?}");
                tried.news += 1;
            }
            // Power stays: it succeeds, as does what comes next.
            let fresh = found == before && matches!(step, Step::Put(..));
            if let Step::Put(number, text) = &step
                && fresh
                && let Ok(at) = store.clone().begin(&info(*number, text))
            {
                tried.resumed += u32::from(at > 0);
            }
            step.run(&mut store).unwrap();
            assert_eq!(content(&mut store), after, "{step:?} {op} {cut:?}");
            let last = text(random.bits(), 700);
            put(&mut store, 9, &last).unwrap();
            let mut store = Store::open(store.into_flash()).unwrap();
            let mut with_last = after.clone();
            with_last.insert(9, last);
            assert_eq!(content(&mut store), with_last);
        }
        store = whole;
        // Now and then power goes between two steps.
        if random.below(4) == 0 {
            store = Store::open(store.into_flash()).unwrap();
            assert_eq!(content(&mut store), after);
        }
    }
}

/// Room for four programs of any length, another upload, and one more.
const SECTORS: u16 = 4 * 4 + 4 + 4 + 4;

#[test]
fn serial_nor() {
    let geometry = Geometry {
        sectors: SECTORS,
        ..GEOMETRY
    };
    cut_everywhere(geometry, false);
}

/// On-chip flash with error correction: a word of 32 bytes that was cut reads as zeros.
#[test]
fn error_correction() {
    let geometry = Geometry {
        sectors: SECTORS,
        sector_size: 1024,
        write_size: 32,
        page_size: 32,
    };
    cut_everywhere(geometry, true);
}
