//! What a shift costs a board's flash, and how fast its journal is pulled: with signed heads, and on a
//! board without a key, as every board was before there were any.
//!
//! The virtual board's areas are those of a Pico: 2 MB of journal and 1 MB of evidence in sectors of
//! 64 KB. What is written is counted, and is the same on every run; seconds are this machine's, without a
//! cable.

use std::time::{Duration, Instant};

use umi_client::board::link::Client;
use umi_client::journal::{self, PullRequest, PullStep};
use umi_client::problem::Problem;
use umi_core::journal::Geometry;
use umi_core::units::Micros;
use umi_tests::cases::{DC1, clamping, job};
use umi_virtual::board::{JOURNAL, KEY, Wear};
use umi_virtual::{Config, VirtualBoard, VirtualFlash};

/// Of the board's time from one clamping to the next.
const BETWEEN: Duration = Duration::from_secs(180);

/// As a control prints it: a clamping of the session, each time a little farther along X, because text
/// that is the same to the last digit is taken for an old one.
fn printed(number: usize) -> String {
    let farther = 0.001 * (number / 5) as f64;
    let moved = |line: &str| -> Option<String> {
        let (x, others) = line.strip_prefix('*')?.split_once('*')?;
        let x: f64 = x.trim().parse().ok()?;
        Some(format!("*{:.4}*{others}", x + farther))
    };
    let text = clamping(number % 5);
    let lines = text.split_inclusive('\n');
    lines
        .map(|line| moved(line).unwrap_or_else(|| line.to_owned()))
        .collect()
}

/// What a shift has cost.
#[derive(Clone, Copy, Debug)]
struct Shift {
    journal: Wear,
    evidence: Wear,
    /// Keys, settings, what is kept for the owner.
    others: Wear,
    corrections: u32,
    heads: u32,
    pulled_bytes: usize,
    pull: Duration,
}

impl Shift {
    fn bytes(&self) -> u64 {
        self.journal.bytes + self.evidence.bytes + self.others.bytes
    }

    fn erases(&self) -> u64 {
        self.journal.erases + self.evidence.erases + self.others.erases
    }
}

fn sum(of: &[Option<&VirtualFlash>]) -> Wear {
    of.iter()
        .flatten()
        .map(|flash| flash.wear())
        .fold(Wear::default(), |sum, of| Wear {
            programs: sum.programs + of.programs,
            bytes: sum.bytes + of.bytes,
            erases: sum.erases + of.erases,
        })
}

/// The whole journal, as `umi log pull` has it: bytes of its entries, and how many are heads.
fn pulled(client: &mut Client, with_head: bool) -> (usize, u32) {
    let (mut bytes, mut heads) = (0, 0);
    let wanted = PullRequest {
        head: with_head,
        ..PullRequest::default()
    };
    journal::pull(client, wanted, |step| {
        if let PullStep::Entry(entry, _) = step {
            bytes += entry.payload.len() + umi_core::journal::OVERHEAD;
            heads += u32::from(entry.kind == 24);
        }
        Ok::<_, Problem>(())
    })
    .unwrap();
    (bytes, heads)
}

/// So many clampings, each judged, and corrected where it is OK.
fn shift(clampings: usize, has_key: bool) -> Shift {
    let config = Config {
        journal: VirtualFlash::in_memory(Geometry {
            sectors: 32,
            ..JOURNAL
        }),
        key: has_key.then(|| VirtualFlash::in_memory(KEY)),
        ..Config::default()
    };
    let board = VirtualBoard::start(config.clone()).unwrap();
    let mut client = umi_desk::client(&board).unwrap();
    client.set_job(&job()).unwrap().unwrap();
    let mut corrections = 0;
    for number in 0..clampings {
        board.control_sends(printed(number).as_bytes());
        let begun = Instant::now();
        let status = loop {
            let status = client.status().unwrap();
            if status.verdicts as usize > number {
                break status;
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "{status:?}");
        };
        assert_eq!(
            status.last_verdict_ok,
            Some(true),
            "clamping {number}: {:?}",
            client.verdict()
        );
        if status.correction_waiting {
            board.control_sends(DC1);
            let mut text = Vec::new();
            while text.iter().filter(|byte| **byte == b'%').count() < 2 {
                text.push(
                    board
                        .control_receives(Duration::from_secs(5))
                        .expect("more of it"),
                );
            }
            corrections += 1;
        }
        // The rest of the text, what is written behind it, and the head.
        for _ in 0..3 {
            let pause = u64::try_from(BETWEEN.as_micros()).unwrap() / 3;
            board.advance(Micros(board.now().0 + pause));
            while board.control_receives(Duration::from_millis(10)).is_some() {}
        }
    }
    let others = sum(&[
        Some(&config.settings),
        config.custody.as_ref(),
        config.access.as_ref(),
        config.key.as_ref(),
    ]);
    let (journal, evidence) = (config.journal.wear(), sum(&[config.evidence.as_ref()]));
    let begun = Instant::now();
    let (pulled_bytes, heads) = pulled(&mut client, has_key);
    Shift {
        journal,
        evidence,
        others,
        corrections,
        heads,
        pulled_bytes,
        pull: begun.elapsed(),
    }
}

/// A head for each verdict is not dear: what signing adds to the bytes that a shift writes is held, and
/// so is that it costs no erasure of its own.
#[test]
fn signing_wears_little() {
    const CLAMPINGS: usize = 10;
    let [before, after] = [false, true].map(|has_key| shift(CLAMPINGS, has_key));
    assert_eq!((before.heads, before.corrections), (0, after.corrections));
    assert!(after.heads as usize >= CLAMPINGS && after.heads as usize <= 2 * CLAMPINGS + 3);
    let more = after.bytes() as f64 / before.bytes() as f64;
    assert!((1.05..1.35).contains(&more), "{more}: {before:?} {after:?}");
}

/// The figures of `tests/bench/WEAR.md`, by hand: a shift of eight hours, a clamping each three minutes.
#[test]
#[ignore = "figures: cargo test --release -p umi-tests --test keep wear -- --ignored --nocapture"]
fn figures_of_a_shift() {
    for has_key in [false, true] {
        let of = shift(160, has_key);
        let name = if has_key {
            "with heads"
        } else {
            "without a key"
        };
        println!(
            "{name}: {} corrections, {} heads; journal {:?}, evidence {:?}, others {:?}; in all {} bytes, {} erases; \
             pulled {} bytes in {:.3} s, {:.0} bytes a second",
            of.corrections,
            of.heads,
            of.journal,
            of.evidence,
            of.others,
            of.bytes(),
            of.erases(),
            of.pulled_bytes,
            of.pull.as_secs_f64(),
            of.pulled_bytes as f64 / of.pull.as_secs_f64(),
        );
    }
}
