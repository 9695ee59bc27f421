//! More than the board of an emulated Pico can capture: too fast, noise, and while it fails to
//! keep up with its encoders. Every edge is captured or counted.

use umi_client::board::link::Client;
use umi_protocol::latch::{LatchCause, LatchCounters};
use umi_protocol::message::Record;
use umi_tests::cases::{SESSION, journal};
use umi_tests::rig::Rig as _;
use umi_tests::rig::pico::{AXES, CYCLES_PER_US, EmulatedPulses, PicoRig, SKIP_PIN, TRIGGER_PIN};

use super::captures::{CYCLES_PER_MS, FAST, begun, counters, listen, one_more, triggers};

/// Captures a second that the board gives a scanner, at most.
const SCANS_PER_S: u64 = 12_000;

/// Triggers come faster than the board captures: as many as it promises are captured even
/// so, every other one is counted as missed, and each that was captured is either told or
/// counted as untold.
#[test]
fn triggers_that_come_too_fast_are_counted() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    let mut before = LatchCounters::default();
    for (count, per_s) in [(2_000, 15_625), (4_000, 100_000)] {
        let period = 1_000_000 * CYCLES_PER_US / per_s;
        let mut found = triggers(&mut rig, &mut client, count, period);
        // How many were missed after the last one that was captured, the next one tells.
        let end = one_more(&mut rig, TRIGGER_PIN);
        let count = count + 1;
        found.extend(listen(&mut rig, &mut client, end, |_| false));
        let now = counters(&mut rig, &mut client);
        let captured = now.triggers - before.triggers;
        let missed = now.missed - before.missed;
        let untold = now.untold - before.untold;
        println!("{per_s} a second: {captured} captured, {missed} missed, {untold} untold");
        assert_eq!(u64::from(captured + missed), count);
        let told = found.iter().filter(|latch| !latch.counts.is_empty());
        assert_eq!(told.count() as u64, u64::from(captured - untold));
        let told_missed: u32 = found.iter().map(|latch| latch.missed).sum();
        if untold == 0 {
            assert_eq!(told_missed, missed, "the host is told how many");
        }
        assert!(missed > 0, "not too fast");
        let promised = SCANS_PER_S * count / per_s;
        assert!(
            u64::from(captured) > promised * 8 / 10,
            "{captured} of {promised}"
        );
        before = now;
    }
}

/// The bus keeps the decoders from their memory for a few microseconds, over and over, while
/// the axes move and edges come: the board sees it, starts anew with whole counts, says that
/// its positions are no longer valid, and every edge is either captured or counted.
#[test]
fn lost_samples_are_told_and_no_edge_vanishes() {
    const HOLDS: u64 = 30;
    /// Not counted while all machines are started anew, at most.
    const START_COUNTS: u64 = 250;
    let Some((mut rig, mut client)) = begun() else {
        return;
    };
    assert!(client.positions().unwrap().are_valid());
    // At rest nothing is lost but time.
    rig.emulator().hold_transfers(5 * CYCLES_PER_US);
    let now = rig.emulator().state().cycle;
    rig.wait_for_cycle(now + 5 * CYCLES_PER_MS);
    let positions = client.positions().unwrap();
    assert_eq!(positions.counts.as_slice(), [0; AXES]);
    assert_eq!((positions.lost_samples, positions.are_valid()), (1, false));

    let count = 300;
    let period = CYCLES_PER_MS;
    rig.move_all((count + 10) * period, FAST);
    let mut start = 0;
    let (skips, triggers) = (count / 5, count);
    for (pin, count, after) in [(SKIP_PIN, skips, 0), (TRIGGER_PIN, triggers, period / 3)] {
        let period = triggers / count * period;
        start = rig.emulator().pulses(&EmulatedPulses {
            pin,
            count,
            period,
            jitter: period / 2,
            width: 10 * CYCLES_PER_US,
            after,
            is_recorded: false,
        });
    }
    for nth in 1..=HOLDS {
        rig.wait_for_cycle(start + nth * 10 * period);
        // Also longer than a ring of samples.
        rig.emulator().hold_transfers((5 + nth * 4) * CYCLES_PER_US);
    }
    rig.wait_for_cycle(start + (count + 20) * period);
    let positions = client.positions().unwrap();
    let axes = rig.emulator().axes();
    // Some are over only after the board has started anew, which it does once more then.
    let lost = u64::from(positions.lost_samples);
    assert!((HOLDS + 1..=2 * HOLDS + 1).contains(&lost), "{lost}");
    assert!(!positions.are_valid());
    for (axis, truth) in axes.iter().enumerate() {
        // What a start takes, at a million counts a second.
        let off = (positions.counts[axis] - truth.position).unsigned_abs();
        println!("axis {axis}: {off} counts lost in {HOLDS} starts");
        assert!(
            off <= lost * START_COUNTS,
            "axis {axis} is {off} counts off"
        );
    }
    let counters = counters(&mut rig, &mut client);
    println!("{counters:?}");
    // An edge within 50 us of a start may count twice, none not at all: with 1.2 edges a millisecond
    // that is one start of sixteen, in the mean.
    let counted = u64::from(counters.skips + counters.triggers + counters.missed);
    let edges = skips + triggers;
    assert!(
        (edges..=edges + lost / 4).contains(&counted),
        "{counted} of {edges}"
    );
    assert!(u64::from(counters.missed) < edges / 10);
}

