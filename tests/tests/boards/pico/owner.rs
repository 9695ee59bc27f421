//! The Pico's own part of an owner's board: its key in the flash that it runs from, made of its
//! oscillator's noise; its jumper on a line of the journal's chip; and what signing costs.
//! What it does with them is in [`crate::owner`].

use std::time::Duration;

use serde_json::json;
use umi_client::board::link::Client;
use umi_client::files::key_file::SigningKey;
use umi_client::journal::verify::verify;
use umi_client::journal::{self, PullRequest, PullStep, head};
use umi_client::problem::Problem;
use umi_protocol::access::{AccessMode, AccessRefusal, Role};
use umi_protocol::message::Record;
use umi_tests::cases::{clamping, job, judged};
use umi_tests::rig::pico::{CYCLES_PER_US, EmulatedPulses, Emulator, PicoRig, TRIGGER_PIN};
use umi_tests::rig::{Rig, skip_without};

use crate::owner::{host, owner, pulled, secret, session};

/// The last 16 KB of the flash that the code runs from.
const KEY_AT: u32 = 0x1020_0000 - KEY_BYTES;
const KEY_BYTES: u32 = 16 * 1024;
/// Of the journal's chip.
const CHIP_BYTES: u32 = 16 * 1024 * 1024;
/// On the wall, on any machine.
const PATIENCE: Duration = Duration::from_secs(600);
const CYCLES_PER_MS: u64 = 1_000 * CYCLES_PER_US;

fn bytes(emulator: &mut Emulator, what: &str, address: u32, length: u32) -> Vec<u8> {
    let request = json!({ "do": what, "address": address, "length": length });
    let answer = emulator.ask(&request);
    let digits = answer["bytes"].as_str().expect("hexadecimal digits");
    let byte = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).expect("a byte");
    (0..digits.len()).step_by(2).map(byte).collect()
}

fn holds(bytes: &[u8], seed: &[u8; 32]) -> bool {
    bytes.windows(32).any(|part| part == seed)
}

/// The seed of this public key among these bytes.
fn seed_in(bytes: &[u8], public: [u8; 32]) -> Option<[u8; 32]> {
    let is_it = |seed: &[u8; 32]| SigningKey::from_bytes(seed).verifying_key().to_bytes() == public;
    let blank = |part: &[u8]| part.iter().all(|byte| *byte == 0xFF);
    let parts = bytes.windows(32).filter(|part| !blank(part));
    parts
        .filter_map(|part| <[u8; 32]>::try_from(part).ok())
        .find(is_it)
}

/// The first start makes the key, once: it survives resets and power cuts. It stands in the flash that
/// the code runs from, nowhere in the journal's chip and in nothing that is pulled, and the board's head
/// proves its journal. Another board has another key.
#[test]
fn a_key_is_made_once_and_leaves_its_flash_never() {
    let Some(mut rig) = skip_without(PicoRig::first_start()) else {
        return;
    };
    let mut client = host(&mut rig);
    let (stack, most) = rig.stack_bytes().unwrap();
    assert!(stack <= most, "{stack} bytes to make a key");
    let public = client.access().unwrap().board_key.unwrap();
    let seed = seed_in(
        &bytes(rig.emulator(), "flash_read", KEY_AT, KEY_BYTES),
        public,
    );
    let seed = seed.expect("the key's flash holds the seed");
    let (file, key, _) = pulled(&mut client);
    assert_eq!(key, public);
    assert!(verify(&file, Some(public), None).unwrap().signed);
    assert!(!holds(&file, &seed));
    drop(client);
    rig.emulator().ask(&json!({ "do": "reset" }));
    assert_eq!(host(&mut rig).access().unwrap().board_key, Some(public));
    rig.power_cycle();
    let mut client = host(&mut rig);
    assert_eq!(client.access().unwrap().board_key, Some(public));
    let head = head(&mut client, [1; 32], PATIENCE).unwrap().unwrap();
    assert_eq!((head.key, head.boot), (public, 3));
    let chip = bytes(rig.emulator(), "nor_read", 0, CHIP_BYTES);
    assert!(!holds(&chip, &seed));
}

/// An oscillator that stands, or that runs in step with who looks at it, makes no key: the board works,
/// signs nothing and cannot be claimed. When it works, the next start makes one.
#[test]
fn a_broken_oscillator_makes_no_key() {
    for stuck in [vec![1], vec![1, 0], vec![1, 1, 0, 1, 0]] {
        let broken = |emulator: &mut Emulator| {
            emulator.ask(&json!({ "do": "noise", "stuck": stuck }));
            emulator.ask(&json!({ "do": "jumper", "closed": true }));
        };
        let Some(mut rig) = skip_without(PicoRig::without_key(broken)) else {
            return;
        };
        let mut client = host(&mut rig);
        assert_eq!(client.access().unwrap().board_key, None, "{stuck:?}");
        assert!(!client.key_enrol(&owner()).unwrap());
        assert_eq!(client.access().unwrap().mode, AccessMode::Open);
        drop(client);
        rig.emulator().ask(&json!({ "do": "noise", "stuck": null }));
        rig.power_cycle();
        assert!(host(&mut rig).access().unwrap().board_key.is_some());
    }
}

