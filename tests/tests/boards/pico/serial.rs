//! The ports of the board's image on an emulated Pico, at their worst: the control's line
//! at its full rate, the host's link flooded, pulled and waited for, the power cut.
//!
//! The long form is run by
//! `cargo test -p umi-tests --test boards pico::serial -- --ignored --nocapture`.

use std::env;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Command, Output};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use umi_client::board::link::{Client, Patience};
use umi_client::journal::audit::Audit;
use umi_client::journal::{self, PullStep};
use umi_client::problem::Problem;
use umi_client::programs;
use umi_core::brain::{self, Brain};
use umi_core::units::Micros;
use umi_protocol::frame::{MAX_HOST_FRAME, encode};
use umi_protocol::hello::Hello;
use umi_protocol::job::{FeatureKind, Job, MAX_HITS};
use umi_protocol::message::{Record, Request};
use umi_protocol::pattern::Handshake;
use umi_protocol::program::{IntegerRule, ProgramInfo, Release, RewriteSpec, Stated, UnitRule};
use umi_tests::cases::{SESSION, clamping, job, journal, raw_bytes};
use umi_tests::rig::Rig;
use umi_tests::rig::pico::{
    AXES, CYCLES_PER_US, EmulatedPulses, PicoRig, Segment, TRIGGER_PIN, pty,
};

/// Characters that leave after an XOFF has come, at most: one is on the line, one behind
/// it. A control takes ten.
const AFTER_XOFF: usize = 2;
/// After CTS is gone: the one that is on the line.
const AFTER_CTS: usize = 1;
/// A character at 115200 baud.
const CHARACTER_CYCLES: u64 = 87 * CYCLES_PER_US;
/// How long an answer may take while the board fits a sphere to [`MAX_HITS`] hits: it has
/// no floating point. Or while it signs a head, under the same load.
const ANSWER_CYCLES: u64 = 500_000 * CYCLES_PER_US;
/// How long half of them take, at most: the code that answers and the fit take the lines of the
/// flash's cache from each other.
const HALF_OF_ANSWERS_CYCLES: u64 = 4_000 * CYCLES_PER_US;
/// Cycles for a byte of a program that is rewritten, before its first byte goes out: the code that
/// looks through it is larger than the flash's cache.
const LOOK_CYCLES: f64 = 6_250.0;
/// How long the wall may take for a test.
const PATIENCE: Duration = Duration::from_secs(900);

const CTS_PIN: u8 = 2;
const DC1: u8 = 0x11;
const XOFF: u8 = 0x13;

fn client(rig: &mut PicoRig) -> Client {
    let patience = Patience {
        answer: Duration::from_secs(60),
        tries: 3,
    };
    Client::with_patience(rig.connect(), patience).unwrap()
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "{what} takes too long");
        thread::sleep(Duration::from_millis(5));
    }
}

fn wait_for_control(rig: &mut PicoRig) {
    wait_until("the control's text", || {
        rig.emulator().state().control_waiting == 0
    });
}

// --- the control's line

fn heard(rig: &mut PicoRig) -> usize {
    let state = rig.emulator().state();
    usize::try_from(number(&state.json, "uart", "heard")).unwrap()
}

/// When the characters for the control ended, since this was asked last.
fn stamps(rig: &mut PicoRig) -> Vec<u64> {
    let answer = rig.emulator().ask(&json!({ "do": "stamps" }));
    let stamps = answer["stamps"].as_array().unwrap().iter();
    stamps.map(|stamp| stamp.as_u64().unwrap()).collect()
}

fn control_says(rig: &mut PicoRig, byte: u8) {
    rig.emulator()
        .ask(&json!({ "do": "send", "bytes": format!("{byte:02x}") }));
}

fn clear_to_send(rig: &mut PicoRig, is_clear: bool) {
    // Low is ready.
    let level = u8::from(!is_clear);
    rig.emulator()
        .ask(&json!({ "do": "level", "pin": CTS_PIN, "level": level }));
}