/// The probe's line bounces while the board starts anew. What comes in those 0.1 to 0.2 ms is told at each
/// start at least once, falls as well as rises: else a touch might stand at a bounce behind it.
#[test]
fn a_start_tells_falls_of_the_probe_as_well_as_rises() {
    const STARTS: u64 = 24;
    /// One in 25 us: there are some in each start.
    const BOUNCES: u64 = 600;
    let Some((mut rig, mut client)) = begun() else {
        return;
    };
    // Ends of touches are kept where a job asks for them.
    let witnessed = include_str!("../../../../../examples/three-spheres-witnessed.toml");
    let job = toml::from_str(witnessed).unwrap();
    client.set_job(&job).unwrap().unwrap();
    for nth in 0..STARTS {
        let start = rig.emulator().pulses(&EmulatedPulses {
            pin: SKIP_PIN,
            count: BOUNCES,
            period: 25 * CYCLES_PER_US,
            jitter: 10 * CYCLES_PER_US,
            width: (2 + nth % 10) * CYCLES_PER_US,
            after: 0,
            is_recorded: false,
        });
        rig.wait_for_cycle(start + CYCLES_PER_MS);
        rig.emulator().hold_transfers(5 * CYCLES_PER_US);
        rig.wait_for_cycle(start + 40 * CYCLES_PER_MS);
    }
    rig.wait_for_quiet();
    let lost = u64::from(client.positions().unwrap().lost_samples);
    assert!(lost >= STARTS, "{lost}");
    let counters = counters(&mut rig, &mut client);
    let rises = u64::from(counters.skips + counters.missed);
    let (records, _) = journal(&mut client);
    let falls = records.iter().filter_map(|record| match record {
        Record::Latch(latch) if latch.cause == LatchCause::SkipEnd => Some(latch),
        _ => None,
    });
    let falls = falls.map(|latch| u32::from(!latch.counts.is_empty()) + latch.missed);
    let falls = u64::from(falls.sum::<u32>());
    let edges = STARTS * BOUNCES;
    println!("{rises} rises, {falls} falls of {edges}, {counters:?}");
    // In a start of 0.2 ms there are eight, of which some are told.
    for counted in [rises, falls] {
        assert!(edges.abs_diff(counted) < 6 * lost, "{counted} of {edges}");
    }
    assert!(rises.abs_diff(falls) < lost / 2, "{rises} and {falls}");
}

/// A probe's line that is nothing but noise, at a megahertz, while the control sends: no
/// byte is lost, the host is answered, and every edge is counted. A scanner's line that is
/// so does not hold the board either.
#[test]
fn noise_on_a_line_harms_nothing_else() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    let job = toml::from_str(include_str!("../../../../../examples/three-spheres.toml")).unwrap();
    client.set_job(&job).unwrap().unwrap();
    let lines: Vec<&str> = SESSION.split_inclusive('\n').take(108).collect();
    let text = lines.concat();
    rig.wait_for_quiet();
    rig.control_sends(text.as_bytes());
    let skips = noise(&mut rig, &mut client, SKIP_PIN);
    let sent = text.len() as u64;
    let end = rig.emulator().state().cycle + 3_000 * CYCLES_PER_MS;
    while client.status().unwrap().counters.bytes < sent {
        let state = rig.emulator().state();
        assert!(state.cycle < end, "{:?}", client.status());
    }
    let status = client.status().unwrap();
    let counters = status.counters;
    assert_eq!((counters.bytes, counters.bytes_lost), (sent, 0));
    rig.wait_for_quiet();
    let both = noise(&mut rig, &mut client, TRIGGER_PIN);
    let counted = |of: &LatchCounters| of.skips + of.triggers + of.missed;
    assert_eq!(
        (counted(&skips), counted(&both)),
        (NOISE + 1, 2 * (NOISE + 1))
    );
    assert!(u64::from(both.triggers) > SCANS_PER_S * u64::from(NOISE) / 1_000_000 / 2);
    let state = rig.emulator().state();
    assert_eq!((state.overruns, state.resets), (0, 0));
}

/// Edges of noise: 0.2 s.
const NOISE: u32 = 200_000;

/// Edges at a megahertz, and one more when they are over, which tells how many were missed
/// after the last capture. What the board has counted then.
fn noise(rig: &mut PicoRig, client: &mut Client, pin: u8) -> LatchCounters {
    let start = rig.emulator().pulses(&EmulatedPulses {
        pin,
        count: NOISE.into(),
        period: CYCLES_PER_US,
        jitter: CYCLES_PER_US / 4,
        width: CYCLES_PER_US / 3,
        after: 0,
        is_recorded: false,
    });
    let end = start + u64::from(NOISE) * CYCLES_PER_US;
    client.status().unwrap();
    let answered = rig.emulator().state().cycle;
    println!(
        "answered {} ms before the noise is over",
        end.saturating_sub(answered) / CYCLES_PER_MS
    );
    assert!(answered < end, "the host is answered");
    rig.wait_for_cycle(end + CYCLES_PER_MS);
    let end = one_more(rig, pin);
    rig.wait_for_cycle(end);
    let now = counters(rig, client);
    println!("{now:?}");
    now
}
