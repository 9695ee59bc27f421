//! Everything at once on the emulated Pico: four axes at a million counts a second, triggers at 10 kHz, trigger
//! pulses, a host that listens, a cylinder's fit, and a program that goes out while the control
//! prints.
//!
//! The long form, 100 000 triggers, is run by
//! `cargo test -p umi-tests --test boards pico::load -- --ignored --nocapture`.

use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::Client;
use umi_client::programs;
use umi_protocol::job::{FeatureKind, Job};
use umi_protocol::latch::{LatchCause, LatchReport, SignalLevel, TriggerOut, TriggerPulse};
use umi_protocol::message::{Event, Record};
use umi_protocol::pattern::Handshake;
use umi_protocol::program::{ProgramInfo, Release, Stated};
use umi_tests::cases::{SESSION, job, journal, raw_bytes};
use umi_tests::rig::Rig as _;
use umi_tests::rig::pico::{AXES, CYCLES_PER_US, EmulatedPulses, PicoRig, TRIGGER_PIN};

const CYCLES_PER_MS: u64 = 1_000 * CYCLES_PER_US;
/// A million counts a second.
const FAST: f64 = 125.0;
/// 10 kHz.
const PERIOD: u64 = 100 * CYCLES_PER_US;
/// Trigger pulses: 100 a second. The board captures 11 000 of both.
const PULSE_US: u32 = 10_000;
/// The control sends so many characters behind an XOFF, at most.
const AFTER_XOFF: u32 = 10;
const BORE: &str = "SPHERE4";
/// How long the wall may take.
const PATIENCE: Duration = Duration::from_secs(3600);
/// The program is asked for, and the control is ready.
const READ: &str = "READ O77\r\n\x11";
const FLOW: [u8; 4] = [0x11, 0x12, 0x13, 0x14];

const TRIGGER_OUT_PIN: u8 = 22;

/// Interrupts, and what they may wait, microseconds: a capture with what it takes (the ring holds
/// 82), and a character, of which the DMA's rings hold 128.
const CAPTURE: u64 = 9;
const LINE: u64 = 11;
const CAPTURE_US: f64 = 75.0;
const LINE_US: f64 = 85.0;

/// The session's job with a bore before it, if that has hits. The board may hold the control.
fn bore_job(hits: usize, baud: u32) -> Job {
    let mut job = job();
    // What goes out is the program alone.
    job.correction = None;
    job.line.baud = Some(baud);
    job.receiver.handshake = Handshake::XonXoff;
    if hits == 0 {
        return job;
    }
    let mut bore = job.features[0].clone();
    bore.name = BORE.try_into().unwrap();
    bore.kind = FeatureKind::Cylinder;
    bore.hits = hits as u16;
    bore.radius_mm = Some(20.0);
    bore.datum = false;
    bore.approach.clear();
    job.features.insert(0, bore).unwrap();
    job
}

/// The hits of a bore that leans a little.
fn bore_text(hits: usize) -> String {
    if hits == 0 {
        return String::new();
    }
    let mut text = format!("{BORE}\n***\n{hits}\n");
    for hit in 0..hits {
        let (turn, depth) = (hit as f64 * 2.4, hit as f64 / hits as f64 * 30.0);
        let (x, y) = (20.0 * turn.cos() + 0.01 * depth, 20.0 * turn.sin());
        text += &format!("*{x:.4}*{y:.4}*{:.4}\n", 100.0 - depth);
    }
    text + "***\n"
}

/// A program that probes goes out whenever it is asked for, also while the board measures.
fn probing_program(lines: usize) -> (ProgramInfo, String) {
    let lines: String = (0..lines)
        .map(|line| format!("X{}.{:03} Y-{line}.25 Z-1.5\n", line % 90, line % 1000))
        .collect();
    let text = format!("%\nO77\nG21 G90 G17 G94\nG1 F800\n{lines}M30\n%\n");
    let program = ProgramInfo {
        number: 77,
        name: "PROBES".parse().unwrap(),
        bytes: u32::try_from(text.len()).unwrap(),
        crc32: programs::check_value(text.as_bytes()),
        release: Release::Always,
        hold_s: 60,
        stated: Stated::default(),
    };
    (program, text)
}

/// Listens until `done` says that it is enough.
fn listen(client: &mut Client, found: &mut Vec<LatchReport>, mut done: impl FnMut(usize) -> bool) {
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < PATIENCE, "it takes too long");
        match client.next_event(Duration::from_millis(200)).unwrap() {
            Some(Event::Latches(batch)) => found.extend(batch.reports()),
            Some(Event::Record {
                record: Record::Latch(latch),
                ..
            }) => found.push(latch),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            Some(_) => {}
            None if done(found.len()) => return,
            None => {}
        }
        if done(found.len()) {
            return;
        }
    }
}

/// What the control has heard, without what is for its flow and without parity.
fn heard(rig: &mut PicoRig) -> String {
    let mut text = String::new();
    while let Some(byte) = rig.control_receives(Duration::ZERO) {
        let byte = byte & 0x7F;
        if !FLOW.contains(&byte) && byte != b'\r' {
            text.push(byte.into());
        }
    }
    text
}

/// The longest waits, with what they are held to.
fn hold_waits(rig: &mut PicoRig) {
    for times in rig.emulator().interrupts() {
        let us = |cycles: u64| cycles as f64 / CYCLES_PER_US as f64;
        let (wait, run) = (us(times.wait_cycles), us(times.run_cycles));
        let whole = us(times.whole_cycles);
        println!(
            "interrupt {}: waits {wait:.1} us, takes {run:.1} us, both of one {whole:.1} us at most",
            times.number
        );
        match times.number {
            CAPTURE => assert!(whole <= CAPTURE_US, "{times:?}"),
            LINE => assert!(wait <= LINE_US, "{times:?}"),
            _ => {}
        }
    }
}

