//! Captures of the board's image on an emulated Pico: each edge where and when it was, in
//! motion and close together.
//!
//! The long form is run by
//! `cargo test -p umi-tests --test boards pico::inputs::captures -- --ignored --nocapture`.

use std::time::Duration;

use serde_json::json;
use umi_client::board::link::Client;
use umi_protocol::latch::{LatchCause, LatchCounters, LatchReport, TriggerOut, TriggerPulse};
use umi_protocol::message::{Event, Record};
use umi_tests::rig::pico::{
    AXES, CYCLES_PER_US, EmulatedPulses, EmulatorTruth, PicoRig, SKIP_PIN, Segment, TRIGGER_PIN,
};

pub(super) const CYCLES_PER_MS: u64 = 1000 * CYCLES_PER_US;
const NS_PER_CYCLE: i64 = 8;
/// Index marks of X, Y, Z.
const INDEX_PINS: [u8; 3] = [18, 19, 20];
const TRIGGER_OUT_PIN: u8 = 22;
/// A million counts a second.
pub(super) const FAST: f64 = 125.0;

/// How long after its edge a time stamp is, as the README promises: at least and at most. A
/// start shifts all alike, by how its loop stands to the tick of the timer.
const STAMP_NS: [i64; 2] = [-32, 40];
/// How far the stamps of one start are apart.
const STAMP_SPREAD_NS: i64 = 16;
/// The same for index marks and pulses, which are seen in steps of 80 ns.
const SEEN_NS: [i64; 2] = [-72, 80];
const SEEN_SPREAD_NS: i64 = 88;
/// A latched position that is not that of the edge is one that the axis had at most so many
/// cycles before or after it: 100 ns.
const NEAR_CYCLES: u64 = 12;
/// From an edge until its positions are read may take so long.
const LATENESS_CYCLES: u64 = 75 * CYCLES_PER_US;
/// What the interrupts of captures and of the tick take at once: less than a character from the
/// control.
const CAPTURE_CYCLES: u64 = 6_000;
const CAPTURE_INTERRUPT: u64 = 9;
const LOOK_INTERRUPT: u64 = 1;

/// A board whose host listens, and whose head of the start is signed: while it is, measuring finds no
/// room for edges each few milliseconds.
pub(super) fn begun() -> Option<(PicoRig, Client)> {
    let mut rig = PicoRig::start_or_skip()?;
    let mut client = rig.client();
    rig.wait_for_quiet();
    client.live(true).unwrap();
    Some((rig, client))
}

/// The emulator's cycle at which the board's clock was 0. The chip says what its microsecond
/// timer is at instants that the emulator knows to the cycle, at many places within the
/// microsecond: no other zero fits them all.
fn clock_zero(rig: &mut PicoRig) -> u64 {
    let (mut least, mut most) = (i64::MIN, i64::MAX);
    for _ in 0..3 * CYCLES_PER_US {
        // A cycle later within the microsecond each time, about: an instruction is not halved.
        rig.emulator().run(8 * CYCLES_PER_US + 1);
        let time = rig.emulator().time();
        // The timer shows n from n microseconds after its zero to less than n + 1.
        let since = time.cycle.cast_signed() - (time.timer_us * CYCLES_PER_US).cast_signed();
        most = most.min(since);
        least = least.max(since + 1 - CYCLES_PER_US.cast_signed());
    }
    rig.emulator().ask(&json!({ "do": "free", "speed": 0 }));
    let began = rig.emulator().time().began;
    let zero = began.cast_signed();
    assert!(least <= zero && zero <= most, "{least} {zero} {most}");
    assert!(
        most - least <= 12,
        "the clock's zero is known to {least}..{most}"
    );
    began
}

/// How far latches are from the truth.
struct Distances {
    what: &'static str,
    /// Time stamps after their edges: sorted.
    time_ns: Vec<i64>,
    /// Positions of all axes: how many were off by -1, 0, 1 count.
    off: [usize; 3],
    /// Of those which are off, how far away in time the latched position was true, at most.
    near_cycles: u64,
}

