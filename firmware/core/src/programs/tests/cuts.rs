//! Power is cut at every operation that changes the flash, in every way. After each cut:
//! every program is there whole, the one at work as it was or as it was to become; the same
//! step then succeeds; and the next one does.

use std::collections::BTreeMap;
use std::vec::Vec;

use super::*;
use crate::journal::mock::{Cut, ERASE_CUTS, Op};

#[derive(Clone, Debug)]
enum Step {
    Put(u32, Vec<u8>),
    /// An upload that ends after so many bytes.
    Part(u32, Vec<u8>, usize),
    Delete(u32),
}

impl Step {
    fn random(random: &mut Random) -> Self {
        let number = 1 + random.below(3) as u32;
        let length = 1 + random.below(3000) as usize;
        let text = text(random.bits(), length);
        match random.below(6) {
            0 => Self::Delete(number),
            1 => Self::Part(number, text, random.below(length as u64) as usize),
            _ => Self::Put(number, text),
        }
    }

    /// Does it; a store without room or such a program has done nothing.
    fn run(&self, store: &mut Store<MockFlash>) -> Result<(), MockError> {
        let done = match self {
            Self::Put(number, text) => put(store, *number, text).map(drop),
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
            Err(Error::Flash(error)) => Err(error),
            Err(Error::Refused(ProgramRefusal::Full { .. } | ProgramRefusal::NotThere)) => Ok(()),
            Err(error) => panic!("{error:?}"),
        }
    }

    const fn number(&self) -> u32 {
        match self {
            Self::Put(number, _) | Self::Part(number, ..) | Self::Delete(number) => *number,
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

fn cut_everywhere(geometry: Geometry, torn_reads_zero: bool, seed: u64) {
    let mut random = Random(seed);
    let mut flash = MockFlash::new(geometry);
    flash.torn_reads_zero = torn_reads_zero;
    let mut store = Store::open(flash).unwrap();
    let (mut tried, mut olds, mut news, mut resumed) = (0, 0, 0, 0);
    for _ in 0..25 {
        let step = Step::random(&mut random);
        let before = content(&mut store);
        store.flash.take_ops();
        let mut whole = store.clone();
        step.run(&mut whole).unwrap();
        let ops = whole.flash.take_ops();
        let after = content(&mut whole);
        for (op, cut) in cuts(&ops, &mut random) {
            tried += 1;
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
                olds += 1;
            } else {
                assert_eq!(found, after, "{step:?} {op} {cut:?}");
                news += 1;
            }
            // Power stays: it succeeds, as does what comes next.
            let fresh = found == before && matches!(step, Step::Put(..));
            if let Step::Put(number, text) = &step
                && fresh
                && let Ok(at) = store.clone().begin(&info(*number, text))
            {
                resumed += u32::from(at > 0);
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
    // It was all there: both outcomes, and uploads that went on.
    assert!(tried > 1000 && olds > 100 && news > 20 && resumed > 20);
}

/// Room for three programs of any length, another upload, and one more.
const SECTORS: u16 = 4 * 4 + 4 + 4;

#[test]
fn serial_nor() {
    let geometry = Geometry {
        sectors: SECTORS,
        ..GEOMETRY
    };
    for seed in 0..3 {
        cut_everywhere(geometry, false, seed);
    }
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
    for seed in 0..3 {
        cut_everywhere(geometry, true, seed);
    }
}
