//! No count of the emulated Pico's encoders is lost, and what makes them wrong is told.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_tests::rig::pico::{AXES, CYCLES_PER_US, PicoRig, Segment};

/// The rate that the board claims: 10 million counts a second.
const CLAIMED_CYCLES_PER_COUNT: f64 = 12.5;
/// Where it must break, and say so: 14 million counts a second.
const TOO_FAST_CYCLES_PER_COUNT: f64 = 9.0;
/// How long the wall may take for a test.
const PATIENCE: Duration = Duration::from_secs(900);

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
    let mut client = rig.client();
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
    let mut client = rig.client();
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
    let mut client = rig.client();
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