/// The jumper counts where it was closed at the start and is now; then its owner may, and nobody else.
#[test]
fn the_jumper_is_looked_at_twice() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let refused = |rig: &mut PicoRig| {
        let error = host(rig).key_enrol(&owner()).unwrap_err();
        let umi_client::board::link::LinkError::Refused(why) = error else {
            panic!("{error:?}")
        };
        assert_eq!(why, AccessRefusal::JumperOpen);
    };
    assert_eq!(host(&mut rig).access().unwrap().jumper, Some(false));
    refused(&mut rig);
    // Only now.
    rig.close_jumper(true);
    assert_eq!(host(&mut rig).access().unwrap().jumper, Some(true));
    refused(&mut rig);
    rig.power_cycle();
    assert_eq!(host(&mut rig).access().unwrap().jumper, Some(true));
    // Only at the start.
    rig.close_jumper(false);
    refused(&mut rig);
    rig.close_jumper(true);
    assert!(host(&mut rig).key_enrol(&owner()).unwrap());
    assert_eq!(
        session(&mut rig).access().unwrap().mode,
        AccessMode::Claimed
    );
}

/// A wipe takes keys, journal and programs away, leaves its signed record, and the board is open again
/// with the key that it had.
#[test]
fn a_wipe_leaves_a_signed_record() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    rig.erase_quickly();
    rig.close_jumper(true);
    rig.power_cycle();
    let mut client = host(&mut rig);
    let public = client.access().unwrap().board_key.unwrap();
    assert!(client.key_enrol(&owner()).unwrap());
    drop(client);
    let resets = rig.emulator().state().resets;
    let mut client = session(&mut rig);
    assert!(client.wipe().unwrap());
    drop(client);
    rig.wait_until("the restart", |emulator| emulator.state().resets > resets);
    let mut client = host(&mut rig);
    let access = client.access().unwrap();
    assert_eq!(
        (access.mode, access.board_key),
        (AccessMode::Open, Some(public))
    );
    let (file, key, records) = pulled(&mut client);
    assert_eq!(key, public);
    assert!(verify(&file, Some(public), None).unwrap().signed);
    let wiped = |of: &Record| matches!(of, Record::Wiped { .. });
    assert_eq!(records.iter().filter(|of| wiped(of)).count(), 1);
}

/// A board that has an owner since now, and the host that has claimed it.
fn claimed() -> Option<(PicoRig, Client)> {
    let mut rig = PicoRig::start_or_skip()?;
    rig.close_jumper(true);
    rig.power_cycle();
    let mut client = host(&mut rig);
    assert!(client.key_enrol(&owner()).unwrap());
    Some((rig, client))
}

/// While the board signs head after head and proves a session, captures and characters wait no longer
/// than they may without that, and none is lost.
#[test]
fn signing_keeps_no_character_and_no_capture_waiting() {
    const CAPTURE_INTERRUPT: u64 = 9;
    const LINE_INTERRUPT: u64 = 11;
    const TRIGGERS: u64 = 2_000;
    let Some((mut rig, mut client)) = claimed() else {
        return;
    };
    rig.emulator().interrupts();
    // Two seconds: triggers at 1 kHz, and a line that is full.
    rig.emulator().pulses(&EmulatedPulses {
        pin: TRIGGER_PIN,
        count: TRIGGERS,
        period: CYCLES_PER_MS,
        width: 10 * CYCLES_PER_US,
        ..EmulatedPulses::default()
    });
    let begun = rig.emulator().state().cycle;
    rig.control_sends(&[b'N'; 11_000]);
    assert_eq!(client.authenticate(&secret(1)).unwrap(), Role::Owner);
    let mut heads = 0_u8;
    let end = begun + (TRIGGERS + 50) * CYCLES_PER_MS;
    while rig.emulator().state().cycle < end {
        heads += 1;
        head(&mut client, [heads; 32], PATIENCE).unwrap().unwrap();
    }
    assert!(heads >= 1, "{heads}");
    for times in rig.emulator().interrupts() {
        let (wait, whole) = (times.wait_cycles, times.whole_cycles);
        match times.number {
            CAPTURE_INTERRUPT => assert!(whole <= 75 * CYCLES_PER_US, "{times:?}"),
            LINE_INTERRUPT => assert!(wait <= 85 * CYCLES_PER_US, "{times:?}"),
            _ => {}
        }
    }
    let counters = client.status().unwrap();
    let state = rig.emulator().state();
    assert_eq!((state.overruns, state.control_waiting), (0, 0));
    assert_eq!(counters.latches.missed, 0);
    assert_eq!(state.fault, None);
}

