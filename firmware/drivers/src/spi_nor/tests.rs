//! The driver against a model of the chip, and the journal on the driver.

use std::string::ToString as _;
use std::vec::Vec;

use embedded_hal::spi::ErrorKind;
use umi_core::journal::{ERASED, Flash, Journal, MAX_PAYLOAD};
use umi_core::units::Micros;

use super::model::Chip;
use super::{Area, FlashFault, SectorSize, Shared, SpiNor, Wanted};

type Nor = SpiNor<Chip, Chip>;

fn open(chip: &Chip) -> Result<Nor, FlashFault<ErrorKind>> {
    SpiNor::open(chip.clone(), chip.clone())
}

fn changed(change: impl FnOnce(&mut super::model::State)) -> Chip {
    let chip = Chip::new();
    chip.with(change);
    chip
}

const JOURNAL: Wanted = Wanted {
    sectors: 4,
    size: SectorSize::KiB64,
};
const SETTINGS: Wanted = Wanted {
    sectors: 3,
    size: SectorSize::KiB4,
};

fn areas(shared: &mut Shared<Chip, Chip>) -> [Area<'_, Chip, Chip>; 2] {
    shared.areas([SETTINGS, JOURNAL]).unwrap()
}

/// Who it is, how large, and its own number.
#[test]
fn identity() {
    let mut nor = open(&Chip::new()).unwrap();
    assert_eq!(nor.family().name, "Winbond W25Q");
    assert_eq!(nor.capacity_bytes(), 16 << 20);
    let id = [0xD2, 0x66, 0x14, 0x20, 0x5B, 0x3A, 0x11, 0x27];
    assert_eq!(nor.unique_id(), Ok(id));

    let small = changed(|state| state.id = [0xC8, 0x40, 0x14]);
    assert_eq!(open(&small).unwrap().capacity_bytes(), 1 << 20);
    let large = changed(|state| state.id = [0xEF, 0x70, 0x19]);
    assert_eq!(open(&large).unwrap().capacity_bytes(), 16 << 20);
    let asleep = changed(|state| state.asleep = true);
    assert!(open(&asleep).is_ok(), "it is woken");
}

/// What is wrong with a chip has a name, and nothing is written to it.
#[test]
fn refusals() {
    let fault = |chip: &Chip| open(chip).unwrap_err();
    assert_eq!(
        fault(&changed(|s| s.absent = Some(0xFF))),
        FlashFault::NoChip
    );
    assert_eq!(fault(&changed(|s| s.absent = Some(0))), FlashFault::NoChip);
    let id = [0xEF, 0x40, 0x03];
    let unknown = FlashFault::UnknownChip { id };
    assert_eq!(fault(&changed(|s| s.id = id)), unknown);
    let id = [0x01, 0x02, 0x18];
    let unknown = FlashFault::UnknownChip { id };
    assert_eq!(fault(&changed(|s| s.id = id)), unknown);
    assert!(unknown.to_string().contains("01 02 18"));
    let protected = FlashFault::Protected { status: 0x08 };
    assert_eq!(fault(&changed(|s| s.protection = 0x08)), protected);
    let bus = FlashFault::Bus(ErrorKind::ModeFault);
    assert_eq!(fault(&changed(|s| s.bus_fails = true)), bus);

    let nameless = changed(|state| state.unique_id = [0xFF; 8]);
    let mut nor = open(&nameless).unwrap();
    assert_eq!(nor.unique_id(), Err(FlashFault::NoUniqueId));
}

/// A reset of the processor has caught the chip in an erase: it is waited for.
#[test]
fn busy_at_start() {
    let chip = changed(|state| state.busy_for_us(1_500_000));
    assert!(open(&chip).is_ok());
    assert!(chip.with(|state| state.now_us()) >= 1_500_000);
}

/// Areas lie behind each other on boundaries of their sectors, and end where they end.
#[test]
fn areas_do_not_overlap() {
    let chip = Chip::new();
    let mut shared = Shared::new(open(&chip).unwrap());
    let [mut settings, mut journal] = areas(&mut shared);
    settings.program(3 * 4_096 - 4, b"last").unwrap();
    journal.program(0, b"first").unwrap();
    settings.erase(2).unwrap();
    journal.erase(3).unwrap();
    let done = chip.with(|state| state.done.clone());
    let expected = [
        (0x02, 0x00_2FFC),
        (0x02, 0x01_0000),
        (0x20, 0x00_2000),
        (0xD8, 0x04_0000),
    ];
    assert_eq!(done, expected);
    let mut byte = [0];
    assert_eq!(
        settings.read(3 * 4_096, &mut byte),
        Err(FlashFault::OutOfArea)
    );
    assert_eq!(
        settings.program(u32::MAX, &byte),
        Err(FlashFault::OutOfArea)
    );
    assert_eq!(settings.erase(3), Err(FlashFault::OutOfArea));
    assert_eq!(settings.erase(u32::MAX), Err(FlashFault::OutOfArea));

    let too_many = Wanted {
        sectors: 257,
        size: SectorSize::KiB64,
    };
    let fault = FlashFault::TooSmall {
        needed_bytes: 257 << 16,
        capacity_bytes: 16 << 20,
    };
    assert_eq!(shared.areas([too_many]).unwrap_err(), fault);
}

