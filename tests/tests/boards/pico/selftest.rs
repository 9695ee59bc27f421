//! The self-test of the Pico passes on the emulated board, and each fault that is put into the
//! chip behind its back fails the row that is about it.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::{self, Transport};
use umi_client::board::selftest::{self, SelfTest};
use umi_tests::rig::pico::{Emulator, Start};
use umi_tests::rig::{image, skip_without};

/// A row of a slow machine.
const PATIENCE: Duration = Duration::from_secs(120);
/// Short, as fifteen of them are made; a bench makes 10 000 restarts and 40 edges.
const ASKED: (u32, u32) = (20, 8);

/// The board with its host, after its panic and its fault.
struct Bench {
    emulator: Emulator,
    port: Box<dyn Transport>,
}

impl Bench {
    fn start() -> Option<Self> {
        Self::start_with(|_| {})
    }

    /// `before` is done to the board before its first start.
    fn start_with(before: impl FnOnce(&mut Emulator)) -> Option<Self> {
        let image = image("UMI_PICO_SELFTEST", "pico-selftest.elf");
        let mut emulator =
            skip_without(image.and_then(|image| Emulator::start_image(&image, Start::Paused)))?;
        before(&mut emulator);
        emulator.ask(&json!({ "do": "free", "speed": 0 }));
        emulator.ask(&json!({ "do": "usb", "plugged": true }));
        let begun = Instant::now();
        while !emulator.state().is_configured {
            assert!(begun.elapsed() < PATIENCE, "{:?}", emulator.state());
            thread::sleep(Duration::from_millis(20));
        }
        let port = link::open(&emulator.host_address()).unwrap();
        Some(Self { emulator, port })
    }

    fn test(&mut self) -> SelfTest {
        let (table, whole) = selftest::run(self.port.as_mut(), ASKED, PATIENCE, |_| {});
        whole.unwrap();
        table
    }

    /// Puts another word into a register while the test runs, and the old one back.
    fn test_with(&mut self, fault: &Fault) -> SelfTest {
        let [before] = self.emulator.memory(fault.address, 1)[..] else {
            panic!("no register at {:#x}", fault.address)
        };
        self.emulator
            .set_memory(fault.address, before & !fault.mask | fault.bits);
        let table = self.test();
        self.emulator.set_memory(fault.address, before);
        table
    }
}

/// A register that is wrong, and the row that must fail by it.
struct Fault {
    what: &'static str,
    address: u32,
    mask: u32,
    bits: u32,
    row: &'static str,
}

/// The control register of a pin (RP2040 data sheet, 2.19.6.1), and its input's override: 1 turns it
/// round, 2 holds it low, 3 high.
const fn input(what: &'static str, pin: u32, over: u32, row: &'static str) -> Fault {
    Fault {
        what,
        address: 0x4001_4004 + 8 * pin,
        mask: 3 << 16,
        bits: over << 16,
        row,
    }
}

/// A register of a state machine (3.7), 0x18 bytes apart.
const fn machine(
    what: &'static str,
    (pio, number): (u32, u32),
    register: u32,
    (mask, bits): (u32, u32),
    row: &'static str,
) -> Fault {
    Fault {
        what,
        address: 0x5020_0000 + 0x10_0000 * pio + 0x18 * number + register,
        mask,
        bits,
        row,
    }
}

const DIVIDER: u32 = 0xC8;
const PINS: u32 = 0xDC;
const HALF_SPEED: (u32, u32) = (0xFFFF_FF00, 2 << 16);

/// What the UART's clock comes from (2.15.7): 2 is the USB's, 48 MHz.
const UART_CLOCK: Fault = Fault {
    what: "the UART's clock is another",
    address: 0x4000_8048,
    mask: 7 << 5,
    bits: 2 << 5,
    row: "their time at 115200 baud",
};

