//! `umi scan digitize`

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;
use umi_core::units::{Mm, Point};
use umi_desk::digitize::{self, DigitizeQuestion, DigitizeRefusal, Digitized};
use umi_scan::ScanError;
use umi_scan::point_sensor::calibration::{self, KnownSensor};
use umi_scan::point_sensor::cloud;
use umi_virtual::scene::{PointSensorSpec, Scene};
use umi_virtual::station::SensorLineFault;

use super::warned;
use crate::cmd::Format;
use crate::cmd::machine::run::scene;
use crate::cmd::scan::answer::{answer, failure};
use crate::failure::Failure;
use crate::output::Force;

/// A part digitized on the virtual machine with a distance sensor in the spindle, by a program for the control
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Digitize {
    /// The machine with its `[point_sensor]`, and the part
    #[arg(long, value_name = "SCENE.toml")]
    scene: PathBuf,
    /// What umi scan calibrate point --json has printed
    #[arg(long, value_name = "CAL.json")]
    calibration: PathBuf,
    /// How the sensor follows the surface (letter R)
    #[arg(long, value_enum)]
    strategy: Strategy,
    /// The axes' first place, machine coordinates, mm
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    at: String,
    /// Size of the rectangle along X and Y, mm (letters D, E)
    #[arg(long, value_name = "D,E", allow_hyphen_values = true)]
    size: String,
    /// Step along X and Y, mm (letters F, H)
    #[arg(long, value_name = "F,H", allow_hyphen_values = true)]
    step: String,
    /// Feed, mm/min (letter M)
    #[arg(
        long,
        default_value = "1000",
        value_name = "MM/MIN",
        allow_hyphen_values = true
    )]
    feed: f64,
    /// Safe height, machine Z; the height of the reference point unless given (letter Q)
    #[arg(long, value_name = "Z", allow_hyphen_values = true)]
    safe_z: Option<f64>,
    /// Adaptations at a place at most (letter U)
    #[arg(
        long,
        default_value = "1",
        value_name = "N",
        allow_hyphen_values = true
    )]
    adaptations: f64,
    /// Place in the depth of field, per cent from its near end; 5 to 95 where the sensor follows the surface (letter V)
    #[arg(
        long,
        default_value = "50",
        value_name = "PERCENT",
        allow_hyphen_values = true
    )]
    dof_position: f64,
    /// Captures a second (letter W)
    #[arg(
        long,
        default_value = "3000",
        value_name = "HZ",
        allow_hyphen_values = true
    )]
    rate_hz: f64,
    /// Power of the laser (letter X)
    #[arg(
        long,
        default_value = "2000",
        value_name = "N",
        allow_hyphen_values = true
    )]
    power: f64,
    /// Captures at a place (letter Z)
    #[arg(
        long,
        default_value = "1000",
        value_name = "N",
        allow_hyphen_values = true
    )]
    captures: f64,
    /// How the control hears of a reading: variables that are served, the skip input, or not at all
    #[arg(long, value_enum, default_value = "served")]
    by: By,
    /// Speed of the control's serial line
    #[arg(long, default_value = "9600", value_name = "BAUD", value_parser = clap::value_parser!(u32).range(50..=10_000_000))]
    baud: u32,
    /// Noise of sensor and machine: the same number, the same noise
    #[arg(long, default_value = "1", value_name = "N")]
    seed: u64,
    /// Where the cloud goes, CSV
    #[arg(short, long, value_name = "CLOUD.csv")]
    output: PathBuf,
    /// Keep the program for the control, too
    #[arg(long, value_name = "FILE")]
    nc: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

#[derive(Clone, Copy, ValueEnum)]
enum Strategy {
    NonAdaptive,
    Adaptive,
    PredictiveAdaptive,
}

#[derive(Clone, Copy, ValueEnum)]
enum By {
    Served,
    Trip,
    Pulses,
}

const HELP: &str = "\
Examples:
  umi scan digitize --scene scene.toml --calibration sensor.json --strategy adaptive \\
    --at -8,-8,223.5 --size 16,16 --step 2,2 -o cloud.csv
  umi scan digitize --scene scene.toml --calibration sensor.json --strategy predictive-adaptive \\
    --at -8,-8,223.5 --size 16,16 --step 2,2 --by trip --baud 115200 -o cloud.csv --nc part.nc