fn everything_at_once(triggers: u64, hits: usize, lines: usize, baud: u32) {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    client.set_job(&bore_job(hits, baud)).unwrap().unwrap();
    let (program, program_text) = probing_program(lines);
    programs::put(&mut client, &program, program_text.as_bytes(), |_| {}).unwrap();
    rig.emulator()
        .ask(&json!({ "do": "uart", "after_xoff": AFTER_XOFF }));
    client.live(true).unwrap();
    rig.control_sends(READ.as_bytes());
    let begun = Instant::now();
    while rig.emulator().state().json["uart"]["heard"].as_u64() < Some(20) {
        assert!(begun.elapsed() < PATIENCE, "the program does not come");
    }

    let lasts = triggers * PERIOD;
    rig.move_all(lasts + 50 * CYCLES_PER_MS, FAST);
    let every = TriggerOut::Time {
        interval_us: PULSE_US,
        pulse: TriggerPulse {
            width_us: 20,
            rests: SignalLevel::Low,
        },
    };
    assert_eq!(client.trigger_out(every).unwrap(), Ok(()));
    let start = rig.emulator().pulses(&EmulatedPulses {
        pin: TRIGGER_PIN,
        count: triggers,
        period: PERIOD,
        jitter: PERIOD / 8,
        width: 10 * CYCLES_PER_US,
        is_recorded: true,
        ..EmulatedPulses::default()
    });
    rig.emulator().interrupts();
    let end = start + lasts;
    // The control prints while it reads.
    let clamping: String = SESSION.split_inclusive('\n').take(27).collect();
    let text = bore_text(hits) + &clamping;
    rig.control_sends(text.as_bytes());

    let mut found = Vec::new();
    // A host that says nothing for five seconds would end the pulses.
    while rig.emulator().state().cycle <= end {
        let until = rig.emulator().state().cycle + 500 * CYCLES_PER_MS;
        let mut looked = Instant::now();
        listen(&mut client, &mut found, |_| {
            if looked.elapsed() < Duration::from_millis(100) {
                return false;
            }
            looked = Instant::now();
            rig.emulator().state().cycle > until.min(end)
        });
        client.positions().unwrap();
    }
    assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    hold_waits(&mut rig);
    let status = client.status().unwrap();
    let uart = rig.emulator().state().json["uart"].clone();
    println!(
        "when the last trigger has come: {uart}, {} verdicts",
        status.verdicts
    );

    // What was captured last is told, and the fit ends. What comes beside an answer is heard behind it.
    let mut before = None;
    let latches = loop {
        let until = rig.emulator().state().cycle + 100 * CYCLES_PER_MS;
        listen(&mut client, &mut found, |_| {
            rig.emulator().state().cycle > until
        });
        let status = client.status().unwrap();
        let now = Some((status.latches, found.len()));
        if status.verdicts == 1 && before == now {
            break status.latches;
        }
        before = now;
    };
    let told = |cause| found.iter().filter(move |latch| latch.cause == cause);
    assert!(found.iter().all(|latch| latch.missed == 0));
    let truth = rig.emulator().truth();
    for latch in told(LatchCause::Trigger) {
        let truth = &truth[latch.number as usize];
        for axis in 0..AXES {
            let off = latch.counts[axis] - truth.positions[axis];
            assert!(off.abs() <= 1, "{latch:?} {truth:?}");
        }
    }
    let outputs = rig.emulator().outputs();
    let rises = outputs
        .iter()
        .filter(|change| change.pin == TRIGGER_OUT_PIN && change.level)
        .count() as u64;
    assert!(rises >= lasts / CYCLES_PER_US / u64::from(PULSE_US));
    // Each edge is captured, and what the host has no time for is counted.
    let captured = (u64::from(latches.triggers), u64::from(latches.outputs));
    assert_eq!((captured, latches.missed), ((triggers, rises), 0));
    let all_told = told(LatchCause::Trigger).count() + told(LatchCause::Output).count();
    println!(
        "{triggers} triggers and {rises} pulses captured, {} of them not told to the host",
        latches.untold
    );
    assert_eq!(
        all_told as u64 + u64::from(latches.untold),
        triggers + rises
    );

    let status = client.status().unwrap();
    assert_eq!((status.counters.bytes_lost, status.verdicts_ok), (0, 1));
    let state = rig.emulator().state();
    assert_eq!((state.overruns, state.resets), (0, 0));
    let heard = heard(&mut rig);
    let lines = |text: &str| text.lines().count();
    assert!(
        heard == program_text,
        "{} of {} lines of the program: {:.300}",
        lines(&heard),
        lines(&program_text),
        heard
    );
    assert!(raw_bytes(&journal(&mut client).0) == (READ.to_owned() + &text).as_bytes());
    let positions = client.positions().unwrap();
    assert_eq!((positions.lost_samples, positions.are_valid()), (0, true));
}

#[test]
fn nothing_is_lost_under_all_load() {
    everything_at_once(1_000, 0, 100, 115_200);
}

/// The control's fastest line.
#[test]
fn nothing_is_lost_under_all_load_at_230400_baud() {
    everything_at_once(1_000, 0, 100, 230_400);
}

/// A hundred thousand triggers: ten seconds.
#[test]
#[ignore = "minutes of emulation"]
fn nothing_is_lost_under_all_load_long() {
    everything_at_once(100_000, 8, 1_000, 115_200);
}
