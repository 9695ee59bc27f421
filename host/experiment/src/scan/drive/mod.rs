//! A scan path over the virtual machine: a program in, the sensor's channel and the board's
//! latches out.
//!
//! The machine of the specification runs the program; the firmware between the sensor and the
//! control pulses in time and latches all axes; the sensor takes a profile of the part's mesh at
//! each pulse. Where its laser is off it sends profiles without a range.
//!
//! * [`rig`]: machine and sensor of a specification, as scene, line scanner and machine file.
//! * [`laser`]: in which blocks the laser is on.

pub mod laser;
pub mod rig;
#[cfg(test)]
mod tests;

use umi_client::problem::Problem;
use umi_desk::pulsed::{PulsedDesk, PulsedRecord};
use umi_desk::shot::Shot;
use umi_kinematics::AxisChain;
use umi_scan::ScanError;
use umi_scan::parallel::Threads;
use umi_scan::plan::drive::touch::Scenery;
use umi_scan::plan::spec::ScanSpec;
use umi_scan::surface::Mesh;
use umi_virtual::cell::Cell;
use umi_virtual::nc::Alarm;
use umi_virtual::scanner::{LineProfile, LineScanner, PulseFate, ScannerTally};

/// Which language the control reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlLanguage {
    /// Fanuc's.
    Fanuc,
    /// LinuxCNC's.
    LinuxCnc,
}

impl ControlLanguage {
    /// Its name in a scene.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fanuc => "fanuc",
            Self::LinuxCnc => "linuxcnc",
        }
    }
}

/// How a path is driven.
#[derive(Clone, Copy, Debug)]
pub struct DriveOptions {
    /// The program's language.
    pub dialect: ControlLanguage,
    /// From pulse to pulse.
    pub interval_us: u32,
    /// Columns of the sensor.
    pub columns: u32,
    /// Standard deviation of a sample at normal incidence; it grows with 1/cos of the incidence.
    pub noise_um: f64,
    /// The noise grows with this power of 1/cos of the incidence instead, along the sample's column.
    pub noise_power: f64,
    /// Of the noise.
    pub seed: u64,
}

/// What came of it.
#[derive(Debug)]
pub struct Driven {
    /// The sensor's data channel, byte for byte.
    pub channel: Vec<u8>,
    /// What the board's host heard.
    pub record: PulsedRecord,
    /// What the sensor counted.
    pub tally: ScannerTally,
    /// Profiles with the laser on.
    pub lit: u64,
    /// On the machine's clock.
    pub machine_s: f64,
    /// The machine file.
    pub machine: AxisChain,
    /// The machine as the scene that was driven.
    pub scene: String,
}

/// How a run ends before its end.
enum Stop {
    Alarm(Alarm),
    Refused(ScanError),
}

impl From<Alarm> for Stop {
    fn from(alarm: Alarm) -> Self {
        Self::Alarm(alarm)
    }
}

fn trouble(problem: Problem) -> ScanError {
    ScanError::unreadable("virtual_board", problem.message)
}

/// Drives a program; `meshes` are the part and what stands beside it, in the part's frame.
///
/// # Errors
/// `machine_spec` where the virtual machine cannot be that of the specification; `alarm` where its
/// control stops; `collision` where the sensor's box touches something on the way; `virtual_board`.
pub fn drive(
    spec: &ScanSpec,
    meshes: Vec<&Mesh>,
    program: &str,
    options: &DriveOptions,
) -> Result<Driven, ScanError> {
    let scene_text = rig::scene_text(spec, options, program.contains("G43.4"))?;
    let scene = rig::scene(&scene_text)?;
    let scanner = rig::scanner(spec, options).ok_or_else(|| {
        ScanError::unreadable("sensor_spec", "The preset of the scanner is missing.")
    })?;
    let machine = rig::machine_file(spec);
    let machine_spec = scene.machine.clone();
    let lit_lines = laser::lit(program);
    let scenery = Scenery::new(spec, meshes.clone());
    let mut cell = Cell::new(scene, options.seed, PulsedDesk::new().map_err(trouble)?);
    let begun = cell.machine.wires_mut().begin(options.interval_us);
    begun.map_err(trouble)?;
    let (signature, _) = cell.machine.wires_mut().take();
    let mut shots: Vec<(Shot, bool)> = signature.into_iter().map(|shot| (shot, false)).collect();
    let mut looked: Option<Vec<f64>> = None;
    let ran = cell.run(program, |cell, step| {
        let (new, ways) = cell.machine.wires_mut().take();
        let on = usize::try_from(step.line).is_ok_and(|line| {
            line.checked_sub(1)
                .and_then(|line| lit_lines.get(line))
                .is_some_and(|on| *on)
        });
        shots.extend(new.into_iter().map(|shot| (shot, on)));
        for way in ways {
            let at = way.places(&machine_spec, 0.0);
            let before = looked.as_ref().unwrap_or(&at);
            if scenery.hits_between(&spec.machine, before, &at) {
                return Err(Stop::Refused(collision(step.line, &step.text, &at)));
            }
            looked = Some(at);
        }
        Ok(())
    });
    ran.map_err(|stop| match stop {
        Stop::Refused(error) => error,
        Stop::Alarm(alarm) => ScanError::refused(
            "alarm",
            format_args!("The control of the virtual machine stops: {alarm}."),
        ),
    })?;
    let machine_s = cell.machine.status().seconds;
    let record = cell.machine.into_wires().finish().map_err(trouble)?;
    let parts = rig::Parts { meshes };
    let mut sensor = LineScanner::new(scanner, options.seed);
    let optics = sensor.optics().clone();
    let seen = Threads::all().chunks(shots.len(), 8, |range| {
        let profile = |(shot, on): &(Shot, bool)| {
            if !on {
                return vec![None; optics.spec().samples as usize];
            }
            optics.profile(&parts, |us| {
                machine.sensor_in_workpiece(&shot.places(&machine_spec, us))
            })
        };
        shots[range].iter().map(profile).collect::<Vec<_>>()
    });
    let mut channel = Vec::new();
    let mut lit = 0;
    for ((shot, on), profile) in shots.iter().zip(seen.into_iter().flatten()) {
        if sensor.pulse(shot.at_us, shot.high_us) == PulseFate::Taken {
            lit += u64::from(*on);
            let profile = sensor.noisy(grown(profile, options.noise_power));
            channel.extend(sensor.send(shot.at_us, 0, &profile));
        }
    }
    Ok(Driven {
        channel,
        record,
        tally: sensor.tally(),
        lit,
        machine_s,
        machine,
        scene: scene_text,
    })
}

/// The sensor's noise grows with the secant of the incidence: the power of the cosine stands for the cosine.
fn grown(mut profile: LineProfile, power: f64) -> LineProfile {
    for sample in profile.iter_mut().flatten() {
        sample.cosine = sample.cosine.powf(power);
    }
    profile
}

fn collision(line: u32, text: &str, at: &[f64]) -> ScanError {
    let axes: Vec<String> = at.iter().map(|value| format!("{value:.3}")).collect();
    ScanError::refused(
        "collision",
        format_args!(
            "The sensor's box touches the part or an obstacle in line {line} `{}`, with the axes at {}.",
            text.trim(),
            axes.join(" ")
        ),
    )
    .with("line", line)
}