non-adaptive (and so --by pulses) stays at the height of --at and sees nothing come: it must clear
the whole part. The others look for a place whose signal is lost from a stand-off above the last
good height, so --safe-z must be a stand-off above the highest place; else such places are named and
left out. Nothing touches as long as the part, within the housing's radius of a place, stands
nowhere higher above the last good point than the stand-off less two depths of field.
Refused (status 2): over_travel, no_signal (at the first place of an adaptive run), collision,
rate_too_high, bad_input with the letter, other_lens, warm_scale, bad_calibration, bad_control, no_sensor, scene,
alarm (the control's own, with its text; what was measured before it is kept).";

/// What was done.
#[derive(Serialize)]
struct Told {
    kind: &'static str,
    strategy: &'static str,
    points: usize,
    missing: usize,
    duration_s: f64,
    path_mm: f64,
    captures: u32,
    dof_deviation_mm: Option<Deviation>,
    exchanges: u32,
    exchange_s: f64,
    losses: usize,
    /// What the calibration had warned of: it holds for the points as well.
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct Deviation {
    rms: f64,
    max: f64,
}

impl Digitize {
    pub fn run(self) -> Result<(), Failure> {
        cloud::check_ending(&self.output, &["csv"]).map_err(failure)?;
        self.force
            .check(&self.output, &[&self.scene, &self.calibration])?;
        if let Some(nc) = &self.nc {
            self.force
                .check(nc, &[&self.scene, &self.calibration, &self.output])?;
        }
        let mut scene = scene(&self.scene)?;
        scene.control.baud = self.baud;
        answer(self.make(scene), self.format.json, text)
    }

    fn make(&self, scene: Scene) -> Result<Told, ScanError> {
        let known = calibration::read(&self.calibration)?;
        let spec = scene.point_sensor.clone().ok_or_else(|| {
            ScanError::refused(
                "no_sensor",
                "the scene has no distance sensor: add a [point_sensor] table",
            )
        })?;
        known.check_scale()?;
        same_lens(&known, &spec)?;
        let asked = self.asked(&scene)?;
        if let Some(path) = &self.nc {
            asked.check(&scene, &spec).map_err(refused)?;
            let family = scene.control.nc.dialect;
            let program =
                digitize::program(family, &spec, &known.sensor, &asked).map_err(refused)?;
            std::fs::write(path, program)
                .map_err(|error| ScanError::file("write", path, &error))?;
        }
        let done = digitize::run(
            scene,
            &known.sensor,
            &asked,
            self.seed,
            SensorLineFault::None,
        )
        .map_err(refused)?;
        std::fs::write(&self.output, table(&done))
            .map_err(|error| ScanError::file("write", &self.output, &error))?;
        let [columns, rows] = asked.grid();
        let told = Told {
            kind: "digitize",
            strategy: asked.strategy.name(),
            points: done.points(),
            missing: columns * rows - done.points(),
            duration_s: done.duration_s,
            path_mm: done.path_mm,
            captures: done.captures,
            dof_deviation_mm: done
                .deviation_mm(asked.target_mm(&spec))
                .map(|(rms, max)| Deviation { rms, max }),
            exchanges: done.exchanges,
            exchange_s: done.exchange_s,
            losses: done.losses,
            warnings: known.warnings,
        };
        match (done.alarm.clone(), nothing(&done)) {
            (None, None) => Ok(told),
            (None, Some(why)) => Err(ScanError::refused("no_points", why)
                .with("points", told.points)
                .with("missing", told.missing)),
            (Some(alarm), _) => Err(refused(alarm)
                .with("points", told.points)
                .with("missing", told.missing)),
        }
    }

    fn asked(&self, scene: &Scene) -> Result<DigitizeQuestion, ScanError> {
        let [_, _, reference_z] = scene.machine.reference_mm;
        Ok(DigitizeQuestion {
            strategy: match self.strategy {
                Strategy::NonAdaptive => digitize::Strategy::NonAdaptive,
                Strategy::Adaptive => digitize::Strategy::Adaptive,
                Strategy::PredictiveAdaptive => digitize::Strategy::PredictiveAdaptive,
            },
            at_mm: numbers(&self.at, ["X of --at", "Y of --at", "Z of --at"])?,
            size_mm: numbers(&self.size, ["D", "E"])?,
            step_mm: numbers(&self.step, ["F", "H"])?,
            feed_mm_per_min: self.feed,
            safe_z_mm: self.safe_z.unwrap_or(reference_z),
            adaptations: self.adaptations,
            dof_position: self.dof_position,
            rate_hz: self.rate_hz,
            power: self.power,
            captures: self.captures,
            by: match self.by {
                By::Served => digitize::HeardBy::Served,
                By::Trip => digitize::HeardBy::Trip,
                By::Pulses => digitize::HeardBy::Pulses,
            },
        })
    }
}

/// Numbers with commas between them, each with its letter.
fn numbers<const N: usize>(text: &str, letters: [&str; N]) -> Result<[f64; N], ScanError> {
    let mut parts = text.split(',');
    let mut all = [0.0; N];
    for (slot, letter) in all.iter_mut().zip(letters) {
        let word = parts.next().unwrap_or("").trim();
        *slot = word
            .parse()
            .ok()
            .filter(|x: &f64| x.is_finite())
            .ok_or_else(|| {
                ScanError::refused(
                    "bad_input",
                    format_args!("letter {letter}: `{word}` is no number"),
                )
                .with("letter", letter)
            })?;
    }
    if parts.next().is_some() {
        return Err(ScanError::refused(
            "bad_input",
            format_args!("`{text}`: {N} numbers with commas between them are needed"),
        ));
    }
    Ok(all)
}

/// A calibration of this lens is nearer than that: a warm scale moves a point by hundredths. Two lenses in one mount are
/// centimetres apart, a wrong gain some tenths of a millimetre and more.
const OTHER_LENS_MM: f64 = 0.1;

/// A calibration at readings that this sensor does not have is another lens'.
fn same_lens(known: &KnownSensor, spec: &PointSensorSpec) -> Result<(), ScanError> {
    // On this machine it is known where the sensor's points are, and what it reads there.
    let direction = Point::from_array_mm(spec.direction).mm.normalize();
    let zero = Point::from_array_mm(spec.offset_mm).mm;
    let gain = 1.0 + spec.gain_error_ppm * 1e-6;
    let origin = Point::from_mm(0.0, 0.0, 0.0);
    let half_mm = spec.range_mm / 2.0;
    let off_mm = [-half_mm, 0.0, half_mm].map(|from_middle| {
        let way_mm = spec.stand_off_mm + from_middle;
        let said = known.sensor.place(origin, Mm(way_mm / gain)).mm;
        (said - (zero + direction * way_mm)).norm()
    });
    let off_mm = off_mm.into_iter().fold(0.0, f64::max);
    let is_swapped = known.sensor.direction.dot(&direction) < 0.0;
    // A beam that points the other way is the board's to find.
    if off_mm > OTHER_LENS_MM && !is_swapped {
        return Err(ScanError::refused(
            "other_lens",
            format_args!(
                "by the calibration a point of the depth of field is {off_mm:.3} mm from where this \
                 scene's sensor sees it: calibrate with this lens, in this mount, and look at its gain"
            ),
        ));
    }
    known.check_stand_off(
        spec.stand_off_mm,
        spec.range_mm / 2.0,
        format_args!(
            "this sensor reads {} mm about {} mm",
            spec.range_mm, spec.stand_off_mm
        ),
    )
}

fn refused(refusal: DigitizeRefusal) -> ScanError {
    let error = ScanError::refused(refusal.code, &refusal.message);
    match refusal.letter {
        Some(letter) => error.with("letter", letter.to_string()),
        None => error,
    }
}

/// A run in which not one place has a point, and why they have none.
fn nothing(done: &Digitized) -> Option<String> {
    if done.points() > 0 {
        return None;
    }
    let mut reasons = BTreeMap::new();
    for place in &done.places {
        *reasons.entry(place.found.state.code()).or_insert(0_usize) += 1;
    }
    let reasons: Vec<String> = reasons
        .iter()
        .map(|(reason, count)| format!("{reason} {count}"))
        .collect();
    Some(format!(
        "not one place has a point ({}; each place with its reason is in the table): look at --at, the calibration, the depth of \
         field and the rate",
        reasons.join(", ")
    ))
}

/// The cloud in the order of measuring.
fn table(done: &Digitized) -> String {
    let mut text =
        String::from("row,col,x_mm,y_mm,z_mm,gamma_mm,qx_mm,qy_mm,qz_mm,snr,total,status\n");
    for place in &done.places {
        let found = &place.found;
        let (row, column, state) = (place.row, place.column, found.state.code());
        // Writing to a string cannot fail.
        let _ = match found.point {
            Some(p) => {
                let (p, q) = (p.mm, found.axes.mm);
                writeln!(
                    text,
                    "{row},{column},{:.7},{:.7},{:.7},{:.7},{:.7},{:.7},{:.7},{:.7},{:.7},{state}",
                    p.x, p.y, p.z, found.gamma.0, q.x, q.y, q.z, found.snr, found.total
                )
            }
            None => writeln!(text, "{row},{column},,,,,,,,,,{state}"),
        };
    }
    text
}

fn text(told: &Told) -> String {
    let mut text = format!("{} points, {} missing\n", told.points, told.missing);
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{:.1} s, {:.1} mm of way, {} captures",
        told.duration_s, told.path_mm, told.captures
    );
    let _ = writeln!(
        text,
        "{} lines to the board, {:.1} s",
        told.exchanges, told.exchange_s
    );
    if let Some(off) = &told.dof_deviation_mm {
        let _ = writeln!(
            text,
            "readings off their target: rms {:.4} mm, {:.4} mm at most",
            off.rms, off.max
        );
    }
    text + &warned(&told.warnings)
}
