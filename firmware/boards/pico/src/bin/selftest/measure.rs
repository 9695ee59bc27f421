//! The rows: each drives something and measures what the application's files make of it.

use embassy_futures::select::{Either, select};
use embassy_rp::pac;
use embassy_time::{Duration, Timer};
use umi_app::board::{Axes as _, Broken, CncTx as _, LatchSource as _, LinkTx, Scanner as _};

use umi_drivers::selftest::edges::{DrivenEdge, FoundEdges};
use umi_drivers::selftest::loopback::{self, Heard};
use umi_drivers::selftest::table::{Asked, Table};
use umi_protocol::latch::{
    LatchCause, LatchReport, Positions, SignalLevel, TriggerOut, TriggerPulse,
};

use crate::capture::latch::{self, CAPTURES, Station};
use crate::drive::{self, Encoders};
use crate::flash_cache;
use crate::past::Past;
use crate::pins::{AXES, INDEX, INDEXED, SKIP, TRIGGER_IN, TRIGGER_OUT};
use crate::resources::{CYCLES_PER_US, SKIP_MACHINE};
use crate::time::clock::{self, BoardClock};
use crate::uart::{Receiver, Transmitter};

/// What each axis is moved, one count a microsecond.
const WAYS: [i64; AXES] = [4000, -3000, 2000, -1000];
const AXIS_ROWS: [&str; AXES] = [
    "position of axis 1",
    "position of axis 2",
    "position of axis 3",
    "position of axis 4",
];
const FAST_ROWS: [&str; AXES] = [
    "axis 1 at full speed",
    "axis 2 at full speed",
    "axis 3 at full speed",
    "axis 4 at full speed",
];
/// Pairs of counts at full speed.
const FAST_PAIRS: u32 = 10_000;
/// The application's own promise is 10 M counts a second; this loop makes nearly that.
const LEAST_COUNTS_PER_S: i64 = 7_000_000;
/// Skip edges are captured 500 times a second, on average.
const SKIP_PAUSE_US: u64 = 5_000;
const PAUSE_US: u64 = 200;
/// A capture is told by then.
const PATIENCE: Duration = Duration::from_millis(5);
/// The timer may be a microsecond behind, and the driving code takes some time.
const INSTANT_NS: i64 = 3_000;
const PULSE: TriggerPulse = TriggerPulse {
    width_us: 20,
    rests: SignalLevel::Low,
};
const PULSE_US: u32 = 5_000;
/// A stamp is known to two cycles; both ends have one.
const PULSE_NS: i64 = 32;

/// What the figures of the README are made with: two words of 44. A line that comes as a whole takes 56. The RP2350 has other
/// figures, which nobody knows yet: there is no promise to hold.
const LINE_CYCLES: i64 = if cfg!(feature = "rp2350") {
    i32::MAX as i64
} else {
    2 * 44
};

/// Everything, one after the other.
pub async fn all<L: LinkTx>(
    station: &mut Station,
    past: &Past,
    asked: Asked,
    mut table: Table<'_, L>,
) -> Result<(), Broken> {
    let board = if cfg!(feature = "rp2350") {
        "pico2"
    } else {
        "pico"
    };
    table.begin(board).await?;
    let noted = |is_noted: bool| i64::from(is_noted);
    table
        .exactly("panic noted", 1, noted(past.panic_is_noted), "")
        .await?;
    table
        .exactly("hard fault noted", 1, noted(past.fault_is_noted), "")
        .await?;
    let overflow = noted(past.overflow_is_noted);
    table
        .exactly("stack overflow noted", 1, overflow, "")
        .await?;
    table
        .exactly(
            "laser and lamps low behind them",
            3,
            past.times_dark.into(),
            "",
        )
        .await?;
    let starts = past.more_starts.into();
    table
        .exactly("starts that nobody asked for", 0, starts, "")
        .await?;

    drain().await;
    let mut encoders = Encoders::new();
    // Every request begins where A and B are low.
    drive::start();
    settle().await;
    let before = station.positions();
    positions(station, &mut encoders, &mut table).await?;
    speed(station, &mut encoders, &mut table).await?;
    captures(station, &mut encoders, asked.edges, &mut table).await?;
    pulses(station, asked.edges, &mut table).await?;
    let after = station.positions();
    let illegal = |of: &Positions| of.illegal.iter().map(|axis| i64::from(*axis)).sum::<i64>();
    let more = illegal(&after).wrapping_sub(illegal(&before));
    table.exactly("illegal transitions", 0, more, "").await?;
    let lost = i64::from(after.lost_samples).wrapping_sub(before.lost_samples.into());
    table.exactly("losses of samples", 0, lost, "").await?;
    line(&mut table).await?;
    cache(&mut table).await?;
    restarted(station, &mut encoders, asked.restarts, &mut table).await?;
    table.end().await
}

/// Until all is read that was driven.
async fn settle() {
    Timer::after_millis(2).await;
}

