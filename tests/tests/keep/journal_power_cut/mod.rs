//! Power is cut at every operation that changes the journal's flash, at every
//! byte of every program, in every way an erase can stop, and again in what
//! follows. What must hold after each: all that was acknowledged is there and
//! identical, numbers have no gap, the chain holds, the entry that was being
//! appended is there as a whole or not at all, and the journal goes on.

use umi_core::journal::{ERASED, Flash, Geometry, Journal};

mod bench;
// The mock takes its imports from the module above it, here as beside the journal.
#[path = "../../../../firmware/core/src/journal/mock.rs"]
#[allow(dead_code, reason = "the unit tests beside the journal use the rest")]
mod mock;

use bench::{Bench, CutAt, Figures, Model, Record, Step};
use mock::{MockFlash, Random};

/// How much to do.
struct Workload {
    geometry: Geometry,
    torn_reads_zero: bool,
    /// Longest payload; the journal's own limit if that is less.
    max_payload: usize,
    steps: usize,
    /// Power is cut again everywhere in the append behind each so manieth cut.
    second_every: u64,
}

/// Runs a random workload and cuts power everywhere in it.
fn cut_everywhere(work: &Workload, seed: u64) -> Figures {
    let mut random = Random(seed);
    let mut figures = Figures::default();
    let geometry = work.geometry;
    let mut flash = MockFlash::new(geometry);
    flash.torn_reads_zero = work.torn_reads_zero;
    let (journal, _) = Journal::open(flash).unwrap();
    let max = journal.max_payload().min(work.max_payload);
    let mut bench = Bench {
        journal,
        model: Model::new(),
        just_opened: true,
        unseen_is_excused: false,
    };
    for _ in 0..work.steps {
        let step = match random.below(10) {
            0 => Step::Prepare(random.below(u64::from(geometry.sector_size)) as u32),
            _ => Step::Append(Record::random(&mut random, max)),
        };
        let before = bench.clone();
        let ops = bench.run(&step);
        figures.operations += ops.len() as u64;
        let first_after = bench.journal.first_seq();
        for at in CutAt::all(&ops, geometry, &mut random) {
            figures.cuts += 1;
            let after = before.cut(&step, &at, first_after, &mut figures);
            let records = [(); 2].map(|()| Record::random(&mut random, max));
            if figures.cuts.is_multiple_of(work.second_every) {
                let step = Step::Append(records[0].clone());
                let mut whole = after.clone();
                let ops = whole.run(&step);
                let first_after = whole.journal.first_seq();
                for at in CutAt::all(&ops, geometry, &mut random) {
                    figures.second_cuts += 1;
                    let after = after.cut(&step, &at, first_after, &mut figures);
                    after.goes_on(&records, &mut figures);
                }
            }
            after.goes_on(&records, &mut figures);
        }
        // Now and then power goes between two steps.
        if random.below(8) == 0 {
            let (journal, recovery) = Journal::open(bench.journal.into_flash()).unwrap();
            assert!(recovery.is_clean());
            bench.journal = journal;
            bench.just_opened = true;
            bench.model.check(&mut bench.journal);
        }
    }
    bench.model.check(&mut bench.journal);
    figures.entries = bench.model.next_seq();
    figures.erases = bench
        .journal
        .flash()
        .erases
        .iter()
        .map(|n| u64::from(*n))
        .sum();
    println!("{geometry:?}: {figures:?}");

    // It was all there: laps, both outcomes of a cut append, both reports.
    assert!(figures.erases > u64::from(geometry.sectors), "not one lap");
    assert!(figures.pending_kept > 0 && figures.torn_reported > 0);
    assert!(figures.unfinished_reported > 0 && figures.second_cuts > 0);
    figures
}

/// Serial NOR: bytes, in pages of 256 that are programmed as a whole.
const SERIAL_NOR: Workload = Workload {
    geometry: Geometry {
        sectors: 2,
        sector_size: 1024,
        write_size: 1,
        page_size: 256,
    },
    torn_reads_zero: false,
    max_payload: 120,
    steps: 32,
    second_every: 300,
};

/// Two sectors, the fewest there can be; words of four bytes.
const TWO_SECTORS: Workload = Workload {
    geometry: Geometry {
        sectors: 2,
        sector_size: 512,
        write_size: 4,
        page_size: 4,
    },
    torn_reads_zero: false,
    max_payload: 100,
    steps: 30,
    second_every: 200,
};

/// Double words with error correction, as on STM32L4 and G4.
const DOUBLE_WORDS: Workload = Workload {
    geometry: Geometry {
        sectors: 4,
        sector_size: 512,
        write_size: 8,
        page_size: 8,
    },
    torn_reads_zero: true,
    max_payload: 60,
    steps: 40,
    second_every: 150,
};

/// Words of 32 bytes with error correction, as on STM32H7.
const FLASH_WORDS: Workload = Workload {
    geometry: Geometry {
        sectors: 2,
        sector_size: 1024,
        write_size: 32,
        page_size: 32,
    },
    torn_reads_zero: true,
    max_payload: 120,
    steps: 40,
    second_every: 200,
};

/// Sectors as on the board, with room to go on behind a torn entry, and entries
/// of any length, which take several programs.
const LARGE_SECTORS: Workload = Workload {
    geometry: Geometry {
        sectors: 2,
        sector_size: 4096,
        write_size: 32,
        page_size: 256,
    },
    torn_reads_zero: false,
    max_payload: 700,
    steps: 25,
    second_every: 4000,
};

#[test]
fn serial_nor() {
    cut_everywhere(&SERIAL_NOR, 1);
}

#[test]
fn two_sectors() {
    cut_everywhere(&TWO_SECTORS, 2);
}

#[test]
fn double_words() {
    cut_everywhere(&DOUBLE_WORDS, 3);
}

#[test]
fn flash_words() {
    cut_everywhere(&FLASH_WORDS, 4);
}

#[test]
fn large_sectors() {
    cut_everywhere(&LARGE_SECTORS, 5);
}

/// All of it at length, some millions of cuts: `cargo test --release -p umi-tests
/// --test keep -- --ignored --nocapture`.
#[test]
#[ignore = "minutes in a release build; a nightly run"]
fn millions_of_cuts() {
    let mut cuts = 0;
    for seed in 10..20 {
        for work in [
            SERIAL_NOR,
            TWO_SECTORS,
            DOUBLE_WORDS,
            FLASH_WORDS,
            LARGE_SECTORS,
        ] {
            let (steps, second_every) = (200, work.second_every / 10);
            let work = Workload {
                steps,
                second_every,
                ..work
            };
            let figures = cut_everywhere(&work, seed);
            cuts += figures.cuts + figures.second_cuts;
        }
    }
    println!("{cuts} cuts");
    assert!(cuts > 1_000_000);
}
