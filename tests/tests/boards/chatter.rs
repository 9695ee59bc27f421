//! A skip line that chatters, on the virtual board and on the emulated Pico in motion: the touch is
//! the first true edge, to a count, and the rest is counted.
//!
//! What the board has journaled is judged as its brain judges it ([`umi_core::job::skip`]).

use umi_core::job::skip::{Chatter, SkipLine};
use umi_protocol::job::{Guards, Job, SkipSpec};
use umi_protocol::latch::{LatchCause, LatchReport, SignalLevel};
use umi_protocol::message::Record;
use umi_protocol::pattern::{LinePattern, PointLinePattern};
use umi_tests::cases::{connect, journal, judged, raw_bytes, until};
use umi_tests::rig::pico::{CYCLES_PER_US, PicoRig, SKIP_PIN};
use umi_tests::rig::{Rig, VirtualRig};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
/// A million counts a second.
const NS_PER_COUNT: u64 = 1_000;
const CYCLE_NS: u64 = 8;

/// A line's pulses in time: when each begins and how long it is, ns; and what is to come of them.
struct Train {
    name: &'static str,
    active: SignalLevel,
    pulses: Vec<(u64, u64)>,
    /// Which pulse is the touch.
    touch: usize,
    chatter: Chatter,
}

/// Every kind of chatter: bounces of 10 us to 5 ms, a relay, the slow edge of an optocoupler,
/// sparks before the touch and between its bounces, and a line that rests high.
fn trains() -> Vec<Train> {
    let chatter = |bounces, sparks| Chatter { bounces, sparks };
    let train = |name, pulses: &[(u64, u64)], touch, chatter| Train {
        name,
        active: SignalLevel::High,
        pulses: pulses.to_vec(),
        touch,
        chatter,
    };
    let bounces = [
        (0, 10 * US),
        (25 * US, 40 * US),
        (120 * US, 300 * US),
        (MS, 2 * MS),
        (4 * MS, 5 * MS),
        (14 * MS, 30 * MS),
        // The release.
        (44 * MS + 100 * US, 60 * US),
        (46 * MS, 500 * US),
    ];
    let relay = [
        (0, 900 * US),
        (2 * MS, 700 * US),
        (3 * MS + 500 * US, 25 * MS),
    ];
    // Six edges are what the Pico takes at once.
    let slow_edge = [(0, US), (4 * US, 1_500), (17 * US, 20 * MS)];
    let sparks = [
        // The narrowest that the board sees, within the hold-off before the touch.
        (0, 16),
        (3 * MS, 48),
        (5 * MS, 4 * US),
        (9 * MS, 30 * US),
        (9 * MS + 60 * US, 16),
        (9 * MS + 100 * US, 20 * MS),
    ];
    let mut all = vec![
        train("bounces", &bounces, 0, chatter(7, 0)),
        train("a relay", &relay, 0, chatter(2, 0)),
        train("a slow edge", &slow_edge, 2, chatter(0, 2)),
        train("sparks", &sparks, 3, chatter(1, 4)),
    ];
    // Last: from then on the line rests high.
    all.push(Train {
        active: SignalLevel::Low,
        ..train("a line that rests high", &sparks, 3, chatter(1, 4))
    });
    all
}

fn witnessed(active: SignalLevel) -> Job {
    let text = include_str!("../../../examples/three-spheres-witnessed.toml");
    let mut job: Job = toml::from_str(text).unwrap();
    job.skip = SkipSpec {
        active,
        min_width_us: Some(5),
        ..SkipSpec::default()
    };
    job
}

/// What a train was: where the axes were at the first edge of each pulse, and how many edges the
/// line had besides those of the pulses.
type Ran = (Vec<[i64; 3]>, usize);

/// Runs the trains and holds the touch of each to the truth: so many counts may be between.
fn hold<R: Rig>(rig: &mut R, off: i64, mut run: impl FnMut(&mut R, &Train) -> Ran) {
    let mut client = connect(rig);
    let mut job = None;
    let mut seen = 0;
    for train in trains() {
        if job != Some(train.active) {
            // What the board has not, it refuses by name: here it has both.
            client.set_job(&witnessed(train.active)).unwrap().unwrap();
            job = Some(train.active);
        }
        let (truth, more) = run(rig, &train);
        let edges = 2 * train.pulses.len() + more;
        let latches = until(rig, train.name, |_| {
            let (records, _) = journal(&mut client);
            let latches = records.into_iter().filter_map(|record| match record {
                Record::Latch(latch) => Some(latch),
                _ => None,
            });
            let latches: Vec<LatchReport> = latches.skip(seen).collect();
            (latches.len() >= edges).then_some(latches)
        });
        seen += latches.len();
        let missed: u32 = latches.iter().map(|latch| latch.missed).sum();
        assert_eq!((latches.len(), missed), (edges, 0), "{}", train.name);
        let mut line = SkipLine::new(&witnessed(train.active).skip);
        for latch in &latches {
            let mm = std::array::from_fn(|axis| latch.counts[axis] as f64);
            line.latched(latch, Some(mm));
        }
        let touch = line.take().and_then(|touch| touch.mm).expect(train.name);
        let truth = truth[train.touch];
        for (axis, (touch, truth)) in touch.into_iter().zip(truth).enumerate() {
            let away = (touch as i64 - truth).abs();
            assert!(away <= off, "{}: axis {axis}: {away} counts", train.name);
        }
        assert_eq!(line.chatter(), train.chatter, "{}", train.name);
    }
}

