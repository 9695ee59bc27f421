//! The board's image on an emulated Pico, with real waveforms at its pins: what it
//! promises beyond what all boards have in common.
//!
//! The long forms are run by `cargo test -p umi-tests --test pico -- --ignored --nocapture`.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi::link::{Client, Patience};
use umi_protocol::latch::{LatchCause, LatchReport};
use umi_protocol::message::{Event, Record};
use umi_tests::rig::Rig;
use umi_tests::rig::pico::{
    AXES, CYCLES_PER_US, PicoRig, Pulses, SKIP_PIN, Segment, TRIGGER_PIN, Truth,
};

/// The rate that the board claims: 10 million counts a second.
const CLAIMED_CYCLES_PER_COUNT: f64 = 12.5;
/// Where it must break, and say so: 14 million counts a second.
const TOO_FAST_CYCLES_PER_COUNT: f64 = 9.0;
/// A time stamp is within this of the others: 100 ns.
const STAMP_NS: i64 = 100;
/// A latched position is one that the axis had at most so many cycles from the edge: 100 ns.
const NEAR_CYCLES: u64 = 12;
/// How long the wall may take for a test.
const PATIENCE: Duration = Duration::from_secs(900);

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

fn wait_for_axes(rig: &mut PicoRig) {
    wait_until("a motion", || {
        !rig.emulator().axes().iter().any(|axis| axis.is_moving)
    });
    let end = rig.emulator().state().cycle + 2000 * CYCLES_PER_US;
    wait_until("a rest", || rig.emulator().state().cycle > end);
}

/// Up, down and up again, with rests, all at once and each axis at a phase of its own.
fn shuttle(rig: &mut PicoRig, edges: u64, cycles_per_count: f64, options: &serde_json::Value) {
    let part = |edges: u64, up: bool| Segment::Move {
        edges,
        from: cycles_per_count,
        to: cycles_per_count,
        up,
    };
    for axis in 0..AXES {
        let segments = [
            Segment::Rest(axis as u64 * 333),
            part(edges / 2, axis % 2 == 0),
            part(edges / 4, axis % 2 != 0),
            Segment::Rest(1000),
            part(edges / 4, axis % 2 == 0),
        ];
        rig.emulator().start_axis(axis, &segments, options);
    }
}

fn no_count_is_lost(edges_per_axis: u64) {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    shuttle(
        &mut rig,
        edges_per_axis,
        CLAIMED_CYCLES_PER_COUNT,
        &json!({}),
    );
    wait_for_axes(&mut rig);
    let axes = rig.emulator().axes();
    let positions = client.positions().unwrap();
    let true_positions: Vec<i64> = axes.iter().map(|axis| axis.position).collect();
    assert_eq!(positions.counts.as_slice(), true_positions);
    assert_eq!(positions.illegal.as_slice(), [0; AXES]);
    assert_eq!(positions.lost_samples, 0);
    let edges: u64 = axes.iter().map(|axis| axis.edges).sum();
    let speed = rig.emulator().state().cycles_per_second;
    println!("{edges} edges, none lost; {speed} emulated cycles a second");
}

/// Ten million edges on four axes at once, at the claimed rate, up and down: every one is
/// counted.
#[test]
fn no_count_is_lost_at_the_claimed_rate() {
    no_count_is_lost(2_500_000);
}

/// The same with ten million edges on each axis.
#[test]
#[ignore = "a minute of emulation"]
fn no_count_is_lost_at_the_claimed_rate_long() {
    no_count_is_lost(10_000_000);
}

/// Faster than it can, the board counts what it cannot tell, and names the axis.
#[test]
fn a_loss_is_counted_at_the_rate_where_it_breaks() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    let segments = [Segment::steady(200_000, TOO_FAST_CYCLES_PER_COUNT)];
    rig.emulator().start_axis(2, &segments, &json!({}));
    wait_for_axes(&mut rig);
    let positions = client.positions().unwrap();
    assert_ne!(positions.counts[2], 200_000);
    assert!(positions.illegal[2] > 0, "{positions:?}");
    assert_eq!(positions.illegal[1], 0);
    assert_eq!(positions.counts[1], 0);
}

