//! The cache of the flash that the Pico's code runs from, at the load that is hardest for it: four
//! axes at a million counts a second, triggers at 10 kHz, and a line that is full.
//!
//! What the highest interrupts run is in RAM (`firmware/boards/pico/link/ram-code.x`): from the flash they
//! took 102 us, a byte waited for 100, and three of 2400 were lost.

use serde_json::json;
use umi_tests::rig::Rig as _;
use umi_tests::rig::pico::{CYCLES_PER_US, EmulatedPulses, PicoRig, TRIGGER_PIN};

const CYCLES_PER_MS: u64 = 1_000 * CYCLES_PER_US;
/// A millisecond holds 11.5 characters.
const BYTES: usize = 1_100;
const LASTS: u64 = 100 * CYCLES_PER_MS;
const CAPTURE_INTERRUPT: u64 = 9;
/// The DMA's, which brings what the control's line has brought.
const LINE_INTERRUPT: u64 = 11;
/// Until a ring's samples are written over, less what a capture takes.
const CAPTURE_CYCLES: u64 = 75 * CYCLES_PER_US;
/// What the control's characters wait at most, as the README promises; one takes 87 us.
const BYTE_CYCLES: u64 = 85 * CYCLES_PER_US;

/// A miss fetches one word of a line, so that code which is run through costs more: the dearer assumption, by which all figures of
/// the board's README are measured.
#[test]
fn no_byte_and_no_capture_is_lost_where_words_come_one_by_one() {
    nothing_is_lost(true, 44);
}

/// A miss fetches a whole line.
#[test]
fn no_byte_and_no_capture_is_lost_where_lines_come_whole() {
    nothing_is_lost(false, 56);
}

fn nothing_is_lost(words: bool, cycles: u32) {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    rig.emulator()
        .ask(&json!({ "do": "cache", "words": words }));
    let mut client = rig.client();
    client.live(true).unwrap();
    rig.move_all(LASTS, 125.0);
    rig.emulator().pulses(&EmulatedPulses {
        pin: TRIGGER_PIN,
        count: LASTS / (100 * CYCLES_PER_US),
        period: 100 * CYCLES_PER_US,
        width: 10 * CYCLES_PER_US,
        ..EmulatedPulses::default()
    });
    rig.emulator().interrupts();
    rig.emulator().ask(&json!({ "do": "cache" }));
    let line = b"N0123456789 X-012.3456 Y0987.6543 Z-1.0000\r\n";
    let text: Vec<u8> = line.iter().copied().cycle().take(BYTES).collect();
    rig.control_sends(&text);
    let now = rig.emulator().state().cycle;
    rig.wait_for_cycle(now + LASTS + 20 * CYCLES_PER_MS);
    let cache = rig.emulator().ask(&json!({ "do": "cache" }));
    assert_eq!(cache["line_cycles"], cycles, "the cache is modelled");
    assert!(cache["misses"].as_u64().unwrap() > 1_000, "{cache}");
    for times in rig.emulator().interrupts() {
        let (wait, run) = (times.wait_cycles, times.run_cycles);
        println!(
            "interrupt {}: waits {wait} and runs {run} cycles, {} both",
            times.number, times.whole_cycles
        );
        match times.number {
            CAPTURE_INTERRUPT => assert!(times.whole_cycles <= CAPTURE_CYCLES, "{times:?}"),
            LINE_INTERRUPT => assert!(wait <= BYTE_CYCLES, "{times:?}"),
            _ => {}
        }
    }
    let status = client.status().unwrap();
    let state = rig.emulator().state();
    assert_eq!((state.overruns, state.control_waiting), (0, 0));
    assert_eq!((status.counters.bytes_lost, status.latches.missed), (0, 0));
}
