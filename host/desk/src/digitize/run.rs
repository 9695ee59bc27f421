//! The run on the virtual machine.

use nalgebra::Vector3;
use umi_core::point::PointSensor;
use umi_core::point::station::{
    ANSWER_PROGRAM, PlacePoint, PlaceState, ReadingText, SensorConfiguration, StationRecord,
    StationSetup,
};
use umi_core::units::Mm;
use umi_virtual::cell::Cell;
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::{Alarm, AxisDrives as _, Control, ControlFamily};
use umi_virtual::scene::{PointSensorSpec, Scene};
use umi_virtual::station::{SensorLineFault, SensorStation};

use super::program::{Parts, parts};
use super::question::{DigitizeQuestion, DigitizeRefusal, HeardBy};

/// The macros: the cycle, and the line to the board.
const CYCLE: u32 = 8840;
const COMMAND: u32 = 8842;
const BEAM: u32 = 8843;

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
/// As [`DigitizeQuestion::check`] and [`super::program()`]; `no_signal` at the first place of an adaptive
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
    let parts = parts(scene.control.nc.dialect, &spec, sensor, asked)?;
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
    let is_grbl = scene.control.nc.dialect == ControlFamily::Grbl;
    let mut cell = Cell::new(scene, seed, station);
    if is_grbl {
        // Nobody changes the tool there, and nobody tells the board what to do: both are
        // prepared before.
        let trip = |trip: umi_virtual::nc::Trip| DigitizeRefusal::new("alarm", trip.message);
        cell.machine.change_tool(spec.tool).map_err(trip)?;
        if !cell.machine.wires_mut().prepare(prepared(asked, &spec)) {
            return Err(DigitizeRefusal::letter(
                'W',
                "the sensor cannot be driven so",
            ));
        }
    }
    let (mut meter, text) = Meter::of(&mut cell.control, &parts)
        .map_err(|alarm| DigitizeRefusal::new("alarm", alarm.to_string()))?;
    let ended = cell.run::<Alarm>(&text, |cell, step| {
        meter.block(&cell.machine, step.program, asked.rate_hz);
        Ok(())
    });
    let alarm = match ended {
        Ok(()) => None,
        Err(alarm) => {
            meter.block(&cell.machine, alarm.program, asked.rate_hz);
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

/// What a board is told beforehand where the control cannot: as many captures a step as rate and
/// feed allow.
fn prepared(asked: &DigitizeQuestion, spec: &PointSensorSpec) -> SensorConfiguration {
    let [step_mm, _] = asked.step_mm;
    let possible = asked.rate_hz * step_mm * 60.0 / asked.feed_mm_per_min;
    SensorConfiguration {
        rate_hz: asked.rate_hz,
        power: asked.power,
        captures: asked.captures.min(possible.floor()) as u32,
        target: Mm(asked.target_mm(spec)),
        overshoot: Mm(0.0),
        guards: false,
        interval: Mm(step_mm),
    }
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

/// Whether it is this alarm of the cycle: a control adds a number of its own, or shows it as it
/// stands, or has no numbers.
fn is_cycles(alarm: &Alarm, number: u32) -> bool {
    let shown = format!("#3000={number}:");
    let is_numbered = alarm.program == CYCLE
        && (alarm.number.is_some_and(|of| of % 1000 == number)
            || alarm.message.starts_with(&shown));
    is_numbered || alarm.message.contains("NO SIGNAL AT FIRST PLACE")
}

/// Time and way of the cycle.
struct Meter {
    duration_s: f64,
    path_mm: f64,
    exchange_s: f64,
    at: Option<(f64, Vector3<f64>, u32)>,
    /// Numbers of the programs that belong to the cycle; none: all.
    cycle: Vec<u32>,
    /// Those of the line to the board, among them.
    command: Vec<u32>,
}

impl Meter {
    /// Loads the macros where they have no numbers of their own, so that each gets one; the text
    /// that is left to run.
    fn of(control: &mut Control, parts: &Parts) -> Result<(Self, String), Alarm> {
        let mut meter = Self {
            duration_s: 0.0,
            path_mm: 0.0,
            exchange_s: 0.0,
            at: None,
            cycle: vec![CYCLE, COMMAND, BEAM, ANSWER_PROGRAM],
            command: vec![COMMAND],
        };
        if parts.is_macro_b {
            return Ok((meter, parts.joined()));
        }
        if parts.cycle.is_empty() {
            // A fixed path is one program, and all of it the cycle.
            meter.cycle.clear();
            return Ok((meter, parts.main.clone()));
        }
        control.load(&parts.settings)?;
        meter.command = control.load(&parts.command)?;
        meter.cycle.clone_from(&meter.command);
        for part in &parts.cycle {
            meter.cycle.extend(control.load(part)?);
        }
        Ok((meter, parts.main.clone()))
    }

    /// A block of this program is done.
    fn block(&mut self, machine: &VirtualMachine<SensorStation>, program: u32, rate_hz: f64) {
        let status = machine.status();
        let captures = machine.wires().measured();
        let now = (status.seconds, status.position.mm, captures);
        if let Some((seconds, at, before)) = self.at
            && (self.cycle.is_empty() || self.cycle.contains(&program))
        {
            let passed_s = now.0 - seconds;
            self.duration_s += passed_s;
            self.path_mm += (now.1 - at).norm();
            if self.command.contains(&program) {
                // The captures that it waited for are no exchange.
                let waited_s = f64::from(captures - before) / rate_hz;
                self.exchange_s += (passed_s - waited_s).max(0.0);
            }
        }
        self.at = Some(now);
    }
}