#[test]
fn the_first_true_edge_is_the_touch_on_the_virtual_board() {
    let mut rig = VirtualRig::start().unwrap();
    hold(&mut rig, 0, |rig, train| {
        let at = |t_ns: u64| [1, -2, 3].map(|pace| pace * (t_ns / NS_PER_COUNT).cast_signed());
        let (begin, end) = match train.active {
            SignalLevel::High => (LatchCause::Skip, LatchCause::SkipEnd),
            SignalLevel::Low => (LatchCause::SkipEnd, LatchCause::Skip),
        };
        let start = rig.now_ns();
        for (from, width) in &train.pulses {
            rig.edge(begin, start + from, at(*from));
            rig.edge(end, start + from + width, at(from + width));
        }
        (train.pulses.iter().map(|(from, _)| at(*from)).collect(), 0)
    });
}

#[test]
fn the_first_true_edge_is_the_touch_on_the_emulated_pico() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut was = SignalLevel::High;
    // A position is that of the edge or its neighbour (README).
    hold(&mut rig, 1, |rig, train| {
        let cycles = |ns: u64| ns / CYCLE_NS;
        let turns = train.active != was;
        if turns {
            was = train.active;
            // The machine is switched on: an edge, long before the touch.
            let level = u8::from(train.active == SignalLevel::Low);
            let request = serde_json::json!({ "do": "level", "pin": SKIP_PIN, "level": level });
            rig.emulator().ask(&request);
        }
        let (last, width) = train.pulses[train.pulses.len() - 1];
        let lasts = cycles(last + width);
        rig.move_all(lasts + 60_000 * CYCLES_PER_US, cycles(NS_PER_COUNT) as f64);
        let pulses = train.pulses.iter();
        let pulses: Vec<_> = pulses
            .map(|(from, width)| (cycles(30 * MS + from), cycles(*width)))
            .collect();
        let active = train.active == SignalLevel::High;
        let start = rig.emulator().wave(SKIP_PIN, &pulses, active);
        // Whatever moves has come to rest.
        rig.wait_for_cycle(start + lasts + 100_000 * CYCLES_PER_US);
        let truth = rig.emulator().truth();
        let begins = truth.iter().step_by(2);
        let places = begins.map(|truth| std::array::from_fn(|axis| truth.positions[axis]));
        (places.collect(), usize::from(turns))
    });
}

/// Hits of the witnessed job, 15 mm apart.
const HITS: i64 = 15;
const APART_MM: i64 = 15;
/// A hundredth of a machine's: the axes need not go far.
const COUNTS_PER_MM: i64 = 100;

/// The same touches to a job that takes the line's high level for a touch, and to one that takes the low one, at which it rests:
/// the verdict on the second says so. Of where the touches were, neither is OK.
fn names_the_level_at_which_it_rests<R: Rig>(rig: &mut R, mut touch: impl FnMut(&mut R, [i64; 3])) {
    let mut client = connect(rig);
    let mut printed = 0;
    for (number, active) in (1..).zip([SignalLevel::High, SignalLevel::Low]) {
        let mut job = witnessed(active);
        (job.correction, job.guards) = (None, Guards::default());
        job.receiver.patterns.clear();
        let lines = LinePattern::PointLine(PointLinePattern::default());
        job.receiver.patterns.push(lines).unwrap();
        job.skip.min_width_us = Some(0);
        job.skip.hold_off_ms = Some(1);
        let witness = job.witness.as_mut().unwrap();
        witness.counts_per_mm = [COUNTS_PER_MM as f64; 3];
        witness.feed_mm_per_min = Some(50.0);
        client.set_job(&job).unwrap().unwrap();
        for hit in 1..=HITS {
            let skips = client.status().unwrap().latches.skips;
            let place = [hit * APART_MM * COUNTS_PER_MM; 3];
            rig.move_to(&place);
            touch(rig, place);
            until(rig, "the touch", |_| {
                (client.status().unwrap().latches.skips > skips).then_some(())
            });
            let mm = (hit * APART_MM) as f64;
            let line = format!("POINT: {mm:.4} {mm:.4} {mm:.4}\r\n");
            rig.control_sends(line.as_bytes());
            printed += line.len();
            until(rig, "the line", |_| {
                (raw_bytes(&journal(&mut client).0).len() >= printed).then_some(())
            });
        }
        judged(rig, &mut client, number);
        let verdict = client.verdict().unwrap().unwrap();
        let mut reasons = verdict.reasons.iter();
        let says = reasons.any(|reason| reason.reason.code() == "skip_rests_at_touch");
        assert_eq!(says, active == SignalLevel::Low, "{active:?}: {verdict:?}");
        assert!(!verdict.ok);
        rig.move_to(&[0; 3]);
    }
}

#[test]
fn a_line_that_rests_at_the_level_of_a_touch_is_named_on_the_virtual_board() {
    names_the_level_at_which_it_rests(&mut VirtualRig::start().unwrap(), |rig, place| {
        let now_ns = rig.now_ns();
        rig.edge(LatchCause::Skip, now_ns, place);
        rig.edge(LatchCause::SkipEnd, now_ns + 100 * US, place);
    });
}

#[test]
fn a_line_that_rests_at_the_level_of_a_touch_is_named_on_the_emulated_pico() {
    if let Some(mut rig) = PicoRig::start_or_skip() {
        names_the_level_at_which_it_rests(&mut rig, |rig, _| rig.skip());
    }
}