impl Distances {
    /// Holds latches against the truth: each to its edge, in their order.
    fn of(what: &'static str, zero: u64, latches: &[LatchReport], truth: &[EmulatorTruth]) -> Self {
        assert_eq!(latches.len(), truth.len(), "{what}: captured and sent");
        let mut found = Self {
            what,
            time_ns: Vec::new(),
            off: [0; 3],
            near_cycles: 0,
        };
        for (place, (latch, truth)) in latches.iter().zip(truth).enumerate() {
            assert_eq!(latch.missed, 0, "{what}: at {place}");
            assert_eq!(latch.number as usize, place, "{what}");
            let edge_ns = (truth.cycle - zero).cast_signed() * NS_PER_CYCLE;
            found.time_ns.push(latch.t_ns.cast_signed() - edge_ns);
            for axis in 0..AXES {
                let error = latch.counts[axis] - truth.positions[axis];
                let until = truth.until[axis].unwrap_or(u64::MAX);
                let near = truth.since[axis].min(until);
                assert!(
                    error == 0 || error.abs() == 1 && near <= NEAR_CYCLES,
                    "axis {axis} of {what} {place} is {error} counts off, {} cycles after a count \
                     and {until} before the next",
                    truth.since[axis],
                );
                found.off[usize::try_from(error + 1).unwrap()] += 1;
                if error != 0 {
                    found.near_cycles = found.near_cycles.max(near);
                }
            }
        }
        found.time_ns.sort_unstable();
        found
    }

    /// Prints a row of the table, and holds the time stamps to a limit.
    fn hold(&self, limit_ns: [i64; 2], spread_ns: i64) {
        let count = self.time_ns.len();
        let (least, most) = (self.time_ns[0], self.time_ns[count - 1]);
        let median = self.time_ns[count / 2];
        let [less, exact, more] = self.off;
        println!(
            "| edge | latches | ns after it: min, median, max | cycles | counts off: -1, 0, +1 | worst in time |"
        );
        println!(
            "| {} | {count} | {least}, {median}, {most} | {}, {}, {} | {less}, {exact}, {more} | {} ns |",
            self.what,
            least / NS_PER_CYCLE,
            median / NS_PER_CYCLE,
            most / NS_PER_CYCLE,
            self.near_cycles.cast_signed() * NS_PER_CYCLE,
        );
        assert!(
            least >= limit_ns[0] && most <= limit_ns[1],
            "{}: {least} to {most} ns",
            self.what
        );
        assert!(
            most - least <= spread_ns,
            "{}: {least} to {most} ns",
            self.what
        );
    }
}

/// What the host is told, until `done` says that it is enough or the board's time is over.
pub(super) fn listen(
    rig: &mut PicoRig,
    client: &mut Client,
    until: u64,
    mut done: impl FnMut(&[LatchReport]) -> bool,
) -> Vec<LatchReport> {
    // Messages after the end that are still taken: a busy machine is behind by some for each
    // millisecond, and more may come for ever.
    let listens = until.saturating_sub(rig.emulator().state().cycle);
    let mut left = 400 + listens / CYCLES_PER_MS;
    let mut found = Vec::new();
    loop {
        let is_over = rig.emulator().state().cycle > until;
        match client.next_event(Duration::from_millis(200)).unwrap() {
            Some(Event::Latches(batch)) => found.extend(batch.reports()),
            Some(Event::Record {
                record: Record::Latch(latch),
                ..
            }) => found.push(latch),
            Some(Event::Dropped { count }) => panic!("{count} events dropped"),
            Some(_) => {}
            None if is_over => return found,
            None => {}
        }
        if is_over {
            left -= 1;
        }
        if left == 0 || done(&found) {
            return found;
        }
    }
}

/// The latches of a cause, without those that say that there is none.
fn of_cause(all: &[LatchReport], cause: LatchCause) -> Vec<LatchReport> {
    let some = all.iter().filter(|latch| latch.cause == cause);
    some.cloned().collect()
}

/// Those at a pin.
fn at_pin(truth: &[EmulatorTruth], pin: u8) -> Vec<EmulatorTruth> {
    truth
        .iter()
        .filter(|truth| truth.pin == pin)
        .cloned()
        .collect()
}

