//! The watchdog of the Pico: which levels of priority must be heard, on the board's image.
//!
//! After how long each is given up, and that a fit of two minutes is not, is held on the host:
//! `umi_drivers::heard`.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::{Client, Patience};
use umi_protocol::message::ResetReason;
use umi_tests::rig::{PicoRig, Rig};

/// The watchdog's counter (RP2040 datasheet, 4.7.6): two counts a microsecond.
const WATCHDOG_LOAD: u32 = 0x4005_8004;
/// Switches interrupts off (Armv6-M manual, B3.4.4).
const INTERRUPTS_OFF: u32 = 0xE000_E180;
/// The interrupt in which the host's tasks run.
const HOST_TASKS: u32 = 27;
/// What of the counter's eight seconds is left when they are cut short: many times longer than
/// it takes until the counter is fed again.
const LEFT: Duration = Duration::from_millis(20);
/// Nothing takes so long on the wall.
const HANGS: Duration = Duration::from_secs(600);

fn client(rig: &mut PicoRig) -> Client {
    let answer = Duration::from_secs(2) * rig.slowness();
    Client::with_patience(rig.connect(), Patience { answer, tries: 3 }).unwrap()
}

fn pass(rig: &mut PicoRig, time: Duration) {
    let (end, begun) = (rig.time() + time, Instant::now());
    while rig.time() < end {
        assert!(begun.elapsed() < HANGS, "the board's time stands still");
        thread::sleep(Duration::from_millis(1));
    }
}

/// Cuts the counter short and lets it run out, if nobody feeds it. Whether it has.
fn is_starved(rig: &mut PicoRig) -> bool {
    let counts = u32::try_from(2 * LEFT.as_micros()).unwrap();
    rig.emulator().set_memory(WATCHDOG_LOAD, counts);
    pass(rig, 2 * LEFT);
    rig.emulator().state().resets == 1
}

/// The host's tasks do not run any more, while everything else does, the measuring too: a
/// little more than eight seconds later nobody feeds the watchdog.
#[test]
fn the_host_level_must_be_heard() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut host = client(&mut rig);
    assert_eq!(host.status().unwrap().reset, ResetReason::PowerOn);
    assert!(!is_starved(&mut rig), "it is fed");
    rig.emulator().set_memory(INTERRUPTS_OFF, 1 << HOST_TASKS);
    // Within the patience with a long write it is fed.
    pass(&mut rig, Duration::from_millis(7_000));
    assert!(!is_starved(&mut rig), "a long write would be cut off");
    pass(&mut rig, Duration::from_millis(1_300));
    assert_eq!(rig.emulator().state().resets, 0, "the counter runs on");
    assert!(is_starved(&mut rig), "it is still fed");
    let state = rig.emulator().state();
    assert_eq!(state.json["resets"][0]["why"], json!("watchdog timer"));
    drop(host);
    let mut host = client(&mut rig);
    assert_eq!(host.status().unwrap().reset, ResetReason::Watchdog);
}