/// Wherever in a program the control says XOFF, or takes CTS away, the board stops within
/// the characters that it promises, and not before; then the rest follows, and nothing is
/// missing or doubled.
#[test]
fn xoff_and_cts_stop_the_board_in_the_middle_of_a_line() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.set_job(&job()).unwrap().unwrap();
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    wait_until("a verdict", || client.status().unwrap().correction_waiting);
    let text = client.verdict().unwrap().unwrap().correction.unwrap().text;
    // From here on in steps: it is known to the cycle what comes after what.
    rig.emulator().run(1000 * CYCLES_PER_US);
    stamps(&mut rig);
    let begun = heard(&mut rig);
    control_says(&mut rig, DC1);
    let (mut after_xoff, mut after_cts) = (0, 0);
    for (round, stop) in (1..text.len() - 12).step_by(11).enumerate() {
        while heard(&mut rig) < begun + stop {
            rig.emulator().run(10 * CYCLES_PER_US);
        }
        stamps(&mut rig);
        let now = rig.emulator().state().cycle;
        let by_xoff = round.is_multiple_of(2);
        let come = if by_xoff {
            control_says(&mut rig, XOFF);
            now + CHARACTER_CYCLES
        } else {
            clear_to_send(&mut rig, false);
            now
        };
        rig.emulator().run(20 * CHARACTER_CYCLES);
        let after = stamps(&mut rig);
        let after = after.iter().filter(|end| **end > come).count();
        if by_xoff {
            after_xoff = after_xoff.max(after);
            control_says(&mut rig, DC1);
        } else {
            after_cts = after_cts.max(after);
            clear_to_send(&mut rig, true);
        }
    }
    rig.emulator().run(400 * CHARACTER_CYCLES);
    assert_eq!(heard(&mut rig) - begun, text.len(), "and nothing more");
    let got: Vec<u8> = (0..text.len())
        .map(|_| rig.control_receives(Duration::ZERO).unwrap())
        .collect();
    assert_eq!(String::from_utf8_lossy(&got), text.as_str());
    assert!(
        (1..=AFTER_XOFF).contains(&after_xoff),
        "{after_xoff} characters after an XOFF"
    );
    assert!(
        (1..=AFTER_CTS).contains(&after_cts),
        "{after_cts} characters without CTS"
    );
}

/// All axes at about a million counts a second, none in step with another.
fn move_all(rig: &mut PicoRig, cycles: u64) {
    for axis in 0..AXES {
        let pace = 125.0 * (1.0 + 0.0037 * axis as f64);
        let counts = (cycles as f64 / pace) as i64;
        let way = if axis % 2 == 0 { counts } else { -counts };
        rig.emulator()
            .start_axis(axis, &[Segment::steady(way, pace)], &json!({}));
    }
}

/// A host that takes whatever comes and never stops to ask: `more` puts further requests
/// on the link, whether the earlier ones are answered or not.
struct Flood {
    stream: TcpStream,
    request: Vec<u8>,
}

impl Flood {
    fn begin(rig: &mut PicoRig) -> Self {
        rig.emulator().ask(&json!({ "do": "usb", "plugged": true }));
        let mut stream = rig.emulator().host().unwrap();
        let mut frame = [0; MAX_HOST_FRAME];
        let hello = encode(0, &Hello::new("flood"), &mut frame).unwrap();
        stream.write_all(hello).unwrap();
        let live = encode(1, &Request::LiveSet { on: true }, &mut frame).unwrap();
        stream.write_all(live).unwrap();
        let request = encode(2, &Request::StatusGet, &mut frame).unwrap().to_vec();
        let mut answers = stream.try_clone().unwrap();
        thread::spawn(move || {
            let mut buffer = [0; 4096];
            while answers.read(&mut buffer).is_ok_and(|count| count > 0) {}
        });
        Self { stream, request }
    }

    fn more(&mut self) {
        self.stream.write_all(&self.request.repeat(50)).unwrap();
    }
}

