//! The run on the virtual machine.

use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::{PlacePoint, PlaceState, ReadingText, StationRecord, StationSetup};
use umi_virtual::cell::Cell;
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::Alarm;
use umi_virtual::scene::Scene;
use umi_virtual::station::{SensorLineFault, SensorStation};

use super::program::program;
use super::question::{DigitizeQuestion, DigitizeRefusal, HeardBy};

/// The macros: the cycle, and the line to the board.
const CYCLE: u32 = 8840;
const COMMAND: u32 = 8842;

/// Alarm of the cycle: no signal at the first place of an adaptive run.
const NO_SIGNAL: u32 = 154;

/// A place of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DigitizedPlace {
    /// Row, along Y.
    pub row: usize,
    /// Column, along X.
    pub column: usize,
    /// What was measured.
    pub found: PlacePoint,
}

/// What came of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Digitized {
    /// The places in the order of measuring.
    pub places: Vec<DigitizedPlace>,
    /// Time of the cycle.
    pub duration_s: f64,
    /// Way of the axes in it.
    pub path_mm: f64,
    /// Captures of the sensor.
    pub captures: u32,
    /// Lines of the control to the board.
    pub exchanges: u32,
    /// Time that they took, the captures waited for left out.
    pub exchange_s: f64,
    /// Captures without a reading, and readings without a capture.
    pub losses: usize,
    /// The alarm at which the control stopped, if it did.
    pub alarm: Option<DigitizeRefusal>,
}

impl Digitized {
    /// Places with a point.
    #[must_use]
    pub fn points(&self) -> usize {
        self.places
            .iter()
            .filter(|place| place.found.state == PlaceState::Ok)
            .count()
    }

    /// Deviation of the readings from a target: rms and largest, mm.
    #[must_use]
    pub fn deviation_mm(&self, target_mm: f64) -> Option<(f64, f64)> {
        let all: Vec<f64> = self
            .places
            .iter()
            .filter(|place| place.found.state == PlaceState::Ok)
            .map(|place| place.found.gamma.0 - target_mm)
            .collect();
        let squares: f64 = all.iter().map(|d| d * d).sum();
        let most = all.iter().fold(0.0_f64, |most, d| most.max(d.abs()));
        (!all.is_empty()).then(|| ((squares / all.len() as f64).sqrt(), most))
    }
}

/// Writes the program and runs it. What the control stops at after its first place is in the
/// answer with all that was measured before.
///
/// # Errors
/// As [`DigitizeQuestion::check`] and [`program`]; `no_signal` at the first place of an adaptive
/// run, `collision`, `over_travel`.
pub fn run(
    mut scene: Scene,
    sensor: &PointSensor,
    asked: &DigitizeQuestion,
    seed: u64,
    fault: SensorLineFault,
) -> Result<Digitized, DigitizeRefusal> {
    let Some(spec) = scene.point_sensor.clone() else {
        return Err(DigitizeRefusal::new(
            "no_sensor",
            "the scene has no distance sensor: add a [point_sensor] table",
        ));
    };
    asked.check(&scene, &spec)?;
    let text = program(scene.control.nc.dialect, &spec, sensor, asked)?;
    let [columns, rows] = asked.grid();
    let limits = &mut scene.control.nc.limits;
    // A few passes for each place: so many blocks are meant.
    limits.loops = limits.loops.max(20 * (columns * rows) as u64);
    let station = SensorStation::new(
        StationSetup {
            sensor: *sensor,
            counts_per_mm: scene.machine.counts_per_mm,
            origin_counts: scene.machine.origin_counts,
            max_rate_hz: spec.max_rate_hz,
            power_max: spec.power_max,
            text: ReadingText::default(),
        },
        fault,
    );
    let mut cell = Cell::new(scene, seed, station);
    let mut meter = Meter::default();
    let ended = cell.run::<Alarm>(&text, |cell, step| {
        meter.block(&cell.machine, step.program, asked.rate_hz);
        Ok(())
    });
    let alarm = match ended {
        Ok(()) => None,
        Err(alarm) => {
            meter.block(&cell.machine, CYCLE, asked.rate_hz);
            Some(refusal(&alarm))
        }
    };
    let station = cell.machine.into_wires();
    let places: Vec<DigitizedPlace> = station
        .records()
        .iter()
        .filter_map(|record| match record {
            StationRecord::Place(found) => Some(placed(found, columns)),
            _ => None,
        })
        .collect();
    match alarm {
        // Before anything was measured there is nothing to keep.
        Some(alarm) if places.is_empty() || alarm.code != "alarm" => return Err(alarm),
        _ => {}
    }
    if asked.by == HeardBy::Pulses {
        on_their_grid(&places, asked)?;
    }
    let losses = station
        .records()
        .iter()
        .filter(|record| {
            matches!(
                record,
                StationRecord::Lost { .. } | StationRecord::Unpaired { .. }
            )
        })
        .count();
    Ok(Digitized {
        places,
        duration_s: meter.duration_s,
        path_mm: meter.path_mm,
        captures: station.measured(),
        exchanges: station.commands(),
        exchange_s: meter.exchange_s,
        losses: losses + station.dropped() as usize,
        alarm,
    })
}

