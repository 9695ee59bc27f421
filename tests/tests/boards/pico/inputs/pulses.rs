//! Trigger pulses of the board's image on an emulated Pico, held against the lines that the
//! axis truly crossed.

use std::collections::BTreeSet;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::{Client, Patience};
use umi_protocol::latch::{
    LatchCause, LatchReport, SignalLevel, TriggerOut, TriggerPulse, TriggerRefusal,
};
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
            pulse: TriggerPulse::default(),
        };
        assert_eq!(client.trigger_out(along_x).unwrap(), Ok(()));
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
        assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
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
    let every = |interval_us| TriggerOut::Time {
        interval_us,
        pulse: TriggerPulse::default(),
    };
    let too_short = TriggerRefusal::IntervalTooShort { least_us: 100 };
    assert_eq!(client.trigger_out(every(99)).unwrap(), Err(too_short));
    for interval_us in [100, 1000] {
        pulses(&mut rig);
        assert_eq!(client.trigger_out(every(interval_us)).unwrap(), Ok(()));
        pass(&mut rig, 50 * u64::from(interval_us) * CYCLES_PER_US);
        assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
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

/// A pulse is as long as it is asked for, to the cycle, and the output rests as it is asked to;
/// both stay until another request, and none is cut when pulses end or change.
#[test]
fn pulses_are_as_wide_as_they_are_asked_for() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.live(true).unwrap();
    let (low, high) = (SignalLevel::Low, SignalLevel::High);
    for (width_us, rests) in [(1, low), (20, low), (20, high), (100, high), (1000, low)] {
        let pulse = TriggerPulse { width_us, rests };
        let every = TriggerOut::Time {
            interval_us: 1250,
            pulse,
        };
        rig.emulator().outputs();
        assert_eq!(client.trigger_out(every).unwrap(), Ok(()));
        pass(&mut rig, 6 * 1250 * CYCLES_PER_US);
        // Most likely in the middle of one of a millisecond.
        assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
        pass(&mut rig, 3000 * CYCLES_PER_US);
        let is_pulse = rests == low;
        let changes: Vec<_> = rig
            .emulator()
            .outputs()
            .into_iter()
            .filter(|change| change.pin == PULSE_PIN)
            .skip_while(|change| change.level != is_pulse)
            .collect();
        let widths: BTreeSet<u64> = changes
            .chunks(2)
            .map(|pair| {
                assert_eq!((pair[0].level, pair[1].level), (is_pulse, !is_pulse));
                pair[1].cycle - pair[0].cycle
            })
            .collect();
        let width = u64::from(width_us) * CYCLES_PER_US;
        assert_eq!(widths, BTreeSet::from([width]), "{width_us} us, {rests:?}");
        let latches = told(&mut client, changes.len() / 2);
        assert!(latches.iter().all(|latch| latch.missed == 0));
    }
    let status = client.status().unwrap();
    assert_eq!(
        status.latches.missed, 0,
        "nor was a change of the rest taken for a pulse"
    );
}

/// A line that the axis crosses before the pulse of the one before and its pause are over has no
/// pulse, and is told as missed: what was sent and what is missed are the lines.
#[test]
fn an_axis_too_fast_for_its_pulses_is_told() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = client(&mut rig);
    client.live(true).unwrap();
    // A line each 200 us, and a pulse that takes 520: one of three.
    let along_x = TriggerOut::Distance {
        axis: 0,
        interval_counts: 200,
        pulse: TriggerPulse {
            width_us: 500,
            rests: SignalLevel::High,
        },
    };
    assert_eq!(client.trigger_out(along_x).unwrap(), Ok(()));
    rig.emulator().outputs();
    let move_over = 30 * 200 + 100;
    let motion = [Segment::steady(move_over, 125.0)];
    rig.emulator().start_axis(0, &motion, &json!({}));
    pass(&mut rig, 20_000 * CYCLES_PER_US);
    let outputs = rig.emulator().outputs().into_iter();
    let changes: Vec<_> = outputs.filter(|output| output.pin == PULSE_PIN).collect();
    let begins: Vec<u64> = changes
        .iter()
        .filter(|c| !c.level)
        .map(|c| c.cycle)
        .collect();
    for pair in changes.chunks(2) {
        assert_eq!(pair[1].cycle - pair[0].cycle, 500 * CYCLES_PER_US);
    }
    for pair in begins.windows(2) {
        assert!(pair[1] - pair[0] >= 520 * CYCLES_PER_US, "no pause");
    }
    assert!((9..=11).contains(&begins.len()), "{}", begins.len());
    // Those without counts tell of lines only.
    let mut latches = told(&mut client, begins.len());
    latches.retain(|latch| !latch.counts.is_empty());
    // The first line comes too soon after the start for its speed to be known.
    for pair in latches[1..].windows(2) {
        let way = pair[1].counts[0] - pair[0].counts[0];
        assert!((way - 600).abs() <= 6, "each third line, not {way} counts");
    }
    assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    let counters = client.status().unwrap().latches;
    assert_eq!(counters.outputs as usize, begins.len());
    // Never fewer. Where the machines start anew after a loss, the pulse that is under way is told
    // as missed, too.
    let lines = counters.outputs + counters.missed;
    assert!((30..=31).contains(&lines), "{lines} lines");
}