/// A session at 115200 baud without a pause, all axes moving, a thousand triggers a
/// second, requests and events on the link without end, and in the middle of it all the
/// host's cable is pulled: no byte, no trigger and no count is lost, and every decision is
/// what it is on a desk. The control sends only while RTS lets it: it always does.
#[test]
fn nothing_is_lost_when_everything_comes_at_once() {
    const MILLISECONDS: u64 = 600;
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut desk = client(&mut rig);
    desk.set_job(&job()).unwrap().unwrap();
    drop(desk);
    rig.wait_for_quiet();
    let mut flood = Flood::begin(&mut rig);
    rig.emulator()
        .ask(&json!({ "do": "uart", "rts_cts": true }));
    move_all(&mut rig, MILLISECONDS * 1000 * CYCLES_PER_US);
    rig.emulator().pulses(&EmulatedPulses {
        pin: TRIGGER_PIN,
        count: MILLISECONDS,
        period: 1000 * CYCLES_PER_US,
        width: 10 * CYCLES_PER_US,
        ..EmulatedPulses::default()
    });
    let before = rig.emulator().state();
    rig.control_sends(SESSION.as_bytes());
    let half = SESSION.len() as u64 / 2;
    let mut waited = 0;
    let flooded = loop {
        let state = rig.emulator().state();
        let waiting = number(&state.json, "usb", "waiting");
        waited = waited.max(waiting);
        if waiting < 4096 {
            flood.more();
        }
        if number(&state.json, "uart", "sent") > number(&before.json, "uart", "sent") + half {
            break state;
        }
    };
    rig.unplug();
    wait_for_control(&mut rig);
    wait_until("the last trigger", || {
        !rig.emulator().axes().iter().any(|axis| axis.is_moving)
    });

    let mut client = client(&mut rig);
    wait_until("the last verdict", || {
        client.status().unwrap().verdicts == 5
    });
    let status = client.status().unwrap();
    assert_eq!(status.counters.bytes_lost, 0);
    assert_eq!(status.verdicts_ok, 5);
    assert_eq!(u64::from(status.latches.triggers), MILLISECONDS);
    assert_eq!(status.latches.missed, 0);
    let state = rig.emulator().state();
    assert_eq!((state.overruns, state.toggle_errors), (0, 0));
    let baud = state.json["uart"]["baud"].as_f64().unwrap();
    assert!((baud / 115_200.0 - 1.0).abs() < 0.001, "{baud}");
    let axes = rig.emulator().axes();
    let positions = client.positions().unwrap();
    let truly: Vec<i64> = axes.iter().map(|axis| axis.position).collect();
    assert_eq!(positions.counts.as_slice(), truly);

    let records = journal(&mut client).0;
    assert!(raw_bytes(&records) == SESSION.as_bytes());
    let decided = records
        .into_iter()
        .filter(|record| matches!(record, Record::Feature(_) | Record::Verdict(_)));
    assert!(decided.eq(decisions(SESSION)));
    // It was a flood: there was always more to take, and the board took and gave much.
    let usb = |what: &str| number(&flooded.json, "usb", what) - number(&before.json, "usb", what);
    let (taken, given) = (usb("delivered"), usb("received"));
    println!("{taken} bytes of requests taken, {given} of answers and events given");
    assert!(waited > 0 && taken > 500 && given > 2_000);
}

fn number(state: &Value, part: &str, what: &str) -> u64 {
    state[part][what].as_u64().unwrap()
}

/// Decisions of this text, as the same code comes to them on the host.
fn decisions(text: &str) -> Vec<Record> {
    let mut brain = Brain::new(job()).unwrap();
    let mut decisions = Vec::new();
    brain.bytes(Micros(1), text.as_bytes(), &mut |output| match output {
        brain::Output::Feature(feature) => decisions.push(Record::Feature(feature.clone())),
        brain::Output::Verdict(verdict) => decisions.push(Record::Verdict(verdict.clone())),
        _ => {}
    });
    decisions
}

// --- the link beside a fit

/// Three spheres of as many hits as a job can have.
fn long_job() -> Job {
    let mut job = job();
    // The hits lie all around, and nothing shall be sent.
    job.correction = None;
    job.limits.approach_deg = None;
    job.limits.lone_hit_mm = None;
    for feature in &mut job.features {
        feature.hits = MAX_HITS as u16;
        feature.approach.clear();
    }
    job
}

/// Its hits, as the control prints them.
fn long_text() -> String {
    let mut text = String::new();
    let centres: [[f64; 3]; 3] = [
        [-135.0, -136.6, 120.0],
        [138.0, -134.7, 110.0],
        [-136.7, 136.4, 120.0],
    ];
    for (place, [x, y, z]) in centres.into_iter().enumerate() {
        text += &format!("SPHERE{}\n***\n{MAX_HITS}\n", place + 1);
        for hit in 0..MAX_HITS {
            // Round and round, from the equator up.
            let turn = hit as f64 * 2.4;
            let height = hit as f64 / MAX_HITS as f64 * 0.95;
            let ring = (1.0 - height * height).sqrt();
            let point = [
                x + 12.7 * ring * turn.cos(),
                y + 12.7 * ring * turn.sin(),
                z + 12.7 * height,
            ];
            let words = point.map(|mm| format!("*{mm:.4}"));
            text += &(words.concat() + "\n");
        }
        text += "***\n";
    }
    text
}

