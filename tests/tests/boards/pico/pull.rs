//! How fast a Pico's journal is pulled over its USB, by the emulator's cycles: where it signs heads, and where
//! it has no key and signs nothing, as every board did before there were any.
//!
//! Two times are told: from a request of the host's to the last packet of its answer, summed up, which is the
//! board's and the wire's alone; and all of the pull, in which the host thinks between two requests.

use std::time::Duration;

use serde_json::json;
use umi_client::journal::{self, PullRequest, PullStep};
use umi_client::problem::Problem;
use umi_protocol::message::Record;
use umi_tests::cases::{DC1, clamping, job, judged};
use umi_tests::rig::pico::{CYCLES_PER_US, Emulator, EmulatorState, PicoRig};
use umi_tests::rig::{Rig as _, skip_without};

use crate::owner::host;

/// What a pull has brought, and what it took.
struct Pull {
    bytes: usize,
    heads: u32,
    /// Until the last answer was out, but for what the host thought.
    answers_us: u64,
    all_us: u64,
    /// In which the core did not sleep.
    worked_us: u64,
}

impl Pull {
    fn bytes_a_second(&self) -> f64 {
        self.bytes as f64 * 1e6 / self.answers_us as f64
    }

    fn tell(&self, of: &str) {
        println!(
            "{of}: {} bytes, {} heads, in {} us of answers: {:.0} bytes a second; {} us in all, of which the core worked {} us",
            self.bytes,
            self.heads,
            self.answers_us,
            self.bytes_a_second(),
            self.all_us,
            self.worked_us
        );
    }
}

/// Cycles for which the host waited for the board's packets since this was asked last.
fn answering(emulator: &mut Emulator) -> u64 {
    let answer = emulator.ask(&json!({ "do": "packets" }));
    // The cycle of each, and bytes from the board or, below zero, to it.
    let packets: Vec<(u64, i64)> = serde_json::from_value(answer["packets"].clone()).unwrap();
    let waits = packets.windows(2).filter(|pair| pair[1].1 > 0);
    waits.map(|pair| pair[1].0 - pair[0].0).sum()
}

fn pulled(rig: &mut PicoRig, with_head: bool) -> Pull {
    let mut client = host(rig);
    answering(rig.emulator());
    let before = rig.emulator().state();
    let (mut bytes, mut heads) = (0, 0);
    let wanted = PullRequest {
        head: with_head,
        ..PullRequest::default()
    };
    let pull = journal::pull(&mut client, wanted, |step| {
        if let PullStep::Entry(entry, raw) = step {
            bytes += raw.len();
            heads += u32::from(matches!(journal::record(&entry), Ok(Record::Head(_))));
        }
        Ok::<_, Problem>(())
    });
    assert_eq!(pull.unwrap().head.is_some(), with_head);
    let after = rig.emulator().state();
    let worked = |of: &EmulatorState| of.cycle - of.slept_cycles;
    Pull {
        bytes,
        heads,
        answers_us: answering(rig.emulator()) / CYCLES_PER_US,
        all_us: (after.cycle - before.cycle) / CYCLES_PER_US,
        worked_us: (worked(&after) - worked(&before)) / CYCLES_PER_US,
    }
}

/// A board with so many clampings of the session in its journal.
fn board(has_key: bool, clampings: usize) -> Option<PicoRig> {
    let mut rig = skip_without(if has_key {
        PicoRig::start()
    } else {
        PicoRig::without_key(|emulator| {
            emulator.ask(&json!({ "do": "noise", "stuck": [1] }));
        })
    })?;
    let mut client = host(&mut rig);
    client.set_job(&job()).unwrap().unwrap();
    for number in 0..clampings {
        rig.control_sends(clamping(number).as_bytes());
        judged(&mut rig, &mut client, number as u32 + 1);
        // While a correction waits nothing is signed.
        rig.control_sends(DC1);
        rig.wait_for_quiet();
        while rig.control_receives(Duration::ZERO).is_some() {}
    }
    drop(client);
    Some(rig)
}

/// Bytes a second: some 20 % below what it was measured to be.
const LEAST: f64 = 80_000.0;

#[test]
fn a_journal_comes_as_fast_as_it_was_measured() {
    if let Some(mut rig) = board(true, 1) {
        let pull = pulled(&mut rig, false);
        pull.tell("a clamping");
        assert!(pull.heads > 0 && pull.bytes_a_second() > LEAST);
    }
}

/// The figures of `tests/bench/WEAR.md`, by hand: a session's five clampings.
#[test]
#[ignore = "figures: cargo test --release -p umi-tests --test boards pull -- --ignored --nocapture"]
fn figures_of_a_pull() {
    for has_key in [false, true] {
        let Some(mut rig) = board(has_key, 5) else {
            return;
        };
        for with_head in [false, true].into_iter().filter(|with| has_key || !with) {
            let pull = pulled(&mut rig, with_head);
            pull.tell(&format!("key {has_key}, a head at the end {with_head}"));
        }
    }
}
