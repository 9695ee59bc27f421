//! What the cases share that every board is asked: see `tests/tests/boards/conformance.rs`
//! and `tests/tests/send/deliveries`.
#![allow(
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    reason = "the halves of tests: they panic where a test would"
)]

use std::time::{Duration, Instant};

use umi_client::board::link::{Client, Patience};
use umi_client::journal::audit::{Audit, Findings};
use umi_client::journal::{self, PullStep};
use umi_client::problem::Problem;
use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::job::Job;
use umi_protocol::message::{Record, Status};
use umi_protocol::pattern::Coding;
use umi_protocol::program::Withheld;
use umi_protocol::verdict::Verdict;

use crate::rig::Rig;

/// Five clampings of one part.
pub const SESSION: &str = include_str!("../reference/sessions/session_a.txt");
/// XON, and READ.
pub const DC1: &[u8] = &[0x11];
/// The control wants no more.
pub const XOFF: &[u8] = &[0x13];
/// Characters that a control takes after it has said XOFF.
pub const TEN: usize = 10;
/// Nothing takes so long on the wall, on any machine.
const HANGS: Duration = Duration::from_secs(900);

/// Every case on every board: the virtual one, the image in QEMU, the emulated Pico. A case
/// takes a board without a job that was just switched on.
#[macro_export]
macro_rules! on_every_board {
    ($($case:ident)*) => {
        mod on_the_virtual_board {
            $(#[test]
            fn $case() {
                super::$case(&mut $crate::rig::VirtualRig::start().unwrap());
            })*
        }
        mod on_qemu {
            $(#[test]
            fn $case() {
                if let Some(mut rig) = $crate::rig::QemuRig::start_or_skip() {
                    super::$case(&mut rig);
                }
            })*
        }
        mod on_the_emulated_pico {
            $(#[test]
            fn $case() {
                if let Some(mut rig) = $crate::rig::PicoRig::start_or_skip() {
                    super::$case(&mut rig);
                }
            })*
        }
    };
}

/// The job of the session.
pub fn job() -> Job {
    toml::from_str(include_str!("../../examples/three-spheres.toml")).unwrap()
}

/// The text of one clamping of the session.
pub fn clamping(case: usize) -> String {
    let lines = SESSION.split_inclusive('\n');
    lines.skip(27 * case).take(27).collect()
}

/// A time of the board's, in this world's.
pub fn patience(rig: &dyn Rig, board: Duration) -> Duration {
    board * rig.slowness()
}

/// A host that is as patient as the board is slow.
pub fn connect(rig: &mut dyn Rig) -> Client {
    let answer = patience(rig, Duration::from_secs(2));
    let patience = Patience { answer, tries: 3 };
    Client::with_patience(rig.connect(), patience).unwrap()
}