/// Spheres of as many hits as a job can have, with the next lines coming in at 115200 baud:
/// no byte is lost, and a host that asks all the while has each answer within the time of
/// one fit.
#[test]
fn the_link_answers_and_the_line_is_taken_while_fits_run() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.set_job(&long_job()).unwrap().unwrap();
    rig.emulator().ask(&json!({ "do": "packets" }));
    rig.control_sends(long_text().as_bytes());
    let mut asked = 0;
    wait_until("the verdict", || {
        asked += 1;
        client.status().unwrap().verdicts == 1
    });
    let answer = rig.emulator().ask(&json!({ "do": "packets" }));
    let packets: Vec<(u64, i64)> = serde_json::from_value(answer["packets"].clone()).unwrap();
    // One request at a time: the first packet of an answer is the next that comes back.
    let delays = packets.windows(2).filter_map(|pair| match pair {
        [(at, to_it), (then, from_it)] if *to_it < 0 && *from_it > 0 => Some(then - at),
        _ => None,
    });
    let mut delays: Vec<u64> = delays.collect();
    delays.sort_unstable();
    let us = |share: usize| delays[(delays.len() - 1) * share / 100] / CYCLES_PER_US;
    println!(
        "{asked} requests while it measured: answers after {} us, 95 % within {}, all within {}",
        us(50),
        us(95),
        us(100)
    );
    assert!(delays.len() >= asked);
    assert!(*delays.last().unwrap() <= ANSWER_CYCLES);
    assert!(delays[delays.len() / 2] <= HALF_OF_ANSWERS_CYCLES);
    let status = client.status().unwrap();
    assert_eq!(status.counters.bytes_lost, 0);
    assert_eq!(status.verdicts_ok, 1, "{:?}", client.verdict());
    assert_eq!(rig.emulator().state().overruns, 0);
    assert!(raw_bytes(&journal(&mut client).0) == long_text().as_bytes());
}

/// Feed that a control punches before its text: twice what may wait.
const LEADER: usize = 12_000;

/// A bore before the spheres: a cylinder, whose fit takes seconds without floating point.
const BORE: &str = "SPHERE4";

fn bore_job(hits: usize) -> Job {
    let mut job = long_job();
    let mut bore = job.features[0].clone();
    bore.name = BORE.try_into().unwrap();
    bore.kind = FeatureKind::Cylinder;
    bore.hits = hits as u16;
    bore.radius_mm = Some(20.0);
    bore.datum = false;
    job.features.insert(0, bore).unwrap();
    job
}

/// The hits of the bore, which leans a little, then those of the spheres: 5.8 KB.
fn bore_text(hits: usize) -> String {
    let mut text = format!("{BORE}\n***\n{hits}\n");
    for hit in 0..hits {
        let (turn, depth) = (hit as f64 * 2.4, hit as f64 / hits as f64 * 30.0);
        let point = [
            20.0 * turn.cos() + 0.01 * depth,
            20.0 * turn.sin(),
            100.0 - depth,
        ];
        let words = point.map(|mm| format!("*{mm:.4}"));
        text += &(words.concat() + "\n");
    }
    text + "***\n" + &long_text()
}

/// A fit of as many hits as a job can have takes so long at most, of the board's time: twice what it took on 2026-11-29.
const FIT_MS: u64 = 25_000;

/// The host, when the board has fitted and answers again. What that may take is the board's time: the wall's says only that
/// nothing hangs.
fn behind_a_fit(rig: &mut PicoRig) -> Client {
    let patience = Patience {
        answer: PATIENCE,
        tries: 4,
    };
    Client::with_patience(rig.connect(), patience).unwrap()
}

