//! Programs read by the virtual machine's interpreter.

use umi_core::units::Point;
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd, WorkOffset};
use umi_virtual::nc::ControlFamily;
use umi_virtual::nc::{Alarm, Control, ControlSettings, ProgramState, Recorder};

use crate::dialects::V;

pub const O8830: &str = include_str!("../../../../hw/control/haas/O8830-correction.nc");

/// The interpreter for a dialect.
pub const fn language(dialect: Dialect) -> ControlFamily {
    match dialect {
        Dialect::Haas | Dialect::HaasVariables => ControlFamily::Haas,
        Dialect::MazakSettingError | Dialect::MitsubishiSettingError => ControlFamily::Mitsubishi,
        Dialect::LinuxCnc => ControlFamily::LinuxCnc,
        Dialect::Grbl => ControlFamily::Grbl,
        Dialect::G10G68 | Dialect::G68ThreeD | Dialect::FanucSettingError | Dialect::Variables => {
            ControlFamily::Fanuc
        }
        // Read by `by_hand`, and by people.
        Dialect::Siemens | Dialect::Heidenhain => ControlFamily::Fanuc,
    }
}

/// The words with which a part program calls the work offset.
fn called(spec: &CorrectionSpec) -> String {
    match (spec.write_to, spec.dialect) {
        (WorkOffset::Extended(p), Dialect::Haas | Dialect::HaasVariables) => {
            format!("G154 P{p}")
        }
        (offset, _) => offset.to_string(),
    }
}

/// A path over the points. It says its own modes, as a part program has to behind a correction.
pub fn path(points: &[V]) -> String {
    let go = |p: &V| format!("G0 X{:.3} Y{:.3} Z{:.3}\n", p.x, p.y, p.z);
    String::from("G17 G21 G90\n") + &points.iter().map(go).collect::<String>()
}

/// Runs a program to its end.
fn run(control: &mut Control, axes: &mut Recorder, program: u32) -> Result<(), Alarm> {
    control.select(program)?;
    loop {
        let step = control.run(axes)?;
        if step.state == ProgramState::Ended {
            return Ok(());
        }
        // A stop that asks for values which were keyed in before.
        assert_eq!(step.state, ProgramState::Stopped);
    }
}

/// Where the axes were sent.
fn ends(axes: &Recorder) -> Vec<V> {
    axes.motions
        .iter()
        .map(|(_, motion)| motion.to.mm)
        .collect()
}

/// What a Haas does with E lines.
pub fn assignments(text: &str) -> String {
    text.lines()
        .map(|line| line.replacen('E', "#", 1).replacen(' ', "=", 1) + "\n")
        .collect()
}

/// Keys the values of the comments into the set.
fn key_in(control: &mut Control, text: &str) {
    let words = |line: &str| -> Vec<f64> {
        let numbers = line.trim_matches(['(', ')']).split(' ').skip(2);
        numbers.map(|word| word[1..].parse().unwrap()).collect()
    };
    let mut lines = text.lines().filter(|line| line.starts_with("(SET "));
    let (shift, angles) = (lines.next().unwrap(), lines.next().unwrap());
    let set = shift.split(' ').nth(1).unwrap().parse().unwrap();
    let values: Vec<f64> = words(shift).into_iter().chain(words(angles)).collect();
    let values = values.try_into().unwrap();
    control.offsets_mut().set_setting_error(set, values);
}

/// Where the control sends the axes for the points of a part program that comes after the
/// correction.
pub fn read(spec: &CorrectionSpec, text: &str, points: &[V]) -> Vec<V> {
    let mut control = Control::new(ControlSettings::of(language(spec.dialect)));
    corrected(&mut control, spec, text, points).unwrap_or_else(|alarm| panic!("{alarm}\n{text}"))
}

pub fn corrected(
    control: &mut Control,
    spec: &CorrectionSpec,
    text: &str,
    points: &[V],
) -> Result<Vec<V>, Alarm> {
    let home = Point::from_mm(0.0, 0.0, 0.0);
    moved(control, &mut Recorder::new(home, home), spec, text, points)
}

/// The same; what has moved until an alarm is in the axes.
pub fn moved(
    control: &mut Control,
    axes: &mut Recorder,
    spec: &CorrectionSpec,
    text: &str,
    points: &[V],
) -> Result<Vec<V>, Alarm> {
    let path = path(points);
    let set = umi_core::correction::dialect::form(spec.dialect).set(spec);
    let main = match (spec.dialect, spec.ends_with) {
        // One file: the subroutine, then its call.
        (Dialect::LinuxCnc, ProgramEnd::M99) => {
            let sub = text.strip_suffix("M2\n").unwrap();
            let main = format!("{sub}o<umi_correction> call\n{path}M2\n");
            let loaded = control.load(&main)?;
            run(control, axes, loaded[0])?;
            return Ok(ends(axes));
        }
        (Dialect::LinuxCnc, ProgramEnd::M30) => {
            let loaded = control.load(text)?;
            run(control, axes, loaded[0])?;
            format!("G21 G90 {}\n{path}M2\n", called(spec))
        }
        (Dialect::Grbl, _) => format!("{text}{path}M30\n"),
        (Dialect::HaasVariables, _) => {
            control.load(O8830)?;
            let set = assignments(text);
            format!("%\nO0001\n{set}M98 P8830\n{path}M30\n%\n")
        }
        (dialect, ends_with) => {
            let loaded = control.load(text)?;
            assert_eq!(loaded, [u32::from(spec.program_number)]);
            let by_hand = matches!(
                dialect,
                Dialect::MazakSettingError | Dialect::MitsubishiSettingError
            );
            if by_hand {
                key_in(control, text);
            }
            let is_set = umi_core::correction::dialect::form(dialect).in_set;
            let call = if ends_with == ProgramEnd::M99 && !by_hand {
                "M98 P9010".to_string()
            } else {
                if ends_with == ProgramEnd::M30 {
                    run(control, axes, 9010)?;
                }
                let sub = if ends_with == ProgramEnd::M99 {
                    "M98 P9010\n"
                } else {
                    ""
                };
                let set = if is_set {
                    format!("\nG54.4 P{set}")
                } else {
                    String::new()
                };
                format!("{sub}G21 G90 {}{set}", called(spec))
            };
            format!("%\nO0001\n{call}\n{path}M30\n%\n")
        }
    };
    let loaded = control.load(&main)?;
    run(control, axes, loaded[0])?;
    Ok(ends(axes))
}
