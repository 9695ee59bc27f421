//! Trigger pulses of the board's image on an emulated Pico, held against the lines that the
//! axis truly crossed.

use std::collections::BTreeSet;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::link::{Client, Patience};
use umi_protocol::latch::{LatchCause, LatchReport, TriggerOut};
use umi_protocol::message::Event;
use umi_tests::rig::Rig;
use umi_tests::rig::pico::{CYCLES_PER_US, PicoRig, Segment};

const PULSE_PIN: u8 = 22;
/// How far from its line a pulse may begin, at constant speed, in counts.
const LAG_COUNTS: f64 = 2.0;
/// How long the wall may take for a test.
const PATIENCE: Duration = Duration::from_secs(900);

fn client(rig: &mut PicoRig) -> Client {
    let patience = Patience {
        answer: Duration::from_secs(60),
        tries: 3,
    };
    Client::with_patience(rig.connect(), patience).unwrap()
}

/// Lets so much of the board's time pass.
fn pass(rig: &mut PicoRig, cycles: u64) {
    let end = rig.emulator().state().cycle + cycles;
    let start = Instant::now();
    while rig.emulator().state().cycle < end {
        assert!(start.elapsed() < PATIENCE, "the board's time stands still");
        thread::sleep(Duration::from_millis(5));
    }
}

/// When pulses began, since this was asked last.
fn pulses(rig: &mut PicoRig) -> Vec<u64> {
    let outputs = rig.emulator().outputs().into_iter();
    let rises = outputs.filter(|output| output.pin == PULSE_PIN && output.level);
    rises.map(|rise| rise.cycle).collect()
}

/// The latches of pulses that the host is told of.
fn told(client: &mut Client, count: usize) -> Vec<LatchReport> {
    let mut latches = Vec::new();
    let start = Instant::now();
    while latches.len() < count && start.elapsed() < PATIENCE {
        match client.next_event(Duration::from_secs(1)).unwrap() {
            Some(Event::Latches(batch)) => latches.extend(batch.reports()),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            _ => {}
        }
    }
    latches
}

/// X goes up over twenty lines, stops between two of them and comes back, at some speed.
struct Ride {
    cycles_per_count: f64,
    interval_counts: u32,
}

impl Ride {
    const LINES: u64 = 20;

    /// Over all lines at constant speed, and half an interval more until it stands. Returns
    /// when the lines were crossed, on the `first` edge and each interval from there.
    fn half(&self, rig: &mut PicoRig, up: bool, first: u64) -> Vec<f64> {
        let interval = u64::from(self.interval_counts);
        let last = first + (Self::LINES - 1) * interval;
        let (pace, stop) = (self.cycles_per_count, interval / 2);
        let part = |edges, to| Segment::Move {
            edges,
            from: pace,
            to,
            up,
        };
        let motion = [part(last, pace), part(stop, 50.0 * pace)];
        let begin = rig.emulator().start_axis(0, &motion, &json!({})) as f64;
        pass(rig, ((last + 3 * stop) as f64 * pace) as u64);
        while rig.emulator().axes()[0].is_moving {
            pass(rig, 100 * CYCLES_PER_US);
        }
        pass(rig, 500 * CYCLES_PER_US);
        let edges = (0..Self::LINES).map(|line| first + line * interval);
        edges.map(|edge| begin + edge as f64 * pace).collect()
    }

    /// Returns the pulses' times after their lines, in cycles; ahead is negative.
    fn go(&self, rig: &mut PicoRig, client: &mut Client) -> Vec<f64> {
        let interval = u64::from(self.interval_counts);
        let origin = rig.emulator().axes()[0].position;
        let along_x = TriggerOut::Distance {
            axis: 0,
            interval_counts: self.interval_counts,
        };
        assert!(client.trigger_out(along_x).unwrap());
        pulses(rig);
        // A line is an edge, the same one in both directions.
        let mut crossed = self.half(rig, true, interval);
        crossed.extend(self.half(rig, false, interval / 2 + 1));
        let found = pulses(rig);
        assert_eq!(found.len(), crossed.len(), "one pulse for each line");
        let latches = told(client, found.len());
        let lines = (1..=Self::LINES).chain((1..=Self::LINES).rev());
        for (latch, line) in latches.iter().zip(lines) {
            assert_eq!((latch.cause, latch.missed), (LatchCause::Output, 0));
            let off = latch.counts[0] - origin - i64::try_from(line * interval).unwrap();
            // Below a line is the count before its edge.
            assert!(off.abs() as f64 <= LAG_COUNTS + 1.0, "{off} at {line}");
        }
        assert!(client.trigger_out(TriggerOut::Off).unwrap());
        let times = found.iter().zip(&crossed);
        times.map(|(pulse, line)| *pulse as f64 - line).collect()
    }
}

/// A pulse for every line, once, in both directions and over a reversal, as near to it as
/// the board promises at any speed; the host is told of each, with the position.
#[test]
fn pulses_along_an_axis_begin_at_its_lines() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.live(true).unwrap();
    // 9.9, 6.2, 1 and 0.04 million counts a second. Where the axis stops and starts, the next
    // line is farther than what is foreseen, and than the speed takes to be known.
    let rides = [(12.6, 5400), (20.3, 3400), (123.7, 1000), (3001.1, 50)];
    for (cycles_per_count, interval_counts) in rides {
        let ride = Ride {
            cycles_per_count,
            interval_counts,
        };
        let mut off = ride.go(&mut rig, &mut client);
        off.sort_by(f64::total_cmp);
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let (first, last) = (off[0], off[off.len() - 1]);
        println!(
            "{cycles_per_count} cycles a count: pulses {:.2} to {:.2} counts behind their lines, \
             in the mean {mean:.0} cycles",
            first / cycles_per_count,
            last / cycles_per_count,
        );
        let limit = LAG_COUNTS * cycles_per_count;
        assert!(first >= -limit && last <= limit);
    }
    assert_eq!(client.status().unwrap().latches.missed, 0);
}

/// At a time interval the steps between pulses are the same, to the cycle, whatever the
/// processor does meanwhile; and there are none any more when they are switched off.
#[test]
fn pulses_in_time_keep_their_interval_to_the_cycle() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.live(true).unwrap();
    let too_short = TriggerOut::Time { interval_us: 99 };
    assert!(!client.trigger_out(too_short).unwrap());
    for interval_us in [100, 1000] {
        pulses(&mut rig);
        assert!(
            client
                .trigger_out(TriggerOut::Time { interval_us })
                .unwrap()
        );
        pass(&mut rig, 50 * u64::from(interval_us) * CYCLES_PER_US);
        assert!(client.trigger_out(TriggerOut::Off).unwrap());
        pass(&mut rig, 1000 * CYCLES_PER_US);
        let found = pulses(&mut rig);
        assert!(found.len() >= 50, "{}", found.len());
        let steps: BTreeSet<u64> = found.windows(2).map(|two| two[1] - two[0]).collect();
        let step = u64::from(interval_us) * CYCLES_PER_US;
        assert_eq!(steps, BTreeSet::from([step]));
        let latches = told(&mut client, found.len());
        assert!(latches.iter().all(|latch| latch.missed == 0));
        pass(&mut rig, 5 * step);
        assert!(pulses(&mut rig).is_empty());
    }
}