/// On the way places are counted: one too few, and all behind it would stand beside their own.
fn on_their_grid(
    places: &[DigitizedPlace],
    asked: &DigitizeQuestion,
) -> Result<(), DigitizeRefusal> {
    let ([x, y, _], [f, h]) = (asked.at_mm, asked.step_mm);
    let strays = places.iter().find(|place| {
        let at = place.found.axes.mm;
        let off_x = at.x - x - f * place.column as f64;
        let off_y = at.y - y - h * place.row as f64;
        place.found.point.is_some() && (off_x.abs() > f / 2.0 || off_y.abs() > h / 2.0)
    });
    strays.map_or(Ok(()), |place| {
        Err(DigitizeRefusal::new(
            "lost_places",
            format!(
                "on the way to row {}, column {} the captures of a place were lost; digitize again, slower",
                place.row, place.column
            ),
        ))
    })
}

/// Where a place is: lines along X, alternating.
fn placed(found: &PlacePoint, columns: usize) -> DigitizedPlace {
    let number = found.number as usize;
    let (row, along) = (number / columns, number % columns);
    DigitizedPlace {
        row,
        column: if row % 2 == 0 {
            along
        } else {
            columns - 1 - along
        },
        found: *found,
    }
}

/// What an alarm is called. A control's own keeps its text.
fn refusal(alarm: &Alarm) -> DigitizeRefusal {
    let message = alarm.message.as_str();
    let code = if message.starts_with("over-travel") {
        "over_travel"
    } else if message.starts_with("collision") {
        "collision"
    } else if is_cycles(alarm, NO_SIGNAL) {
        "no_signal"
    } else {
        "alarm"
    };
    DigitizeRefusal::new(code, alarm.to_string())
}

/// Whether it is this alarm of the cycle: a control adds a number of its own, or shows it as it stands.
fn is_cycles(alarm: &Alarm, number: u32) -> bool {
    let shown = format!("#3000={number}:");
    alarm.program == CYCLE
        && (alarm.number.is_some_and(|of| of % 1000 == number) || alarm.message.starts_with(&shown))
}

/// Time and way of the cycle.
#[derive(Default)]
struct Meter {
    duration_s: f64,
    path_mm: f64,
    exchange_s: f64,
    at: Option<(f64, Vector3<f64>, u32)>,
}

impl Meter {
    /// A block of this program is done.
    fn block(&mut self, machine: &VirtualMachine<SensorStation>, program: u32, rate_hz: f64) {
        let status = machine.status();
        let captures = machine.wires().measured();
        let now = (status.seconds, status.position.mm, captures);
        if let Some((seconds, at, before)) = self.at
            && matches!(program, CYCLE | COMMAND | 8849)
        {
            let passed_s = now.0 - seconds;
            self.duration_s += passed_s;
            self.path_mm += (now.1 - at).norm();
            if program == COMMAND {
                // The captures that it waited for are no exchange.
                let waited_s = f64::from(captures - before) / rate_hz;
                self.exchange_s += (passed_s - waited_s).max(0.0);
            }
        }
        self.at = Some(now);
    }
}