/// One more edge, when others are over; until when it has been told.
pub(super) fn one_more(rig: &mut PicoRig, pin: u8) -> u64 {
    let start = rig.emulator().pulses_at(pin, &[5 * CYCLES_PER_MS], 1000);
    start + 30 * CYCLES_PER_MS
}

/// The board's counters, when it has had time to count.
pub(super) fn counters(rig: &mut PicoRig, client: &mut Client) -> LatchCounters {
    let now = rig.emulator().state().cycle;
    rig.wait_for_cycle(now + 20 * CYCLES_PER_MS);
    client.status().unwrap().latches
}

/// Edges of the probe's line while all axes move at a million counts a second: each latch
/// belongs to its edge, in position and time.
#[test]
fn a_skip_edge_is_latched_where_and_when_it_was() {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    // Its job judges touches: so both edges are told.
    let job = include_str!("../../../../../examples/three-spheres-witnessed.toml");
    client
        .set_job(&toml::from_str(job).unwrap())
        .unwrap()
        .unwrap();
    let zero = clock_zero(&mut rig);
    client.live(true).unwrap();
    let (count, period) = (200, 5 * CYCLES_PER_MS);
    rig.move_all((count + 2) * period, FAST);
    let start = rig.emulator().pulses(&EmulatedPulses {
        pin: SKIP_PIN,
        count,
        period,
        jitter: period / 2,
        width: 100 * CYCLES_PER_US,
        after: period / 2,
        is_recorded: true,
    });
    let end = start + (count + 10) * period;
    let both = 2 * count;
    let found = listen(&mut rig, &mut client, end, |all| all.len() as u64 == both);
    let truth = rig.emulator().truth();
    for (what, cause, edge) in [
        ("skip, rise", LatchCause::Skip, 0),
        ("skip, fall", LatchCause::SkipEnd, 1),
    ] {
        let truth: Vec<_> = truth.iter().skip(edge).step_by(2).cloned().collect();
        Distances::of(what, zero, &of_cause(&found, cause), &truth).hold(STAMP_NS, STAMP_SPREAD_NS);
    }
    let counters = counters(&mut rig, &mut client);
    assert_eq!((counters.skips.into(), counters.missed), (count, 0));
}

/// A scanner's triggers while all axes move at a million counts a second: what comes of
/// them at the host.
pub(super) fn triggers(
    rig: &mut PicoRig,
    client: &mut Client,
    count: u64,
    period: u64,
) -> Vec<LatchReport> {
    client.live(true).unwrap();
    rig.move_all((count + 100) * period, FAST);
    let before = rig.emulator().state();
    rig.emulator().pulses(&EmulatedPulses {
        pin: TRIGGER_PIN,
        count,
        period,
        jitter: period / 8,
        width: period / 10,
        after: period,
        is_recorded: true,
    });
    // The last ones wait a few milliseconds for others.
    let end = before.cycle + (count + 2) * period + 20 * CYCLES_PER_MS;
    let found = listen(rig, client, end, |all| all.len() as u64 == count);
    let after = rig.emulator().state();
    let slept = (after.slept_cycles - before.slept_cycles) as f64;
    let passed = (after.cycle - before.cycle) as f64;
    println!(
        "{count} triggers, {} a second: {} latches told, the core slept for {:.0} % of the time",
        1_000_000 * CYCLES_PER_US / period,
        found.len(),
        100.0 * slept / passed,
    );
    found
}

fn ten_thousand_triggers_a_second(count: u64) {
    let Some(mut rig) = PicoRig::start_or_skip() else {
        return;
    };
    let mut client = rig.client();
    let zero = clock_zero(&mut rig);
    rig.emulator().interrupts();
    let found = triggers(&mut rig, &mut client, count, 100 * CYCLES_PER_US);
    let truth = rig.emulator().truth();
    Distances::of("trigger", zero, &found, &truth).hold(STAMP_NS, STAMP_SPREAD_NS);
    let counters = counters(&mut rig, &mut client);
    assert_eq!(u64::from(counters.triggers), count);
    assert_eq!((counters.missed, counters.untold), (0, 0));
    is_in_time(&mut rig);
}