/// Contacts that bounce and pulses shorter than a sample change nothing; edges that are
/// missing are counted, each one.
#[test]
fn bounce_glitches_and_missing_edges() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    shuttle(
        &mut rig,
        20_000,
        200.0,
        &json!({ "bounce": 0.3, "bounceCycles": 7, "glitch": 0.3, "glitchCycles": 5 }),
    );
    wait_for_axes(&mut rig);
    let truth = rig.emulator().axes();
    let positions = client.positions().unwrap();
    for (axis, truth) in truth.iter().enumerate() {
        assert_eq!(positions.counts[axis], truth.position, "axis {axis}");
    }
    let before = positions.illegal;
    let segments = [Segment::steady(10_000, 100.0)];
    rig.emulator()
        .start_axis(0, &segments, &json!({ "skipEvery": 100 }));
    wait_for_axes(&mut rig);
    let skipped = rig.emulator().axes()[0].illegal;
    let positions = client.positions().unwrap();
    assert_eq!(u64::from(positions.illegal[0] - before[0]), skipped);
    assert_eq!(skipped, 100);
}

/// How far latches are from the truth.
struct Distances {
    /// Of the time stamps from that of the edge in the emulator, which began to count at
    /// another instant: sorted.
    time_ns: Vec<i64>,
    /// Of the positions, per axis and latch.
    exact: usize,
    near: usize,
    worst_counts: i64,
}

/// Holds latches against the truth: each to its edge, in their order.
fn compare(latches: &[LatchReport], truth: &[Truth]) -> Distances {
    assert_eq!(latches.len(), truth.len(), "captured and sent");
    let mut found = Distances {
        time_ns: Vec::new(),
        exact: 0,
        near: 0,
        worst_counts: 0,
    };
    for (number, (latch, truth)) in latches.iter().zip(truth).enumerate() {
        assert_eq!(latch.missed, 0, "at {number}");
        let edge_ns = i64::try_from(truth.cycle * 8).unwrap();
        found
            .time_ns
            .push(i64::try_from(latch.t_ns).unwrap() - edge_ns);
        for axis in 0..AXES {
            let error = latch.counts[axis] - truth.positions[axis];
            found.worst_counts = found.worst_counts.max(error.abs());
            if error == 0 {
                found.exact += 1;
                continue;
            }
            // The count next to it in time is as good as the sample next to the edge.
            let since = truth.since[axis];
            let until = truth.until[axis].unwrap_or(u64::MAX);
            assert!(
                since.min(until) <= NEAR_CYCLES,
                "axis {axis} of latch {number} is {error} counts off, {since} cycles after \
                 an edge of the encoder and {until} before the next"
            );
            found.near += 1;
        }
    }
    found.time_ns.sort_unstable();
    found
}

impl Distances {
    fn report(&self, what: &str) -> i64 {
        let (first, last) = (self.time_ns[0], *self.time_ns.last().unwrap());
        let median = self.time_ns[self.time_ns.len() / 2];
        println!(
            "{what}: {} latches; time stamps {first} to {last} ns after the edge, median {median}; \
             positions {} exact, {} of the count at most {NEAR_CYCLES} cycles away, worst {} counts",
            self.time_ns.len(),
            self.exact,
            self.near,
            self.worst_counts
        );
        last - first
    }
}

/// Latches of a cause, until so many have come or none comes any more.
fn latches(client: &mut Client, cause: LatchCause, count: usize) -> Vec<LatchReport> {
    let mut latches: Vec<LatchReport> = Vec::new();
    let mut begun = Instant::now();
    while latches.len() < count && begun.elapsed() < Duration::from_secs(30) {
        let before = latches.len();
        match client.next_event(Duration::from_secs(1)).unwrap() {
            Some(Event::Record {
                record: Record::Latch(latch),
                ..
            }) if latch.cause == cause => latches.push(latch),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            _ => {}
        }
        if latches.len() > before {
            begun = Instant::now();
        }
    }
    latches
}

/// All axes at about a million counts a second, none in step with another or with the
/// samples.
fn move_all(rig: &mut PicoRig, cycles: u64, cycles_per_count: f64) {
    for axis in 0..AXES {
        let pace = cycles_per_count * (1.0 + 0.0037 * axis as f64);
        let counts = (cycles as f64 / pace) as i64;
        let way = if axis % 2 == 0 { counts } else { -counts };
        rig.emulator()
            .start_axis(axis, &[Segment::steady(way, pace)], &json!({}));
    }
}

