//! The rows: each drives something and measures what the application's files make of it.

use embassy_futures::select::{Either, select};
use embassy_stm32::pac::gpio::vals::{Idr, Pupdr};
use embassy_stm32::pac::{GPIOB, USART2};
use embassy_time::{Duration, Timer};
use umi_app::board::{
    Axes as _, Broken, CncTx as _, LatchSource as _, LinkTx, SensorPort as _, SensorTrigger,
};
use umi_drivers::selftest::edges::{DrivenEdge, FoundEdges};
use umi_drivers::selftest::loopback::{self, Heard};
use umi_drivers::selftest::table::{Asked, Table};
use umi_protocol::latch::{LatchCause, LatchReport, Positions, SignalLevel, TriggerPulse};

use crate::axes::{self, LATCHES, Station};
use crate::drive::{self, Encoders};
use crate::past::Past;
use crate::ports::control::{Receiver, Transmitter};
use crate::ports::sensor::SensorEnd;
use crate::resources::{AXES, PULSES, SKIP, Signal, TIMERS, TRIGGER};
use crate::time::clock::BoardClock;
use crate::wires::WIRED_AXES;

/// What each axis is moved.
const WAYS: [i64; AXES] = [4000, -3000, 2000, -1000, 500];
const AXIS_ROWS: [&str; AXES] = [
    "position of axis 1",
    "position of axis 2",
    "position of axis 3",
    "position of axis 4",
    "position of axis 5",
];
const FAST_ROWS: [&str; WIRED_AXES.len()] = ["axis 1 at full speed", "axis 3 at full speed"];
/// Turns of four counts at full speed.
const FAST_TURNS: u32 = 10_000;
/// The plan is made for 20 M counts a second; this loop makes a few.
const LEAST_COUNTS_PER_S: i64 = 2_000_000;
/// Edges of either line are captured 500 times a second here, on average.
const PAUSE_US: u64 = 2_000;
/// A capture is told by then.
const PATIENCE: Duration = Duration::from_millis(5);
/// The times around an edge are known to a microsecond.
const INSTANT_NS: i64 = 2_000;
const PULSE: TriggerPulse = TriggerPulse {
    width_us: 20,
    rests: SignalLevel::Low,
};
const PULSE_US: u32 = 5_000;
/// The pin is looked at some hundred times in a microsecond.
const PULSE_NS: i64 = 500;

/// What is tested.
pub struct Bench {
    pub past: Past,
    pub station: Station,
    pub sensor: SensorEnd,
}

/// Everything, one after the other.
pub async fn all<L: LinkTx>(
    bench: &mut Bench,
    asked: Asked,
    mut table: Table<'_, L>,
) -> Result<(), Broken> {
    table.begin("nucleo-h743").await?;
    let Past {
        panic_is_noted,
        fault_is_noted,
        overflow_is_noted,
        more_starts,
    } = bench.past;
    table
        .exactly("panic noted", 1, panic_is_noted.into(), "")
        .await?;
    table
        .exactly("hard fault noted", 1, fault_is_noted.into(), "")
        .await?;
    table
        .exactly("stack overflow noted", 1, overflow_is_noted.into(), "")
        .await?;
    table
        .exactly("starts that nobody asked for", 0, more_starts.into(), "")
        .await?;

    // Every request begins where all inputs are low.
    drive::start();
    drive::settle();
    let mut encoders = Encoders::new();
    let station = &mut bench.station;
    positions(station, &mut encoders, &mut table).await?;
    speed(station, &mut encoders, &mut table).await?;
    let rows = ["skip edges captured", "triggers captured"];
    let [skips, triggers] = rows;
    lines(
        station,
        &mut encoders,
        &SKIP,
        [LatchCause::Skip, LatchCause::SkipEnd].map(Some),
        (skips, asked.edges),
        &mut table,
    )
    .await?;
    lines(
        station,
        &mut encoders,
        &TRIGGER,
        [Some(LatchCause::Trigger), None],
        (triggers, asked.edges),
        &mut table,
    )
    .await?;
    pulses(&mut bench.sensor, asked.edges, &mut table).await?;
    line(&mut table).await?;
    table.end().await
}

async fn next() -> Option<LatchReport> {
    match select((&mut &LATCHES).next(), Timer::after(PATIENCE)).await {
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
        if count % 64 == 0 {
            // USB has its turn.
            Timer::after_micros(50).await;
        }
    }
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
    encoders.align();
    let before = station.positions();
    encoders.run(FAST_TURNS);
    let after = station.positions();
    let promised = i64::from(4 * FAST_TURNS);
    for (axis, name) in WIRED_AXES.into_iter().zip(FAST_ROWS) {
        let measured = way(&before, &after, axis);
        table.exactly(name, promised, measured, "counts").await?;
    }
    let took_ns = after.t_ns.saturating_sub(before.t_ns);
    let took_us = i64::try_from(took_ns / 1000).unwrap_or(i64::MAX);
    let most_us = promised * 1_000_000 / LEAST_COUNTS_PER_S;
    table.at_most("time for that", most_us, took_us, "us").await
}