/// Positions are read long before they are overwritten, and the interrupts that do it leave
/// the control's characters their time.
fn is_in_time(rig: &mut PicoRig) {
    // One may follow the other.
    let mut at_once = 0;
    for times in rig.emulator().interrupts() {
        let (wait, run) = (times.wait_cycles, times.run_cycles);
        if [CAPTURE_INTERRUPT, LOOK_INTERRUPT].contains(&times.number) {
            println!(
                "interrupt {}: waits {wait} and runs {run} cycles at most",
                times.number
            );
            at_once += run;
        }
        if times.number == CAPTURE_INTERRUPT {
            assert!(times.whole_cycles <= LATENESS_CYCLES, "{times:?}");
        }
    }
    assert!(at_once <= CAPTURE_CYCLES, "{at_once}");
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

/// Index marks of three axes in motion, in both directions: each has the position and the
/// time of its edge.
#[test]
fn an_index_mark_is_latched_where_it_was() {
    let Some((mut rig, mut client)) = begun() else {
        return;
    };
    let zero = clock_zero(&mut rig);
    let (count, period) = (40, 10 * CYCLES_PER_MS);
    let half = count / 2 * period;
    for axis in 0..AXES {
        let pace = FAST * (1.0 + 0.0037 * axis as f64);
        let counts = (half as f64 / pace) as i64;
        let way = if axis % 2 == 0 { counts } else { -counts };
        let segments = [Segment::steady(way, pace), Segment::steady(-way, pace)];
        rig.emulator().start_axis(axis, &segments, &json!({}));
    }
    let mut start = 0;
    for (axis, pin) in INDEX_PINS.into_iter().enumerate() {
        start = rig.emulator().pulses(&EmulatedPulses {
            pin,
            count,
            period,
            jitter: period / 4,
            width: 50 * CYCLES_PER_US,
            after: axis as u64 * period / 3,
            is_recorded: true,
        });
    }
    let end = start + (count + 10) * period;
    let all = INDEX_PINS.len() as u64 * count;
    let found = listen(&mut rig, &mut client, end, |found| {
        found.len() as u64 == all
    });
    let truth = rig.emulator().truth();
    for (axis, pin) in INDEX_PINS.into_iter().enumerate() {
        let cause = LatchCause::Index { axis: axis as u8 };
        let found = of_cause(&found, cause);
        Distances::of("index mark", zero, &found, &at_pin(&truth, pin))
            .hold(SEEN_NS, SEEN_SPREAD_NS);
    }
    assert_eq!(counters(&mut rig, &mut client).missed, 0);
}

/// Noise at a megahertz on the index line of X, without a pause and in bursts, overruns the
/// machine that stamps the marks of all axes. Each mark of Y is where and when it was, or told as
/// missed before the next. None is missed in quiet times, once the journal has caught up with the
/// noise: its queue is full then, and takes nothing in while the flash erases a sector (45 ms).
#[test]
fn noise_on_an_index_line_falsifies_no_other() {
    let Some((mut rig, mut client)) = begun() else {
        return;
    };
    let zero = clock_zero(&mut rig);
    // In turn: quiet, noise, quiet, bursts around the marks, quiet.
    let (noisy, bursty) = (10..30_usize, 70..110_usize);
    let (count, period) = (150, 4 * CYCLES_PER_MS);
    // Marks in which the journal catches up: two erases, and what they made wait.
    let catches_up = 28;
    // In step neither with the board's looks nor with the noise.
    let at = |nth: usize| nth as u64 * period + nth as u64 * 7919 % 60_000;
    let marks: Vec<u64> = (0..count).map(at).collect();
    let mut noise: Vec<u64> = (at(noisy.start) - 500..at(noisy.end - 1) + 6_000)
        .step_by(CYCLES_PER_US as usize)
        .collect();
    for nth in bursty.clone() {
        let from = at(nth) - nth as u64 % 10 * CYCLES_PER_US - nth as u64 % 7;
        noise.extend((0..10).map(|edge| from + edge * CYCLES_PER_US));
    }
    rig.move_all((count as u64 + 40) * period, FAST);
    rig.emulator().ask(&json!({ "do": "pause" }));
    let start = rig
        .emulator()
        .pulses_at(INDEX_PINS[1], &marks, 50 * CYCLES_PER_US);
    rig.emulator()
        .pulses_at(INDEX_PINS[0], &noise, CYCLES_PER_US / 3);
    rig.emulator().ask(&json!({ "do": "free", "speed": 0 }));
    let end = start + (count as u64 + 20) * period;
    let found = listen(&mut rig, &mut client, end, |_| false);

    let truth = at_pin(&rig.emulator().truth(), INDEX_PINS[1]);
    assert_eq!(truth.len(), count);
    let mut is_right = vec![false; count];
    // The first mark that is neither right nor counted, and what was told as missed from there.
    let (mut next, mut missed) = (0, 0);
    for latch in of_cause(&found, LatchCause::Index { axis: 1 }) {
        missed += latch.missed as usize;
        if latch.counts.is_empty() {
            continue;
        }
        let after_ns = |place: usize| {
            let edge_ns = (truth[place].cycle - zero).cast_signed() * NS_PER_CYCLE;
            latch.t_ns.cast_signed() - edge_ns
        };
        let place = (next..count).min_by_key(|place| after_ns(*place).abs());
        let place = place.expect("no more than came");
        let (truth, after_ns) = (&truth[place], after_ns(place));
        assert!(
            (SEEN_NS[0]..=SEEN_NS[1]).contains(&after_ns),
            "{after_ns} ns after mark {place}, which is the nearest"
        );
        for axis in 0..AXES {
            let off = (latch.counts[axis] - truth.positions[axis]).abs();
            let near = truth.since[axis].min(truth.until[axis].unwrap_or(u64::MAX));
            assert!(
                off == 0 || off == 1 && near <= NEAR_CYCLES,
                "{off} counts off"
            );
        }
        assert!(
            missed >= place - next,
            "{missed} of marks {next}..{place} told as missed"
        );
        is_right[place] = true;
        (next, missed) = (place + 1, 0);
    }
    assert_eq!(next, count, "the last ones came in a quiet time");
    let right = |range: std::ops::Range<usize>| is_right[range].iter().filter(|is| **is).count();
    let (in_noise, in_bursts) = (right(noisy.clone()), right(bursty.clone()));
    println!(
        "marks of Y that are captured: {in_noise} of {} in noise, {in_bursts} of {} in bursts",
        noisy.len(),
        bursty.len()
    );
    assert!(
        in_noise < noisy.len() && in_bursts < bursty.len(),
        "no noise"
    );
    let quiet = [
        0..noisy.start,
        noisy.end + catches_up..bursty.start,
        bursty.end + catches_up..count,
    ];
    for quiet in quiet {
        assert_eq!(right(quiet.clone()), quiet.len(), "marks {quiet:?}");
    }
    let behind = |end: usize| catches_up - right(end..end + catches_up);
    println!(
        "missed, and told, of {catches_up} behind the noise: {}, behind the bursts: {}",
        behind(noisy.end),
        behind(bursty.end)
    );
}

/// Every pulse that leaves the board has the position and the time at which it did.
#[test]
fn a_trigger_pulse_is_latched_where_it_was() {
    let Some((mut rig, mut client)) = begun() else {
        return;
    };
    let zero = clock_zero(&mut rig);
    // One axis, whose truth at any cycle is plain.
    let pace = 130.7;
    let start = rig
        .emulator()
        .start_axis(0, &[Segment::steady(1_000_000, pace)], &json!({}));
    let position = |cycle: u64| {
        let edges = (cycle.saturating_sub(start) as f64 / pace).floor() as i64;
        edges.min(1_000_000)
    };
    rig.emulator().outputs();
    let when = TriggerOut::Time {
        interval_us: 200,
        pulse: TriggerPulse::default(),
    };
    assert_eq!(client.trigger_out(when).unwrap(), Ok(()));
    let now = rig.emulator().state().cycle;
    let end = now + 1000 * CYCLES_PER_MS;
    let found = listen(&mut rig, &mut client, end, |found| found.len() >= 450);
    assert_eq!(client.trigger_out(TriggerOut::Off).unwrap(), Ok(()));
    let outputs = rig.emulator().outputs();
    let rises = outputs
        .iter()
        .filter(|output| output.pin == TRIGGER_OUT_PIN && output.level);
    let rises: Vec<u64> = rises.map(|output| output.cycle).collect();
    assert!(found.len() >= 400, "{} pulses", found.len());
    let mut after_ns: Vec<i64> = Vec::new();
    for (place, (latch, rise)) in found.iter().zip(&rises).enumerate() {
        assert_eq!((latch.number as usize, latch.missed), (place, 0));
        assert_eq!(latch.cause, LatchCause::Output);
        let edge_ns = (rise - zero).cast_signed() * NS_PER_CYCLE;
        after_ns.push(latch.t_ns.cast_signed() - edge_ns);
        let near = position(rise - NEAR_CYCLES)..=position(rise + NEAR_CYCLES);
        assert!(
            near.contains(&latch.counts[0]),
            "{place}: {} {near:?}",
            latch.counts[0]
        );
    }
    after_ns.sort_unstable();
    let (least, most) = (after_ns[0], after_ns[after_ns.len() - 1]);
    println!(
        "trigger pulse: {} latches, {least} to {most} ns after it",
        found.len()
    );
    assert!(least >= SEEN_NS[0] && most <= SEEN_NS[1]);
    // Those on their way when the host stopped to listen are captured, too.
    let counters = counters(&mut rig, &mut client);
    assert_eq!(
        (counters.outputs as usize, counters.missed),
        (rises.len(), 0)
    );
}

/// Edges on one line, and on two, close together: while the board handles one, the next
/// comes. Each has its own position and time.
#[test]
fn edges_that_come_close_together_are_told_apart() {
    let Some((mut rig, mut client)) = begun() else {
        return;
    };
    let zero = clock_zero(&mut rig);
    let apart_us = [2, 3, 5, 8, 12, 20, 35, 50, 80];
    let period = 10 * CYCLES_PER_MS;
    let first = |place: usize| 1000 + place as u64 * period;
    let mut skips = Vec::new();
    let mut triggers = Vec::new();
    for (place, us) in apart_us.into_iter().enumerate() {
        // Skip and skip, then skip and trigger, then two of each at once, of which both edges of
        // the skips count: six.
        skips.extend([first(3 * place), first(3 * place) + us * CYCLES_PER_US]);
        skips.push(first(3 * place + 1));
        triggers.push(first(3 * place + 1) + (us - 2) * CYCLES_PER_US);
        for nth in 0..2 {
            let at = first(3 * place + 2) + nth * us * CYCLES_PER_US;
            skips.push(at);
            triggers.push(at);
        }
    }
    rig.move_all((3 * apart_us.len() as u64 + 2) * period, FAST);
    rig.emulator().interrupts();
    // While the time stands, both begin at the same cycle.
    rig.emulator().ask(&json!({ "do": "pause" }));
    let start = rig.emulator().pulses_at(SKIP_PIN, &skips, CYCLES_PER_US);
    let second = rig
        .emulator()
        .pulses_at(TRIGGER_PIN, &triggers, CYCLES_PER_US);
    assert_eq!(start, second);
    rig.emulator().ask(&json!({ "do": "free", "speed": 0 }));
    let end = second + (3 * apart_us.len() as u64 + 5) * period;
    let all = skips.len() + triggers.len();
    let found = listen(&mut rig, &mut client, end, |found| found.len() == all);
    let truth = rig.emulator().truth();
    for (what, cause, pin) in [
        ("skip", LatchCause::Skip, SKIP_PIN),
        ("trigger", LatchCause::Trigger, TRIGGER_PIN),
    ] {
        let found = of_cause(&found, cause);
        Distances::of(what, zero, &found, &at_pin(&truth, pin)).hold(STAMP_NS, STAMP_SPREAD_NS);
    }
    let counters = counters(&mut rig, &mut client);
    assert_eq!((counters.missed, counters.untold), (0, 0));
    is_in_time(&mut rig);
}