/// Edges of the probe's line while all axes move at a million counts a second: each latch
/// belongs to its edge, in position and time.
#[test]
fn a_skip_edge_is_latched_where_and_when_it_was() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.live(true).unwrap();
    let (count, period) = (200, 5_000 * CYCLES_PER_US);
    move_all(&mut rig, (count + 2) * period, 125.0);
    rig.emulator().pulses(&Pulses {
        pin: SKIP_PIN,
        count,
        period,
        jitter: period / 2,
        width: 100 * CYCLES_PER_US,
        after: period / 2,
        is_recorded: true,
    });
    let found = latches(&mut client, LatchCause::Skip, count as usize);
    let distances = compare(&found, &rig.emulator().truth());
    let spread = distances.report("skip");
    assert!(spread <= STAMP_NS, "{spread} ns");
    assert!(distances.worst_counts <= 1);
    assert_eq!(client.status().unwrap().latches.missed, 0);
}

/// A scanner's triggers while all axes move at a million counts a second: what comes of
/// them at the host, and the truth about them.
fn triggers(rig: &mut PicoRig, client: &mut Client, count: u64, period: u64) -> Vec<LatchReport> {
    client.live(true).unwrap();
    move_all(rig, (count + 100) * period, 125.0);
    let before = rig.emulator().state();
    rig.emulator().pulses(&Pulses {
        pin: TRIGGER_PIN,
        count,
        period,
        jitter: period / 8,
        width: period / 10,
        after: period,
        is_recorded: true,
    });
    // The last ones wait a few milliseconds for others.
    let end = before.cycle + (count + 2) * period + 20_000 * CYCLES_PER_US;
    let mut found = Vec::new();
    loop {
        let is_over = rig.emulator().state().cycle > end;
        match client.next_event(Duration::from_secs(1)).unwrap() {
            Some(Event::Latches(batch)) => found.extend(batch.reports()),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            None if is_over => break,
            _ => {}
        }
        if found.len() as u64 == count {
            break;
        }
    }
    let after = rig.emulator().state();
    let slept = (after.slept_cycles - before.slept_cycles) as f64;
    let passed = (after.cycle - before.cycle) as f64;
    println!(
        "{count} triggers, one each {} us: {} came, the core slept for {:.0} % of the time",
        period / CYCLES_PER_US,
        found.len(),
        100.0 * slept / passed,
    );
    found
}

fn ten_thousand_triggers_a_second(count: u64) {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    let found = triggers(&mut rig, &mut client, count, 100 * CYCLES_PER_US);
    let counters = client.status().unwrap().latches;
    assert_eq!(found.len() as u64, count, "{counters:?}");
    assert!(
        (0..)
            .zip(&found)
            .all(|(number, latch)| number == latch.number)
    );
    let distances = compare(&found, &rig.emulator().truth());
    let spread = distances.report("trigger");
    assert!(spread <= STAMP_NS, "{spread} ns");
    assert!(distances.worst_counts <= 1);
    assert_eq!(u64::from(counters.triggers), count);
    assert_eq!((counters.missed, counters.untold), (0, 0));
}

/// Ten thousand triggers a second while all axes move: every one is captured, paired with
/// its position and told to the host.
#[test]
fn ten_thousand_triggers_a_second_are_paired_and_told() {
    ten_thousand_triggers_a_second(2_000);
}

/// A hundred thousand of them.
#[test]
#[ignore = "minutes of emulation"]
fn ten_thousand_triggers_a_second_are_paired_and_told_long() {
    ten_thousand_triggers_a_second(100_000);
}

/// Triggers come faster than the board can take them: each is either captured or counted as
/// missed, and each that was captured is either told or counted as untold.
#[test]
fn triggers_that_come_too_fast_are_counted() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    let count = 6_000;
    let found = triggers(&mut rig, &mut client, count, 10 * CYCLES_PER_US);
    let counters = client.status().unwrap().latches;
    println!("{counters:?}");
    assert_eq!(u64::from(counters.triggers + counters.missed), count);
    let captured = found.iter().filter(|latch| !latch.counts.is_empty());
    assert_eq!(
        captured.count() as u64,
        u64::from(counters.triggers - counters.untold)
    );
    assert!(counters.missed + counters.untold > 0, "not too fast");
}