/// The same clamping again and again, in peace and at other instants of a session that is proven: the
/// lamps say a verdict as soon behind its last input. A session takes the processor for the better part
/// of a second, in steps that nothing divides; a verdict waits for none of them.
#[test]
fn a_session_delays_no_verdict() {
    const BUSY_PIN: u8 = 28;
    /// A session's answers take a little, above measuring.
    const MOST_LATER_US: u64 = 10_000;
    const PEACE: u64 = 2;
    let Some((mut rig, client)) = claimed() else {
        return;
    };
    drop(client);
    let mut client = session(&mut rig);
    client.set_job(&job()).unwrap().unwrap();
    rig.emulator().outputs();
    let mut judged_so_far = 0;
    let mut clampings = Vec::new();
    for turn in 0..PEACE + 5 {
        let is_in_peace = turn < PEACE;
        // A host proves its key at the beginning of its connection.
        drop(client);
        client = host(&mut rig);
        let begun = rig.emulator().state().cycle;
        // The clamping is printed for an eighth of a second.
        let start = begun + turn.saturating_sub(PEACE) * 150 * CYCLES_PER_MS;
        let proven = std::thread::scope(|scope| {
            let proves = scope.spawn(|| (!is_in_peace).then(|| client.authenticate(&secret(1))));
            if !is_in_peace {
                rig.wait_for_cycle(start);
            }
            rig.control_sends(clamping(0).as_bytes());
            let role = proves.join().unwrap();
            assert!(role.is_none_or(|role| role.unwrap() == Role::Owner));
            rig.emulator().state().cycle
        });
        judged_so_far += 1;
        judged(&mut rig, &mut client, judged_so_far);
        let lamps = rig.emulator().outputs();
        let fall = lamps.iter().rfind(|of| of.pin == BUSY_PIN && !of.level);
        let fall = fall.expect("a verdict");
        clampings.push((begun, fall.cycle, proven));
        // What is due behind a verdict is signed before the next.
        rig.wait_for_cycle(fall.cycle + 700 * CYCLES_PER_MS);
    }
    drop(client);
    let inputs = verdicts_us(&mut session(&mut rig));
    let time = rig.emulator().time();
    let late = |n: usize| {
        let lamp_us = time.timer_us - (time.cycle - clampings[n].1) / CYCLES_PER_US;
        lamp_us - inputs[n]
    };
    // The first may have had a sector to erase.
    let peace = (0..PEACE as usize).map(late).min().unwrap();
    let mut within = 0;
    for (n, (begun, lamp, proven)) in clampings.iter().enumerate().skip(PEACE as usize) {
        println!(
            "verdict {n}: {} us behind its last input, {} ms into a session of {} ms",
            late(n),
            (lamp - begun) / CYCLES_PER_MS,
            (proven - begun) / CYCLES_PER_MS
        );
        within += u32::from(lamp < proven);
        assert!(late(n) <= peace + MOST_LATER_US, "{} us: {n}", late(n));
    }
    println!("in peace {peace} us");
    assert!(within >= 2, "{within}");
}

/// When each verdict's last input came, by the board's clock.
fn verdicts_us(client: &mut Client) -> Vec<u64> {
    let mut times = Vec::new();
    journal::pull(client, PullRequest::default(), |step| {
        if let PullStep::Entry(entry, _) = step
            && matches!(journal::record(&entry), Ok(Record::Verdict(_)))
        {
            times.push(entry.t.0);
        }
        Ok::<_, Problem>(())
    })
    .unwrap();
    times
}

/// Cycles in which the core did not sleep, and all.
fn worked(rig: &mut PicoRig) -> (u64, u64) {
    let state = rig.emulator().state();
    (state.cycle - state.slept_cycles, state.cycle)
}

/// What heads and sessions take of the processor, beyond what an idle board takes: the README says it.
#[test]
fn what_a_head_and_a_session_take_is_held() {
    let Some((mut rig, mut client)) = claimed() else {
        return;
    };
    head(&mut client, [9; 32], PATIENCE).unwrap().unwrap();
    let mut extra = |what: &str, most_millions: f64, work: &mut dyn FnMut(&mut PicoRig)| {
        let (before, from) = worked(&mut rig);
        work(&mut rig);
        let (after, to) = worked(&mut rig);
        // As long without it.
        rig.wait_for_cycle(to + (to - from));
        let (idle, end) = worked(&mut rig);
        let idle = (idle - after) as f64 * (to - from) as f64 / (end - to) as f64;
        let millions = ((after - before) as f64 - idle) / 1e6;
        println!("{what}: {millions:.1} million cycles");
        assert!(
            millions < most_millions,
            "{what}: {millions} million cycles"
        );
        assert!(millions > 1.0, "{what} was done");
    };
    extra("four heads", 120.0, &mut |_| {
        for n in 1..=4 {
            head(&mut client, [n; 32], PATIENCE).unwrap().unwrap();
        }
    });
    extra("a session", 120.0, &mut |_| {
        assert_eq!(client.authenticate(&secret(1)).unwrap(), Role::Owner);
    });
}