/// Asks until it is so.
pub fn until<T>(
    rig: &mut dyn Rig,
    what: &str,
    mut ask: impl FnMut(&mut dyn Rig) -> Option<T>,
) -> T {
    let (begun, wall) = (rig.time(), Instant::now());
    loop {
        if let Some(answer) = ask(rig) {
            return answer;
        }
        let waited = rig.time().saturating_sub(begun);
        assert!(
            waited < Duration::from_secs(10) && wall.elapsed() < HANGS,
            "{}: {what} has not come in {waited:?}",
            rig.name()
        );
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Waits until the board has judged so often.
pub fn judged(rig: &mut dyn Rig, client: &mut Client, verdicts: u32) -> Status {
    until(rig, "a verdict", |_| {
        Some(client.status().unwrap()).filter(|status| status.verdicts >= verdicts)
    })
}

/// The whole journal: every record, and what its audit finds.
pub fn journal(client: &mut Client) -> (Vec<Record>, Findings) {
    let mut audit = Audit::default();
    let mut records = Vec::new();
    let stretch = journal::pull(client, journal::PullRequest::default(), |step| {
        if let PullStep::Entry(entry, _) = step {
            let record = journal::record(&entry).unwrap();
            audit.take(&entry, &record);
            records.push(record);
        }
        Ok::<_, Problem>(())
    });
    (records, audit.finish(stretch.unwrap().stretch.next))
}

/// Every byte of the control that a journal holds.
pub fn raw_bytes(records: &[Record]) -> Vec<u8> {
    let raw = records.iter().filter_map(|record| match record {
        Record::Bytes { raw } => Some(raw.as_slice()),
        _ => None,
    });
    raw.flatten().copied().collect()
}

/// Waits until the journal holds as many bytes of the control, then pulls it.
pub fn journal_with(
    rig: &mut dyn Rig,
    client: &mut Client,
    bytes: usize,
) -> (Vec<Record>, Findings) {
    until(rig, "the last byte", |_| {
        let counters = client.status().unwrap().counters;
        (counters.bytes >= bytes as u64).then_some(())
    });
    journal(client)
}

/// What goes to the control until it is quiet.
pub fn receive_all(rig: &mut dyn Rig) -> String {
    if rig.has_own_time() {
        let mut text = String::new();
        while let Some(byte) = rig.control_receives(Duration::from_millis(50)) {
            text.push(char::from(byte));
        }
        return text;
    }
    let slowness = rig.slowness();
    until_quiet(slowness, |patience| rig.control_receives(patience))
}

/// What comes until it is quiet for 50 ms of a machine that keeps up. On a loaded one a board is
/// silent because nobody lets it run, and so is whoever waits for it: a wait that ends late says
/// nothing about silence. After three seconds without a character it is quiet in any case.
pub fn until_quiet(slowness: u32, mut next: impl FnMut(Duration) -> Option<u8>) -> String {
    const PIECE: Duration = Duration::from_millis(5);
    const PIECES: u32 = 10;
    const IN_ANY_CASE: Duration = Duration::from_secs(3);
    let mut text = String::new();
    let (mut in_time, mut silent_since) = (0, Instant::now());
    while in_time < PIECES && silent_since.elapsed() < IN_ANY_CASE * slowness {
        let begun = Instant::now();
        match next(PIECE) {
            Some(byte) => {
                text.push(char::from(byte));
                (in_time, silent_since) = (0, Instant::now());
            }
            None if begun.elapsed() < 2 * PIECE * slowness => in_time += 1,
            None => in_time = 0,
        }
    }
    text
}

/// A program for the control, whenever it comes: from `%` to the line of the second one. Silence
/// is no end, as a loaded machine is silent, too.
pub fn receive_program(rig: &mut dyn Rig) -> String {
    let mut text = String::new();
    while !(text.matches('%').count() == 2 && text.ends_with('\n')) {
        let byte = rig.control_receives(Duration::from_secs(2));
        text.push(char::from(byte.expect("the program goes on to its end")));
    }
    text
}

/// What READ gets without an OK verdict: it raises an alarm.
pub fn alarm() -> String {
    alarm_for(&Withheld::NoVerdict)
}

/// What READ gets in place of a correction, for this reason.
pub fn alarm_for(why: &Withheld) -> String {
    umi_core::correction::alarm(&job().correction.unwrap(), why, None, Coding::Ascii)
        .unwrap()
        .as_str()
        .to_owned()
}

/// So many characters for the control.
pub fn receive(rig: &mut dyn Rig, count: usize) -> String {
    let soon = Duration::from_secs(2);
    let next = |_| rig.control_receives(soon).expect("the program goes on");
    (0..count).map(next).map(char::from).collect()
}

/// Asks for a program and says XOFF when so many characters have come: what came until the
/// line was quiet, by the ten-character rule wherever that can be seen.
pub fn stopped(rig: &mut dyn Rig, asks: &[u8], count: usize) -> String {
    // A line that takes no time would be empty before XOFF is there.
    let is_held = rig.control_takes(Some(count as u32));
    rig.control_sends(asks);
    let mut got = receive(rig, count);
    rig.control_sends(XOFF);
    rig.control_takes(None);
    let after = receive_all(rig);
    assert!(
        after.len() <= TEN || !(is_held || rig.line_takes_time()),
        "{} after XOFF at {count}",
        after.len()
    );
    got += &after;
    got
}

/// This text for the control, whenever it comes, and nothing behind it.
pub fn receive_text(rig: &mut dyn Rig, text: &str) {
    assert_eq!(receive(rig, text.len()), text);
    assert_eq!(receive_all(rig), "");
}

/// Decisions of this text, as the same code comes to them on the host.
pub fn decisions(text: &str) -> Vec<Record> {
    let mut brain = Brain::new(job()).unwrap();
    let mut decisions = Vec::new();
    brain.bytes(Micros(1), text.as_bytes(), &mut |output| match output {
        Output::Feature(feature) => decisions.push(Record::Feature(feature.clone())),
        Output::Verdict(verdict) => decisions.push(Record::Verdict(verdict.clone())),
        _ => {}
    });
    decisions
}

/// Teaches the reference with the first clamping and measures the second.
pub fn measure_two(rig: &mut dyn Rig, client: &mut Client) -> Verdict {
    client.set_job(&job()).unwrap().unwrap();
    rig.control_sends((clamping(0) + &clamping(1)).as_bytes());
    judged(rig, client, 2);
    client.verdict().unwrap().unwrap()
}