async fn next() -> Option<LatchReport> {
    match select((&mut &CAPTURES).next(), Timer::after(PATIENCE)).await {
        Either::First(latch) => Some(latch),
        Either::Second(()) => None,
    }
}

/// What came before is not this test's.
async fn drain() {
    for _ in 0..256 {
        if next().await.is_none() {
            break;
        }
    }
}

fn way(before: &Positions, after: &Positions, axis: usize) -> i64 {
    let at = |of: &Positions| of.counts.get(axis).copied().unwrap_or(i64::MIN);
    at(after).wrapping_sub(at(before))
}

async fn positions<L: LinkTx>(
    station: &mut Station,
    encoders: &mut Encoders,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    let before = station.positions();
    let longest = WAYS.iter().map(|way| way.unsigned_abs()).max().unwrap_or(0);
    for count in 0..longest {
        for (axis, way) in WAYS.into_iter().enumerate() {
            if count < way.unsigned_abs() {
                encoders.step(axis, way > 0);
            }
        }
        drive::settle();
        if count % 256 == 0 {
            // USB has its turn.
            Timer::after_micros(50).await;
        }
    }
    settle().await;
    let after = station.positions();
    for ((axis, promised), name) in WAYS.into_iter().enumerate().zip(AXIS_ROWS) {
        let measured = way(&before, &after, axis);
        table.exactly(name, promised, measured, "counts").await?;
    }
    Ok(())
}

async fn speed<L: LinkTx>(
    station: &mut Station,
    encoders: &mut Encoders,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    let before = station.positions();
    let began_us = clock::now_us();
    encoders.run(FAST_PAIRS);
    let took_us = clock::now_us().saturating_sub(began_us).max(1);
    settle().await;
    let after = station.positions();
    let promised = i64::from(2 * FAST_PAIRS);
    for (axis, name) in FAST_ROWS.into_iter().enumerate() {
        let measured = way(&before, &after, axis);
        table.exactly(name, promised, measured, "counts").await?;
    }
    let us_per_m = i64::try_from(took_us).unwrap_or(i64::MAX);
    let least_us = promised * 1_000_000 / LEAST_COUNTS_PER_S;
    table
        .at_most("time for that", least_us, us_per_m, "us")
        .await
}

/// The next capture, of an edge of this kind between two times at this position of the first axis.
async fn expect(
    found: &mut FoundEdges,
    cause: LatchCause,
    (from_us, to_us): (u64, u64),
    counts: i64,
) {
    let latch = next().await;
    let driven = DrivenEdge {
        cause,
        from_us,
        to_us,
        counts: &[counts],
    };
    found.take(driven, latch.as_ref());
}

/// Drives an edge while the first axis moves on a count before it and one behind it. Returns when
/// it was, and the position at it.
fn edge(encoders: &mut Encoders, at: &mut i64, pin: u8, high: bool) -> ((u64, u64), i64) {
    let mut step = || {
        encoders.step(0, true);
        *at = at.wrapping_add(1);
        drive::settle();
        *at
    };
    let counts = step();
    let from_us = clock::now_us();
    drive::set(pin, high);
    let to_us = clock::now_us();
    drive::settle();
    step();
    ((from_us, to_us), counts)
}

async fn captures<L: LinkTx>(
    station: &mut Station,
    encoders: &mut Encoders,
    edges: u32,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    drain().await;
    let mut at = station.positions().counts.first().copied().unwrap_or(0);

    let mut skip = FoundEdges::default();
    for _ in 0..edges {
        let (time, counts) = edge(encoders, &mut at, SKIP, true);
        expect(&mut skip, LatchCause::Skip, time, counts).await;
        let (time, counts) = edge(encoders, &mut at, SKIP, false);
        expect(&mut skip, LatchCause::SkipEnd, time, counts).await;
        Timer::after_micros(SKIP_PAUSE_US).await;
    }
    let all = 2 * i64::from(edges);
    skip.tell("skip edges captured", all, Some(INSTANT_NS), table)
        .await?;

    drain().await;
    let mut trigger = FoundEdges::default();
    for _ in 0..edges {
        let (time, counts) = edge(encoders, &mut at, TRIGGER_IN, true);
        edge(encoders, &mut at, TRIGGER_IN, false);
        expect(&mut trigger, LatchCause::Trigger, time, counts).await;
        Timer::after_micros(PAUSE_US).await;
    }
    let all = i64::from(edges);
    trigger
        .tell("triggers captured", all, Some(INSTANT_NS), table)
        .await?;

    drain().await;
    let mut marks = FoundEdges::default();
    for _ in 0..edges {
        for axis in 0..INDEXED as u8 {
            let pin = INDEX.wrapping_add(axis);
            let (time, counts) = edge(encoders, &mut at, pin, true);
            edge(encoders, &mut at, pin, false);
            expect(&mut marks, LatchCause::Index { axis }, time, counts).await;
            Timer::after_micros(PAUSE_US).await;
        }
    }
    let all = i64::from(edges) * INDEXED as i64;
    marks.tell("index marks captured", all, None, table).await
}

