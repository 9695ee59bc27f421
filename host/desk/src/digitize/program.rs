//! The program for the control.

use umi_core::point::PointSensor;
use umi_virtual::nc::ControlFamily;
use umi_virtual::scene::PointSensorSpec;

use super::question::{DigitizeQuestion, DigitizeRefusal, HeardBy};

const DIGITIZE: &str = include_str!("../../../../hw/control/fanuc/O8840-digitize.nc");
const BEAM: &str = include_str!("../../../../hw/control/fanuc/O8843-beam.nc");
const COMMAND: &str = include_str!("../../../../hw/control/fanuc/O8842-command.nc");
const SETTINGS: &str = include_str!("../../../../hw/control/fanuc/O8841-sensor.nc");

/// LinuxCNC's, in the order in which they are called.
const SUBROUTINES: [&str; 5] = [
    include_str!("../../../../hw/control/linuxcnc/umi_digitize.ngc"),
    include_str!("../../../../hw/control/linuxcnc/umi_from_above.ngc"),
    include_str!("../../../../hw/control/linuxcnc/umi_to_target.ngc"),
    include_str!("../../../../hw/control/linuxcnc/umi_beam.ngc"),
    include_str!("../../../../hw/control/linuxcnc/umi_command.ngc"),
];
const SENSOR: &str = include_str!("../../../../hw/control/linuxcnc/umi_sensor.ngc");

/// A program and the macros of `hw/control` with the settings of this sensor, each by itself.
pub(super) struct Parts {
    /// What is run.
    pub main: String,
    /// The settings.
    pub settings: String,
    /// The cycle, and what it calls on its way.
    pub cycle: Vec<String>,
    /// The line to the board.
    pub command: String,
    /// Custom Macro B, with numbered programs; else O words.
    pub is_macro_b: bool,
}

impl Parts {
    /// As one file.
    pub fn joined(&self) -> String {
        let mut text = String::new();
        if self.is_macro_b {
            text.push_str("%\n");
            text.push_str(&self.main);
            for part in [&self.settings]
                .into_iter()
                .chain(&self.cycle)
                .chain([&self.command])
            {
                text.push_str(&inner(part));
            }
            text.push_str("%\n");
        } else {
            // A subroutine stands before its call.
            for part in [&self.settings, &self.command]
                .into_iter()
                .chain(self.cycle.iter().rev())
            {
                text.push_str(&inner(part));
            }
            text.push_str(&self.main);
        }
        text
    }
}

/// The program of a run: the main program, and the macros of `hw/control` with the settings of
/// this sensor.
///
/// # Errors
/// `bad_control`: the control does not hear of a reading in this way.
pub fn program(
    family: ControlFamily,
    spec: &PointSensorSpec,
    sensor: &PointSensor,
    asked: &DigitizeQuestion,
) -> Result<String, DigitizeRefusal> {
    parts(family, spec, sensor, asked).map(|parts| parts.joined())
}

/// The same, each part by itself.
pub(super) fn parts(
    family: ControlFamily,
    spec: &PointSensorSpec,
    sensor: &PointSensor,
    asked: &DigitizeQuestion,
) -> Result<Parts, DigitizeRefusal> {
    if family.is_macro_b() {
        return Ok(macro_b(family, spec, sensor, asked));
    }
    if family == ControlFamily::Grbl {
        if asked.by != HeardBy::Pulses {
            return Err(DigitizeRefusal::new(
                "bad_control",
                "GRBL hears nothing of a reading: give --strategy non-adaptive --by pulses",
            ));
        }
        return Ok(fixed_path(spec, sensor, asked));
    }
    if asked.by == HeardBy::Served {
        return Err(DigitizeRefusal::new(
            "bad_control",
            "LinuxCNC reads no variables from a serial line: give --by trip or --by pulses",
        ));
    }
    Ok(o_words(spec, sensor, asked))
}

/// The values of the macro's letters in their order, without Y.
fn letters(asked: &DigitizeQuestion) -> [f64; 12] {
    let [d, e] = asked.size_mm;
    let [f, h] = asked.step_mm;
    [
        d,
        e,
        f,
        h,
        asked.feed_mm_per_min,
        asked.safe_z_mm,
        f64::from(asked.strategy.number()),
        asked.adaptations,
        asked.dof_position,
        asked.rate_hz,
        asked.power,
        asked.captures,
    ]
}

fn macro_b(
    family: ControlFamily,
    spec: &PointSensorSpec,
    sensor: &PointSensor,
    asked: &DigitizeQuestion,
) -> Parts {
    let [x, y, z] = asked.at_mm.map(number);
    let (tool, safe, feed) = (
        spec.tool,
        number(asked.safe_z_mm),
        number(asked.feed_mm_per_min),
    );
    let call: String = "DEFHMQRUVWXZ"
        .chars()
        .zip(letters(asked))
        .map(|(letter, value)| format!("{letter}{}", number(value)))
        .collect();
    let main = format!(
        "O0001(UMI SCAN DIGITIZE)\nG21G40G80G49G90G94\nT{tool}M6\nG65P8841\n\
         (OVER THE FIRST PLACE, THEN DOWN TO IT)\nG53G0Z{safe}\nG53G0X{x}Y{y}\n\
         G1Z[#5043-#5023+[{z}]]F{feed}\nG65P8840{call}\nM30\n"
    );
    let dwell = if family == ControlFamily::Haas {
        1.0
    } else {
        1000.0
    };
    let [ax, ay, az] = sensor.direction.into();
    let values = [
        ("#162=", ax),
        ("#163=", ay),
        ("#164=", az),
        ("#165=", spec.stand_off_mm),
        ("#166=", spec.range_mm),
        ("#167=", f64::from(asked.by.number())),
        ("#169=", spec.max_rate_hz),
        ("#170=", dwell),
    ];
    Parts {
        main,
        settings: settings(SETTINGS, &values),
        cycle: vec![DIGITIZE.to_owned(), BEAM.to_owned()],
        command: COMMAND.to_owned(),
        is_macro_b: true,
    }
}

