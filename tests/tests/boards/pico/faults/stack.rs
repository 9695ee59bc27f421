//! What happens on the Pico when its stack overflows.
//!
//! That it never does is `cargo xtask size`'s to show, which works out the worst stack from
//! the code; how much a session needs is in the conformance suite.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::{Client, Patience};
use umi_protocol::job::Job;
use umi_protocol::message::ResetReason;
use umi_tests::cases::SESSION;
use umi_tests::rig::{PicoRig, Rig};

use super::LASER_PIN;

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

/// From an overflow to laser and lamps off, cycles: 8 us, as of any other fault.
const DARK_CYCLES: u64 = 1_000;
/// After how long a core that has stopped is started anew: the watchdog's counter, and the way to it.
const STOPPED: Duration = Duration::from_millis(1_001);
const CYCLES_PER_US: u64 = 125;

fn job() -> Job {
    toml::from_str(include_str!("../../../../../examples/three-spheres.toml")).unwrap()
}

/// A board whose laser is on, at rest, with nearly no stack left.
fn on_the_brink() -> Option<(PicoRig, Client)> {
    let mut rig = PicoRig::start_or_skip()?;
    let mut host = client(&mut rig);
    host.set_job(&job()).unwrap().unwrap();
    assert_eq!(host.status().unwrap().reset, ResetReason::PowerOn);
    assert!(host.laser(true).unwrap());
    until("the laser", || rig.laser_is_on());
    // What a new job is kept by, in two sectors, is written first: that needs more stack.
    let begun = rig.time();
    until("the writing", || {
        rig.time() > begun + Duration::from_secs(2)
    });
    until("a moment of rest", || rig.emulator().sink_stack(LEFT_BYTES));
    // The captures' interrupts have room enough.
    let begun = rig.time();
    until("a wait", || rig.time() > begun + Duration::from_millis(20));
    assert_eq!(rig.emulator().state().fault, None);
    assert_eq!(rig.emulator().state().resets, 0);
    assert!(rig.laser_is_on());
    rig.emulator().outputs();
    Some((rig, host))
}

/// The stack lies at the bottom of the memory: what overflows it writes where there is none.
/// The handler of faults has a stack of its own: laser and lamps go off at once, not a variable
/// changes, the board starts anew, says so, and has the job that it had.
#[test]
fn an_overflow_puts_the_laser_out_and_restarts_the_board() {
    let Some((mut rig, host)) = on_the_brink() else {
        return;
    };
    rig.control_sends(SESSION.as_bytes());
    until("a new start", || rig.emulator().state().resets == 1);
    let state = rig.emulator().state();
    let reset = &state.json["resets"][0];
    let fault = reset["fault"].as_str().unwrap();
    assert!(fault.contains(": 1fff"), "{fault}");
    let at = reset["fault_cycle"].as_u64().unwrap();
    let outputs = rig.emulator().outputs();
    let off = outputs.iter().find(|of| of.pin == LASER_PIN && !of.level);
    let off = off.expect("it has been switched off").cycle - at;
    println!("laser off {off} cycles after the overflow");
    assert!(off <= DARK_CYCLES, "{off}");

    drop(host);
    let mut host = client(&mut rig);
    assert_eq!(host.status().unwrap().reset, ResetReason::Panic);
    assert_eq!(host.job().unwrap().job, Some(job()));
    assert!(!rig.laser_is_on());
    assert_eq!(rig.emulator().state().fault, None);
}

/// If the chip's core stops where there is no memory for what it saves, nothing runs any more, not
/// even the handler of faults: the laser is off when the watchdog's counter is over, a second later.
#[test]
fn a_core_that_stops_is_restarted_by_the_watchdog() {
    let Some((mut rig, host)) = on_the_brink() else {
        return;
    };
    rig.emulator()
        .ask(&json!({ "do": "no_stack", "stops": true }));
    rig.control_sends(SESSION.as_bytes());
    until("the watchdog", || rig.emulator().state().resets == 1);
    let state = rig.emulator().state();
    let reset = &state.json["resets"][0];
    assert_eq!(reset["why"], "watchdog timer");
    let cycle = |of: &str| reset[of].as_u64().unwrap();
    let took = Duration::from_micros((cycle("cycle") - cycle("fault_cycle")) / CYCLES_PER_US);
    println!("started anew {took:?} after the overflow");
    assert!(took <= STOPPED, "{took:?}");
    assert!(!rig.laser_is_on());

    drop(host);
    let mut host = client(&mut rig);
    assert_eq!(host.status().unwrap().reset, ResetReason::Watchdog);
    assert_eq!(host.job().unwrap().job, Some(job()));
    assert!(!rig.laser_is_on());
}