/// The skip line's machine looks at the output: it stamps both ends of each pulse.
async fn pulses<L: LinkTx>(
    station: &mut Station,
    edges: u32,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    drain().await;
    let watch = |pin| {
        let machine = pac::PIO1.sm(SKIP_MACHINE);
        machine.execctrl().modify(|w| w.set_jmp_pin(pin));
    };
    watch(TRIGGER_OUT);
    let spec = TriggerOut::Time {
        interval_us: PULSE_US,
        pulse: PULSE,
    };
    let taken = station.trigger_out(spec).is_ok();
    let (mut told, mut begun, mut ended) = (0_i64, 0_i64, 0_i64);
    let mut began_ns = None;
    let (mut worst_width, mut worst_interval) = (0_i64, 0_i64);
    let off = |from: u64, to: u64, promised_us: u32| {
        let took = i64::try_from(to.saturating_sub(from)).unwrap_or(i64::MAX);
        took.saturating_sub(i64::from(promised_us) * 1000).abs()
    };
    for _ in 0..3 * edges {
        // A clock that is half as fast, or a third, shows in width and interval and not as pulses
        // that are missing.
        let patience = Timer::after_micros(u64::from(5 * PULSE_US));
        let Either::First(latch) = select((&mut &CAPTURES).next(), patience).await else {
            break;
        };
        match latch.cause {
            // One that was lost is told without its instant.
            _ if latch.counts.is_empty() => {}
            LatchCause::Output => told += 1,
            LatchCause::Skip => {
                begun += 1;
                if let Some(before) = began_ns {
                    worst_interval = worst_interval.max(off(before, latch.t_ns, PULSE_US));
                }
                began_ns = Some(latch.t_ns);
            }
            LatchCause::SkipEnd => {
                ended += 1;
                let width = off(began_ns.unwrap_or(0), latch.t_ns, PULSE.width_us.into());
                worst_width = worst_width.max(width);
            }
            _ => {}
        }
    }
    let _ = station.trigger_out(TriggerOut::Off);
    settle().await;
    watch(SKIP);
    drain().await;
    let all = if taken { told.min(begun).min(ended) } else { 0 };
    table
        .exactly("trigger pulses sent and told", edges.into(), all, "")
        .await?;
    table
        .at_most("their width of 20 us", PULSE_NS, worst_width, "ns off")
        .await?;
    table
        .at_most("their interval of 5 ms", PULSE_NS, worst_interval, "ns off")
        .await
}

async fn looped(baud: u32) -> Heard {
    Transmitter.set_line(loopback::line(baud)).await;
    let back = |on| pac::UART0.uartcr().modify(|w| w.set_lbe(on));
    back(true);
    let heard = loopback::run(&mut Receiver, &mut Transmitter, &BoardClock, baud).await;
    back(false);
    heard
}

/// The control's line, led back inside the chip.
async fn line<L: LinkTx>(table: &mut Table<'_, L>) -> Result<(), Broken> {
    let fast = looped(loopback::FAST_BAUD).await;
    let slow = looped(loopback::SLOW_BAUD).await;
    loopback::tell(fast, slow, table).await
}

/// Whether the flash's cache counts, and what a line of the flash takes.
async fn cache<L: LinkTx>(table: &mut Table<'_, L>) -> Result<(), Broken> {
    let lines = i64::from(flash_cache::LINES);
    let reads = 2 * i64::from(flash_cache::WORDS) * lines;
    let seen = flash_cache::measure();
    table
        .exactly("reads of the flash counted", reads, seen.reads.into(), "")
        .await?;
    // Once for each word, or once for each line where a miss brings the whole of it.
    let missed = seen.reads.saturating_sub(seen.hits);
    table
        .at_most("of them not in its cache", reads / 2, missed.into(), "")
        .await?;
    let cycles = i64::from(seen.longer_us) * i64::from(CYCLES_PER_US);
    table
        .at_most(
            "a line that is not",
            LINE_CYCLES,
            (cycles + lines / 2) / lines,
            "cycles",
        )
        .await
}

/// The rings are restarted as after a loss: no position may move.
async fn restarted<L: LinkTx>(
    station: &mut Station,
    encoders: &mut Encoders,
    restarts: u32,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    let before = station.positions();
    let mut held = 0_i64;
    for number in 0..restarts {
        latch::restart();
        // Until the ring has samples of its own again.
        drive::settle();
        if station.positions().counts == before.counts {
            held += 1;
        }
        if number % 64 == 0 {
            Timer::after_micros(50).await;
        }
    }
    let name = "restarts of the rings that keep positions";
    table.exactly(name, restarts.into(), held, "").await?;
    settle().await;
    for _ in 0..100 {
        for axis in 0..AXES {
            encoders.step(axis, true);
        }
        drive::settle();
    }
    settle().await;
    let after = station.positions();
    let kept = (0..AXES)
        .filter(|axis| way(&before, &after, *axis) == 100)
        .count();
    table
        .exactly(
            "axes that count on behind them",
            AXES as i64,
            kept as i64,
            "",
        )
        .await
}