/// While the board fits a cylinder, the control sends all that may wait, or more if it can be
/// held: then it still sends ten characters after each XOFF. The host has the laser switched
/// on, and its cable is pulled: the laser is off long before the fit is over. Nothing of the
/// control is lost, and the watchdog waits.
fn a_long_fit(hits: usize, handshake: Handshake) {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut desk = client(&mut rig);
    let mut job = bore_job(hits);
    job.receiver.handshake = handshake;
    desk.set_job(&job).unwrap().unwrap();
    let mut text = bore_text(hits);
    if handshake == Handshake::XonXoff {
        rig.emulator()
            .ask(&json!({ "do": "uart", "after_xoff": 10 }));
        text.insert_str(text.len() - long_text().len(), &"\0".repeat(LEADER));
        rig.control_sends(text.as_bytes());
        wait_until("XOFF", || rig.emulator().state().control_held > 0);
    } else {
        rig.control_sends(text.as_bytes());
        wait_for_control(&mut rig);
    }
    let sent = rig.emulator().state().cycle;
    assert!(desk.laser(true).unwrap());
    desk.positions().unwrap();
    assert!(rig.laser_is_on());
    rig.unplug();
    wait_until("darkness", || !rig.laser_is_on());
    let dark = rig.emulator().state().cycle;
    drop(desk);
    let mut desk = behind_a_fit(&mut rig);
    let fitted = rig.emulator().state().cycle;
    let ms = |from: u64, to: u64| (to - from) / CYCLES_PER_US / 1000;
    println!(
        "{hits} hits: dark {} ms after the text, {} ms before the host is answered",
        ms(sent, dark),
        ms(dark, fitted)
    );
    assert!(ms(dark, fitted) > 1000, "the fit was over");
    assert!(ms(dark, fitted) < FIT_MS, "the fit takes too long");
    while desk.status().unwrap().verdicts != 1 {
        let waited = ms(fitted, rig.emulator().state().cycle);
        assert!(waited < FIT_MS, "no verdict");
        thread::sleep(Duration::from_millis(5));
    }
    let status = desk.status().unwrap();
    assert_eq!(status.counters.bytes_lost, 0);
    assert_eq!(status.verdicts_ok, 1, "{:?}", desk.verdict());
    let state = rig.emulator().state();
    assert_eq!((state.overruns, state.resets), (0, 0));
    assert!(raw_bytes(&journal(&mut desk).0) == text.as_bytes());
}

/// See [`a_long_fit`]: four seconds.
#[test]
fn a_cylinder_keeps_neither_the_line_nor_the_laser() {
    a_long_fit(8, Handshake::XonXoff);
}

/// As many hits as a job can have: longer than the watchdog's counter.
#[test]
#[ignore = "minutes of emulation"]
fn a_cylinder_keeps_neither_the_line_nor_the_laser_long() {
    a_long_fit(MAX_HITS, Handshake::None);
}

/// A program that is rewritten by the verdict is looked through before its first byte: the
/// control that reads it waits for so long.
#[test]
fn a_long_program_begins_before_a_control_gives_up() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    let mut plain = job();
    plain.correction = None;
    client.set_job(&plain).unwrap().unwrap();
    let lines: String = (0..1000)
        .map(|line| format!("X{}.{:03} Y-{line}.25 Z-1.5\n", line % 90, line % 1000))
        .collect();
    let text = format!("%\nO77\nG21 G90 G17 G94\nG1 F800\n{lines}M30\n%\n");
    let program = ProgramInfo {
        number: 77,
        name: "LONG".parse().unwrap(),
        bytes: u32::try_from(text.len()).unwrap(),
        crc32: programs::check_value(text.as_bytes()),
        release: Release::Rewritten(RewriteSpec {
            decimals_mm: 3,
            chord_um: 20,
            clearance_um: 1000,
            integers: IntegerRule::Refused,
            unit: UnitRule::Said,
        }),
        hold_s: 60,
        stated: Stated::default(),
    };
    programs::put(&mut client, &program, text.as_bytes(), |_| {}).unwrap();
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    wait_until("two verdicts", || client.status().unwrap().verdicts == 2);
    stamps(&mut rig);
    let begun = heard(&mut rig);
    rig.control_sends(b"READ O77\r\n\x11");
    wait_for_control(&mut rig);
    let asked = rig.emulator().state().cycle;
    wait_until("its first byte", || heard(&mut rig) > begun);
    let waited = stamps(&mut rig)[0] - asked;
    let per_byte = waited as f64 / text.len() as f64;
    println!(
        "{} bytes: {} ms, {per_byte:.0} cycles a byte",
        text.len(),
        waited / CYCLES_PER_US / 1000
    );
    assert!(per_byte <= LOOK_CYCLES);
}

// --- the program, on a serial device

/// The program that users type, as this workspace's build has left it. On a busy machine
/// the emulated board may not answer before its patience ends: it is asked again then.
fn umi(arguments: &[&str]) -> Output {
    let tests = env::current_exe().unwrap();
    let program = tests.ancestors().nth(2).unwrap().join("umi");
    let start = Instant::now();
    loop {
        let run = Command::new(&program).args(arguments).output();
        let output = run.unwrap_or_else(|error| {
            panic!(
                "{}: {error}; `cargo build -p umi` makes it",
                program.display()
            )
        });
        if output.status.success() {
            return output;
        }
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            said.contains("did not answer") && start.elapsed() < PATIENCE,
            "umi {arguments:?}: {output:?}"
        );
    }
}