/// Without a chip there are areas all the same, which say why they hold nothing.
#[test]
fn a_missing_chip() {
    let fault = open(&changed(|state| state.absent = Some(0xFF))).unwrap_err();
    let mut shared = Shared::<Chip, Chip>::missing(fault);
    let [mut settings, journal] = areas(&mut shared);
    assert_eq!(settings.read(0, &mut [0]), Err(FlashFault::NoChip));
    assert_eq!(settings.erase(0), Err(FlashFault::NoChip));
    let opened = Journal::open(journal).map(|_| ());
    assert_eq!(
        opened,
        Err(umi_core::journal::JournalError::Flash(FlashFault::NoChip))
    );
}

/// A program over page ends is as many programs as it has pages.
#[test]
fn programs_do_not_wrap() {
    let chip = Chip::new();
    let mut shared = Shared::new(open(&chip).unwrap());
    let [_, mut journal] = areas(&mut shared);
    let bytes: Vec<u8> = (0..700).map(|n| n as u8).collect();
    journal.program(200, &bytes).unwrap();
    let mut back = std::vec![0; 1_100];
    journal.read(0, &mut back).unwrap();
    assert_eq!(back[200..900], bytes);
    assert!(back[..200].iter().chain(&back[900..]).all(|b| *b == ERASED));
    assert_eq!(chip.with(|state| state.done.len()), 4);
    assert_eq!(
        chip.with(|state| state.ignored),
        0,
        "never while it is busy"
    );
}

/// A chip that stops doing what it is told, after it was opened.
#[test]
fn failures_while_writing() {
    let write = |change: fn(&mut super::model::State)| {
        let chip = Chip::new();
        let mut shared = Shared::new(open(&chip).unwrap());
        let [mut settings, _] = areas(&mut shared);
        chip.with(change);
        let begin = chip.with(|state| state.now_us());
        let program = settings.program(0, b"x").unwrap_err();
        chip.power_up();
        chip.with(change);
        let erase = settings.erase(0).unwrap_err();
        let took = chip.with(|state| state.now_us()) - begin;
        assert!(took < 1_500_000, "no wait is without a bound: {took} us");
        (program, erase)
    };
    let busy = |waited_ms| FlashFault::Busy { waited_ms };
    assert_eq!(write(|s| s.stuck = true), (busy(10), busy(1_000)));
    let off = FlashFault::NotEnabled { status: 0 };
    assert_eq!(write(|s| s.never_enabled = true), (off, off));
    let torn_off = FlashFault::NotEnabled { status: 0xFF };
    assert_eq!(write(|s| s.absent = Some(0xFF)), (torn_off, torn_off));
    let protected = FlashFault::Protected { status: 0x3E };
    assert_eq!(write(|s| s.protection = 0x3C), (protected, protected));
    let bus = FlashFault::Bus(ErrorKind::ModeFault);
    assert_eq!(write(|s| s.bus_fails = true), (bus, bus));
}

/// The application's journal on the chip, with power cut in each program and each
/// erase: what was acknowledged is there when power comes again, and the journal
/// goes on.
#[test]
fn journal_over_power_cuts() {
    let payload = |seq: u64| std::vec![seq as u8; 40 + (seq % 300) as usize];
    let fill = |journal: &mut Journal<Area<'_, Chip, Chip>>, to: u64| {
        for seq in journal.next_seq()..to {
            match journal.append(1, Micros(seq), &payload(seq)) {
                Ok(acknowledged) => assert_eq!(acknowledged, seq),
                Err(_) => return,
            }
        }
    };
    let small = Wanted {
        sectors: 3,
        size: SectorSize::KiB4,
    };
    for cut in 0..70 {
        let chip = Chip::new();
        let mut shared = Shared::new(open(&chip).unwrap());
        let [flash] = shared.areas([small]).unwrap();
        let (mut journal, _) = Journal::open(flash).unwrap();
        chip.with(|state| state.cut_at = Some(cut));
        fill(&mut journal, 200);
        let acknowledged = journal.next_seq();
        assert!(chip.with(|state| state.absent.is_some()), "power was cut");

        chip.power_up();
        let mut shared = Shared::new(open(&chip).unwrap());
        let [flash] = shared.areas([small]).unwrap();
        let (mut journal, _) = Journal::open(flash).unwrap();
        assert!(journal.next_seq() >= acknowledged, "cut {cut}");
        fill(&mut journal, acknowledged + 20);
        assert_eq!(journal.next_seq(), acknowledged + 20);
        let mut buffer = [0; MAX_PAYLOAD];
        for seq in journal.first_seq()..journal.next_seq() {
            let read = journal.read(seq, &mut buffer).unwrap();
            assert_eq!(read.entry.payload, payload(seq), "cut {cut}");
        }
        journal
            .verify(journal.first_seq(), journal.next_seq())
            .unwrap();
    }
}

/// Every fault has a name for machines and a sentence for people.
#[test]
fn faults_have_names() {
    let faults: [FlashFault<ErrorKind>; 10] = [
        FlashFault::Bus(ErrorKind::Other),
        FlashFault::NoChip,
        FlashFault::UnknownChip { id: [1, 2, 3] },
        FlashFault::NoUniqueId,
        FlashFault::Protected { status: 4 },
        FlashFault::NotEnabled { status: 0 },
        FlashFault::Busy { waited_ms: 10 },
        FlashFault::TooSmall {
            needed_bytes: 2,
            capacity_bytes: 1,
        },
        FlashFault::OutOfArea,
        FlashFault::InUse,
    ];
    let mut codes: Vec<&str> = faults.iter().map(FlashFault::code).collect();
    codes.sort_unstable();
    codes.dedup();
    assert_eq!(codes.len(), faults.len());
    assert!(faults.iter().all(|fault| fault.to_string().len() > 20));
}