/// Drives an edge of a line to all its inputs, while the first axis moves on a count before it and one
/// behind it. Those that have a jumper come last, in the same cycle: the clock's capture, which
/// interrupts, is among them. Returns when it was.
fn edge(encoders: &mut Encoders, line: &[Signal; TIMERS], high: bool) -> (u64, u64) {
    encoders.step(0, true);
    drive::settle();
    // A look at the captures between the pulls and the wires would find half an edge.
    let time = cortex_m::interrupt::free(|_| {
        let mut wired = 0;
        for input in line {
            match drive::bit(input) {
                Some(bit) => wired |= bit,
                None => drive::set(input, high),
            }
        }
        drive::settle();
        let from_us = axes::now_ns() / 1000;
        drive::wires(wired, high);
        let to_us = axes::now_ns() / 1000;
        drive::settle();
        (from_us, to_us)
    });
    encoders.step(0, true);
    drive::settle();
    time
}

/// Rises and falls of a line, of which those with a cause are captured, on all axes.
async fn lines<L: LinkTx>(
    station: &mut Station,
    encoders: &mut Encoders,
    line: &[Signal; TIMERS],
    causes: [Option<LatchCause>; 2],
    (name, edges): (&str, u32),
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    // Low is what it is driven to first, which is no edge of this test.
    edge(encoders, line, false);
    drain().await;
    let mut found = FoundEdges::default();
    for _ in 0..edges {
        for (high, cause) in [true, false].into_iter().zip(causes) {
            let mut counts = station.positions().counts;
            if let Some(first) = counts.first_mut() {
                *first = first.wrapping_add(1);
            }
            let (from_us, to_us) = edge(encoders, line, high);
            if let Some(cause) = cause {
                let driven = DrivenEdge {
                    cause,
                    from_us,
                    to_us,
                    counts: &counts,
                };
                found.take(driven, next().await.as_ref());
            }
        }
        Timer::after_micros(PAUSE_US).await;
    }
    let each = causes.iter().flatten().count() as i64;
    found
        .tell(name, each * i64::from(edges), Some(INSTANT_NS), table)
        .await
}

/// The pulses to a distance sensor, by looking at their pin.
async fn pulses<L: LinkTx>(
    sensor: &mut SensorEnd,
    edges: u32,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    let every = SensorTrigger::Every {
        interval_us: PULSE_US,
    };
    let taken = sensor.trigger(every, PULSE).is_ok();
    let off = |from: u64, to: u64, promised_us: u32| {
        let took = i64::try_from(to.saturating_sub(from)).unwrap_or(i64::MAX);
        took.saturating_sub(i64::from(promised_us) * 1000).abs()
    };
    let (mut seen, mut worst_width, mut worst_interval) = (0_i64, 0_i64, 0_i64);
    let mut began_ns = None;
    for number in 0..=edges {
        // The one that is on already is not whole.
        let (Some(begins), Some(ends)) = (until(true), until(false)) else {
            break;
        };
        if number > 0 {
            seen += 1;
            worst_width = worst_width.max(off(begins, ends, PULSE.width_us.into()));
            if let Some(before) = began_ns {
                worst_interval = worst_interval.max(off(before, begins, PULSE_US));
            }
        }
        began_ns = Some(begins);
        // USB has its turn, and is done by the next one.
        Timer::after_micros(u64::from(PULSE_US) / 2).await;
    }
    let _ = sensor.trigger(SensorTrigger::Off, PULSE);
    let all = if taken { seen } else { 0 };
    table
        .exactly("pulses to a sensor", edges.into(), all, "")
        .await?;
    table
        .at_most("their width of 20 us", PULSE_NS, worst_width, "ns off")
        .await?;
    table
        .at_most("their interval of 5 ms", PULSE_NS, worst_interval, "ns off")
        .await
}

/// When the pulses' pin has come to this level, nanoseconds; none: not within two intervals. Nothing
/// else runs meanwhile but what takes a microsecond, and that shows in the figures.
fn until(high: bool) -> Option<u64> {
    let [signal] = &PULSES;
    let pin = usize::from(signal.pin.1 % 16);
    let last_ns = axes::now_ns().saturating_add(2_000 * u64::from(PULSE_US));
    loop {
        let now_ns = axes::now_ns();
        if (GPIOB.idr().read().idr(pin) == Idr::HIGH) == high {
            return Some(now_ns);
        }
        if now_ns > last_ns {
            return None;
        }
    }
}

/// Receiver and transmitter joined inside the chip (RM0433, 48.5.14, single-wire half-duplex): the
/// receiver's pin is not used, and that of the transmitter rests by its pull-up.
fn join_line() {
    let [transmit, ..] = &crate::resources::CONTROL;
    let pin = usize::from(transmit.pin.1 % 16);
    embassy_stm32::pac::GPIOD
        .pupdr()
        .modify(|w| w.set_pupdr(pin, Pupdr::PULL_UP));
    USART2.cr1().modify(|w| w.set_ue(false));
    USART2.cr3().modify(|w| w.set_hdsel(true));
}

async fn looped(baud: u32) -> Heard {
    Transmitter.set_line(loopback::line(baud)).await;
    loopback::run(&mut Receiver, &mut Transmitter, &BoardClock, baud).await
}

/// The control's line, led back inside the chip.
async fn line<L: LinkTx>(table: &mut Table<'_, L>) -> Result<(), Broken> {
    join_line();
    let fast = looped(loopback::FAST_BAUD).await;
    let slow = looped(loopback::SLOW_BAUD).await;
    loopback::tell(fast, slow, table).await
}