fn json_of(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// `umi` itself on a serial device: who the board is, a job there and back, where the axes
/// are, a scan, and the journal.
#[test]
fn umi_talks_to_it_through_a_serial_device() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    drop(rig.connect());
    rig.move_to(&[1000, -200]);
    let port = &pty(rig.emulator()).unwrap();
    let info = json_of(&umi(&["info", "--json", "--port", port]));
    let descriptors = rig.emulator().ask(&json!({ "do": "descriptors" }));
    assert_eq!(info["board"]["board"], "pico", "{info}");
    assert_eq!(info["board"]["serial"], descriptors["serial"]);

    let folder = env::temp_dir().join(format!("umi-pico-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = |name: &str| folder.join(name).display().to_string();
    let example = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/three-spheres.toml"
    );
    umi(&["job", "set", example, "--port", port]);
    umi(&["job", "get", "--port", port, "-o", &file("job.toml")]);
    let back = std::fs::read_to_string(file("job.toml")).unwrap();
    assert_eq!(toml::from_str::<Job>(&back).unwrap(), job());

    let watched = json_of(&umi(&["watch", "--once", "--json", "--port", port]));
    assert_eq!(watched["positions"]["counts"][0], 1000, "{watched}");
    assert_eq!(watched["positions"]["counts"][1], -200, "{watched}");

    let scan = umi(&[
        "events",
        "--csv",
        "--count",
        "20",
        "--trigger-every-us",
        "1000",
        "--port",
        port,
    ]);
    let scan = String::from_utf8_lossy(&scan.stdout).into_owned();
    let rows: Vec<Vec<&str>> = scan
        .lines()
        .map(|line| line.split(',').collect())
        .filter(|row: &Vec<&str>| row[0] == "latch")
        .collect();
    assert!(rows.len() >= 20, "{scan}");
    for (number, row) in rows.iter().enumerate() {
        assert_eq!(row[1..3], [&*number.to_string(), "output"], "{scan}");
        assert_eq!(row[4..6], ["1000", "-200"], "{scan}");
    }

    umi(&["log", "-o", &file("journal.umij"), "--port", port]);
    let listed = umi(&["log", &file("journal.umij")]);
    assert!(String::from_utf8_lossy(&listed.stdout).contains("THREE SPHERES"));
    std::fs::remove_dir_all(&folder).unwrap();
}

// --- the journal's memory

/// Every entry as it is stored, with what it holds; the chain over them is right.
fn entries(client: &mut Client) -> Vec<(Vec<u8>, Record)> {
    let mut entries = Vec::new();
    let mut audit = Audit::default();
    let stretch = journal::pull(client, journal::PullRequest::default(), |step| {
        if let PullStep::Entry(entry, raw) = step {
            let record = journal::record(&entry).unwrap();
            audit.take(&entry, &record);
            entries.push((raw.to_vec(), record));
        }
        Ok::<_, Problem>(())
    });
    assert_eq!(audit.finish(stretch.unwrap().stretch.next).differences, []);
    entries
}

/// The power goes in the middle of what the journal writes, in its first byte, in a page
/// and between two: every entry that the host had been told of is there afterwards, bit
/// for bit, the board says what it gave up, and the chain has no gap.
#[test]
fn a_power_cut_while_the_journal_writes_loses_nothing_that_was_told() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = self::client(&mut rig);
    client.set_job(&job()).unwrap().unwrap();
    let mut torn = 0;
    for (round, after) in [1, 17, 258].into_iter().enumerate() {
        let told = entries(&mut client);
        rig.emulator()
            .ask(&json!({ "do": "nor_cut", "after": after }));
        rig.control_sends(clamping(round).as_bytes());
        wait_until("the cut", || rig.emulator().state().json["is_on"] == false);
        drop(client);
        rig.power_cycle();
        client = self::client(&mut rig);
        let found = entries(&mut client);
        let (before, since) = found.split_at_checked(told.len()).unwrap();
        assert!(before == told, "cut after {after} bytes");
        for (_, record) in since {
            if let Record::Recovered { torn_bytes, .. } = record {
                torn += torn_bytes;
            }
        }
        assert!(!since.is_empty(), "at least the start");
        assert!(client.job().unwrap().job.is_some());
    }
    assert!(torn > 0);
}