fn o_words(spec: &PointSensorSpec, sensor: &PointSensor, asked: &DigitizeQuestion) -> Parts {
    let [x, y, z] = asked.at_mm.map(number);
    let (tool, safe, feed) = (
        spec.tool,
        number(asked.safe_z_mm),
        number(asked.feed_mm_per_min),
    );
    let call: String = letters(asked)
        .iter()
        .map(|value| format!(" [{}]", number(*value)))
        .collect();
    let main = format!(
        "(UMI SCAN DIGITIZE)\nG21 G40 G80 G49 G90 G94 G17\nT{tool} M6\nO<UMI_SENSOR> CALL\n\
         (OVER THE FIRST PLACE, THEN DOWN TO IT)\nG53 G0 Z{safe}\nG53 G0 X{x} Y{y}\n\
         G53 G1 Z{z} F{feed}\nO<UMI_DIGITIZE> CALL{call}\nM2\n"
    );
    let [ax, ay, az] = sensor.direction.into();
    let values = [
        ("#<_UMI_BEAM_X>=", ax),
        ("#<_UMI_BEAM_Y>=", ay),
        ("#<_UMI_BEAM_Z>=", az),
        ("#<_UMI_STAND_OFF>=", spec.stand_off_mm),
        ("#<_UMI_DEPTH>=", spec.range_mm),
        ("#<_UMI_HEARD>=", f64::from(asked.by.number())),
        ("#<_UMI_RATE>=", spec.max_rate_hz),
    ];
    let [digitize, from_above, to_target, beam, command] = SUBROUTINES.map(str::to_owned);
    Parts {
        main,
        settings: settings(SENSOR, &values),
        cycle: vec![digitize, from_above, to_target, beam],
        command,
        is_macro_b: false,
    }
}

/// GRBL: every place in machine coordinates, and M8 as the gate of the board.
fn fixed_path(spec: &PointSensorSpec, sensor: &PointSensor, asked: &DigitizeQuestion) -> Parts {
    let at = asked.at_mm;
    let [x, y, z] = at.map(number);
    let (safe, feed) = (number(asked.safe_z_mm), number(asked.feed_mm_per_min));
    let rest = number(16.0 / asked.rate_hz + 0.05);
    let mut main = format!(
        "(UMI SCAN DIGITIZE, FIXED PATH)\n(M8 IS THE BOARD'S GATE: WIRE IT BEFORE)\n\
         G21 G40 G80 G49 G90 G94 G17 M9\n(OVER THE FIRST PLACE, THEN DOWN TO IT)\n\
         G53 G0 Z{safe}\nG53 G0 X{x} Y{y}\nG53 G1 Z{z} F{feed}\n\
         (THE READING MUST FOLLOW ALONG THE BEAM)\n"
    );
    let a: [f64; 3] = sensor.direction.into();
    for step in [1.0, 0.0, -1.0, 0.0] {
        main.push_str(&format!("M8\nG4 P{rest}\nM9\n"));
        let away = step * spec.range_mm / 5.0;
        let mut words = String::from("G53 G1");
        for ((axis, from), a) in ["X", "Y", "Z"].iter().zip(at).zip(a) {
            words.push_str(&format!(" {axis}{}", number(from - a * away)));
        }
        main.push_str(&words);
        main.push('\n');
    }
    let ([first, from_y, _], [f, h]) = (at, asked.step_mm);
    let [columns, rows] = asked.grid();
    let ends = [first - 1.5 * f, first + (columns as f64 + 0.5) * f];
    for row in 0..rows {
        let [from, to] = if row % 2 == 0 {
            ends
        } else {
            [ends[1], ends[0]]
        };
        let y = from_y + row as f64 * h;
        main.push_str(&format!(
            "G53 G1 X{} Y{} Z{z}\nM8\nG53 G1 X{}\nM9\n",
            number(from),
            number(y),
            number(to)
        ));
    }
    main.push_str(&format!("G53 G0 Z{safe}\nM2\n"));
    Parts {
        main,
        settings: String::new(),
        cycle: Vec::new(),
        command: String::new(),
        is_macro_b: false,
    }
}

/// A macro without the tape's marks, and without the end of a file.
fn inner(text: &str) -> String {
    text.lines()
        .filter(|line| !matches!(line.trim(), "%" | "M2"))
        .map(|line| format!("{line}\n"))
        .collect()
}

/// The settings of this sensor in place of those of the file.
fn settings(text: &str, values: &[(&str, f64)]) -> String {
    text.lines()
        .map(|line| {
            let value = values.iter().find(|(name, _)| line.starts_with(name));
            match (value, line.split_once('(')) {
                (Some((name, value)), Some((_, comment))) => {
                    format!("{name}{}({comment}\n", number(*value))
                }
                _ => format!("{line}\n"),
            }
        })
        .collect()
}

/// A number with a decimal point, as a control reads it.
fn number(value: f64) -> String {
    let text = format!("{value:.8}");
    // `-0.` is a number, but not a fine one.
    let text = text.trim_end_matches('0');
    if text == "-0." {
        "0.".into()
    } else {
        text.into()
    }
}
