//! The task that has the station.

use embassy_futures::select::{Either3, select3};
use embassy_futures::yield_now;
use umi_core::point::station::{CapturePulses, CaptureStation, StationSetup};
use umi_core::units::Micros;
use umi_protocol::latch::TriggerPulse;
use umi_protocol::point_sensor::SensorOnBoard;

use super::inbox::{Capture, PointStation, Task};
use crate::board::{Clock, CncInput, SensorLines, SensorPort, SensorTrigger};

/// Characters of the sensor taken at once: some readings, so that captures have their turn.
const PIECE: usize = 64;

/// What is at the port.
#[derive(Default)]
struct Shown {
    trigger: Option<SensorTrigger>,
    lines: SensorLines,
}

/// Joins captures, readings and commands, for ever.
pub(crate) async fn sense(
    inbox: &PointStation,
    port: &mut impl SensorPort,
    clock: &impl Clock,
) -> ! {
    let mut station: Option<CaptureStation> = None;
    let mut pulse = TriggerPulse::default();
    let mut shown = Shown::default();
    let mut piece = [0; PIECE];
    loop {
        let patience = station.as_ref().and_then(CaptureStation::patience);
        let due = patience.map_or(u64::MAX, |us| clock.now().0.saturating_add(us.0));
        let came = select3(
            port.read(&mut piece),
            inbox.came(),
            clock.wait_until(Micros(due)),
        )
        .await;
        let now = clock.now();
        // Captures that came before what is read now are there before it.
        while let Some(task) = inbox.next() {
            match task {
                Task::Begin(sensor) => {
                    station = sensor.as_ref().map(begun);
                    if let Some(sensor) = sensor {
                        pulse = sensor.pulse;
                        port.set_baud(sensor.baud);
                    }
                }
                Task::Capture(capture) => latched(&mut station, &capture),
                Task::Line(line) => {
                    if let Some(station) = &mut station {
                        station.command(line, counts(port));
                    }
                }
            }
            settle(inbox, &mut station, port, pulse, &mut shown, now);
        }
        match came {
            Either3::First(CncInput::Bytes(count)) => {
                for byte in piece.get(..count).unwrap_or_default() {
                    if let Some(station) = &mut station {
                        station.sensor_byte(*byte, now);
                    }
                    if *byte == b'\n' {
                        while let Some(capture) = inbox.next_capture() {
                            latched(&mut station, &capture);
                        }
                        settle(inbox, &mut station, port, pulse, &mut shown, now);
                    }
                }
                // A sensor that is never quiet leaves others their turn.
                yield_now().await;
            }
            Either3::First(CncInput::Lost(count)) => {
                if let Some(station) = &mut station {
                    station.sensor_lost();
                    inbox.lost_characters(count);
                }
            }
            Either3::First(CncInput::End) | Either3::Second(()) => {}
            Either3::Third(()) => {
                if let Some(station) = &mut station {
                    station.tick(now);
                }
            }
        }
        settle(inbox, &mut station, port, pulse, &mut shown, now);
    }
}

/// A station that begins: kilobytes, made where nothing else is on the stack.
#[inline(never)]
fn begun(sensor: &SensorOnBoard) -> CaptureStation {
    CaptureStation::new(StationSetup::from(sensor))
}

fn latched(station: &mut Option<CaptureStation>, capture: &Capture) {
    if let Some(station) = station {
        station.missed(capture.missed);
        station.latched(capture.counts, Micros(capture.t_ns / 1000));
    }
}

/// Counts of X, Y and Z now.
fn counts(port: &mut impl SensorPort) -> [i64; 3] {
    let positions = port.positions();
    let mut counts = [0; 3];
    for (slot, count) in counts.iter_mut().zip(&positions.counts) {
        *slot = *count;
    }
    counts
}

/// Passes on what the station has to say, and does what it wants.
fn settle(
    inbox: &PointStation,
    station: &mut Option<CaptureStation>,
    port: &mut impl SensorPort,
    pulse: TriggerPulse,
    shown: &mut Shown,
    now: Micros,
) {
    let mut trigger = station.as_ref().map_or(SensorTrigger::Off, wanted);
    if shown.trigger != Some(trigger) {
        shown.trigger = Some(trigger);
        if port.trigger(trigger, pulse).is_err() {
            // There are none now, and the control hears it at once.
            shown.trigger = Some(SensorTrigger::Off);
            trigger = SensorTrigger::Off;
            if let Some(station) = station {
                station.pulses_refused();
            }
        }
    }
    let mut lines = SensorLines::REST;
    if let Some(station) = station {
        while let Some(record) = station.take_record() {
            inbox.tell(now, record);
        }
        inbox.tell_dropped(station.take_dropped());
        let signals = station.signals();
        lines = SensorLines {
            skip: station.skip(),
            parity: signals.parity,
            is_ok: signals.is_ok,
            has_no_signal: signals.has_no_signal,
        };
    }
    if shown.lines != lines {
        shown.lines = lines;
        port.show(lines);
    }
    let counters = station.as_ref().map(CaptureStation::counters);
    inbox.note(
        counters.unwrap_or_default(),
        lines,
        trigger != SensorTrigger::Off,
    );
    // Behind all that it stands for.
    if let Some(answer) = station.as_mut().and_then(CaptureStation::take_answer) {
        inbox.answer(answer);
    }
}

/// The pulses that the station wants.
fn wanted(station: &CaptureStation) -> SensorTrigger {
    match station.order() {
        CapturePulses::Off => SensorTrigger::Off,
        CapturePulses::Time => {
            let interval_us = station.interval_us();
            SensorTrigger::Every { interval_us }
        }
        CapturePulses::Distance {
            origin_counts,
            interval_counts,
        } => SensorTrigger::Lines {
            axis: 0,
            origin_counts,
            interval_counts: u32::try_from(interval_counts).unwrap_or(u32::MAX),
        },
    }
}
