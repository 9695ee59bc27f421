//! What happens on the Pico when its stack overflows.
//!
//! That it never does is `cargo xtask size`'s to show, which works out the worst stack from
//! the code; how much a session needs is in the conformance suite.

use std::thread;
use std::time::{Duration, Instant};

use umi_client::board::link::{Client, Patience};
use umi_protocol::job::Job;
use umi_protocol::message::ResetReason;
use umi_tests::cases::SESSION;
use umi_tests::rig::{PicoRig, Rig};

/// The watchdog's counter (RP2040 datasheet, 4.7.6).
const WATCHDOG_LOAD: u32 = 0x4005_8004;
/// Enough for an idle board's interrupts, and not for bytes of the control.
const LEFT_BYTES: u32 = 3000;
/// Nothing takes so long on the wall.
const HANGS: Duration = Duration::from_secs(600);

fn client(rig: &mut PicoRig) -> Client {
    let answer = Duration::from_secs(2) * rig.slowness();
    Client::with_patience(rig.connect(), Patience { answer, tries: 3 }).unwrap()
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < HANGS, "{what} takes too long");
        thread::sleep(Duration::from_millis(1));
    }
}

/// The stack lies at the bottom of the memory: what overflows it writes where there is none.
/// Not a variable changes: the core stops, the watchdog starts the board anew, the board says
/// so, and has the job that it had.
#[test]
fn an_overflow_stops_the_core_and_the_watchdog_restarts_it() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut host = client(&mut rig);
    let job: Job =
        toml::from_str(include_str!("../../../../../examples/three-spheres.toml")).unwrap();
    host.set_job(&job).unwrap().unwrap();
    assert_eq!(host.status().unwrap().reset, ResetReason::PowerOn);

    until("a moment of rest", || rig.emulator().sink_stack(LEFT_BYTES));
    // The captures' interrupts have room enough.
    let begun = rig.time();
    until("a wait", || rig.time() > begun + Duration::from_millis(20));
    assert_eq!(rig.emulator().state().fault, None);

    rig.control_sends(SESSION.as_bytes());
    until("an overflow", || rig.emulator().state().fault.is_some());
    let fault = rig.emulator().state().fault.unwrap_or_default();
    assert!(fault.contains(": 1fff"), "{fault}");
    // Nothing runs any more, not even the handler of faults; the watchdog's eight seconds are
    // cut short.
    assert_eq!(rig.emulator().state().resets, 0);
    rig.emulator().set_memory(WATCHDOG_LOAD, 1000);
    until("the watchdog", || rig.emulator().state().resets == 1);
    assert_eq!(
        rig.emulator().state().json["resets"][0]["why"],
        "watchdog timer"
    );

    drop(host);
    let mut host = client(&mut rig);
    assert_eq!(host.status().unwrap().reset, ResetReason::Watchdog);
    assert_eq!(host.job().unwrap().job, Some(job));
    assert_eq!(rig.emulator().state().fault, None);
}