fn faults() -> [Fault; 11] {
    [
        UART_CLOCK,
        input("A of axis 1 is stuck low", 8, 2, "position of axis 1"),
        input("B of axis 2 is stuck high", 11, 3, "position of axis 2"),
        input("A of axis 3 is turned round", 12, 1, "position of axis 3"),
        machine(
            "axis 4 looks at the pins of axis 1",
            (0, 3),
            PINS,
            (0x1F << 15, 8 << 15),
            "position of axis 4",
        ),
        input("skip is stuck low", 16, 2, "skip edges captured"),
        input("trigger is stuck high", 17, 3, "triggers captured"),
        input("an index is stuck low", 19, 2, "index marks captured"),
        input(
            "the output is not seen",
            22,
            2,
            "trigger pulses sent and told",
        ),
        machine(
            "the pulses' clock is half as fast",
            (1, 3),
            DIVIDER,
            HALF_SPEED,
            "their width of 20 us",
        ),
        machine(
            "the stamps' clock of triggers is half as fast",
            (1, 1),
            DIVIDER,
            HALF_SPEED,
            "triggers captured",
        ),
    ]
}

/// All rows pass on the board as it is.
#[test]
fn all_is_as_promised() {
    let Some(mut bench) = Bench::start() else {
        return;
    };
    let table = bench.test();
    let failed: Vec<_> = table.failed().collect();
    assert!(failed.is_empty(), "{failed:?}");
    for row in &table.rows {
        println!(
            "{}: {} of {} {}",
            row.name, row.measured, row.promised, row.unit
        );
    }
    assert_eq!((table.board.as_str(), table.rows.len()), ("pico", 36));
    // Each restart aborts the channels of four rings, of which one each is at work. The emulated DMA has the chips' errata: what is enabled or
    // chained when it is aborted starts again (RP2350 E5), and an abort reads as done before it is
    // (RP2040 E13). None did, and nobody started a channel before its abort was over.
    let aborts = bench.emulator.state().json["dma_aborts"].clone();
    let [asked, again, early] = ["asked", "again", "early"].map(|of| aborts[of].as_u64().unwrap());
    assert!(asked >= 4 * u64::from(ASKED.0), "{aborts}");
    assert_eq!((again, early), (0, 0), "{aborts}");
}

/// Starts before the one that overflows its stack: those that panic and fault.
const BEFORE_OVERFLOW: usize = 2;
/// Between two looks, cycles: a start takes many of them.
const LOOK_CYCLES: u64 = 2_000;

/// A core that stops where what it saves has no memory never comes to the handler of faults: the watchdog starts the board
/// anew, and the rows of the overflow fail, no others.
#[test]
fn a_core_that_stops_at_an_overflow_is_found() {
    let stops = |emulator: &mut Emulator| {
        let begun = Instant::now();
        while emulator.state().resets < BEFORE_OVERFLOW {
            assert!(begun.elapsed() < PATIENCE, "it does not start anew");
            emulator.run(LOOK_CYCLES);
        }
        emulator.ask(&json!({ "do": "no_stack", "stops": true }));
    };
    let Some(mut bench) = Bench::start_with(stops) else {
        return;
    };
    let resets = bench.emulator.state().json["resets"].clone();
    assert_eq!(resets[2]["why"], "watchdog timer", "{resets}");
    let table = bench.test();
    let failed: Vec<&str> = table.failed().map(|row| row.name.as_str()).collect();
    assert_eq!(
        failed,
        ["stack overflow noted", "laser and lamps low behind them"]
    );
}

/// Each of thirteen faults fails its row; without them the board passes again.
#[test]
fn every_fault_is_found() {
    let Some(mut bench) = Bench::start() else {
        return;
    };
    for fault in faults() {
        let table = bench.test_with(&fault);
        let failed: Vec<&str> = table.failed().map(|row| row.name.as_str()).collect();
        assert!(failed.contains(&fault.row), "{}: {failed:?}", fault.what);
    }
    // A flash that is slow, where words come one by one and where lines come whole.
    for (words, slow) in [(true, 60), (false, 120)] {
        let slow = json!({ "do": "cache", "words": words, "line_cycles": slow });
        bench.emulator.ask(&slow);
        let table = bench.test();
        bench
            .emulator
            .ask(&json!({ "do": "cache", "words": words }));
        let failed: Vec<&str> = table.failed().map(|row| row.name.as_str()).collect();
        assert!(failed.contains(&"a line that is not"), "{slow}: {failed:?}");
    }
    // What the last fault has left is over after one more.
    let _ = bench.test();
    let failed: Vec<_> = bench.test().failed().cloned().collect();
    assert!(
        failed.is_empty(),
        "after the faults, with whole lines: {failed:?}"
    );
}
