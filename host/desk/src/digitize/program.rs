//! The program for the control.

use std::fmt::Write as _;

use umi_core::point::PointSensor;
use umi_virtual::nc::ControlFamily;
use umi_virtual::scene::PointSensorSpec;

use super::question::{DigitizeQuestion, DigitizeRefusal};

const DIGITIZE: &str = include_str!("../../../../hw/control/fanuc/O8840-digitize.nc");
const COMMAND: &str = include_str!("../../../../hw/control/fanuc/O8842-command.nc");
const SETTINGS: &str = include_str!("../../../../hw/control/fanuc/O8841-sensor.nc");

/// The program of a run: the main program, and the macros of `hw/control` with the settings of
/// this sensor.
///
/// # Errors
/// `bad_control`: the control has no Custom Macro B.
pub fn program(
    family: ControlFamily,
    spec: &PointSensorSpec,
    sensor: &PointSensor,
    asked: &DigitizeQuestion,
) -> Result<String, DigitizeRefusal> {
    if !family.is_macro_b() {
        return Err(DigitizeRefusal::new(
            "bad_control",
            "this program needs Custom Macro B: set `dialect` in the scene's [control.nc] to \
             fanuc, haas or mitsubishi",
        ));
    }
    let [x, y, z] = asked.at_mm;
    let [d, e] = asked.size_mm;
    let [f, h] = asked.step_mm;
    let mut text = String::from("%\n");
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = text.write_fmt(arguments);
        text.push('\n');
    };
    line(format_args!("O0001(UMI SCAN DIGITIZE)"));
    line(format_args!("G21G40G80G49G90G94"));
    line(format_args!("T{}M6", spec.tool));
    line(format_args!("G65P8841"));
    line(format_args!("(OVER THE FIRST PLACE, THEN DOWN TO IT)"));
    line(format_args!("G53G0Z{}", number(asked.safe_z_mm)));
    line(format_args!("G53G0X{}Y{}", number(x), number(y)));
    line(format_args!(
        "G1Z[#5043-#5023+[{}]]F{}",
        number(z),
        number(asked.feed_mm_per_min)
    ));
    line(format_args!(
        "G65P8840D{}E{}F{}H{}M{}Q{}R{}.U{}V{}W{}X{}Z{}",
        number(d),
        number(e),
        number(f),
        number(h),
        number(asked.feed_mm_per_min),
        number(asked.safe_z_mm),
        asked.strategy.number(),
        number(asked.adaptations),
        number(asked.dof_position),
        number(asked.rate_hz),
        number(asked.power),
        number(asked.captures),
    ));
    line(format_args!("M30"));
    text.push_str(&inner(&settings(family, spec, sensor, asked)));
    text.push_str(&inner(DIGITIZE));
    text.push_str(&inner(COMMAND));
    text.push_str("%\n");
    Ok(text)
}

/// A macro without the tape's marks.
fn inner(text: &str) -> String {
    text.lines()
        .filter(|line| line.trim() != "%")
        .map(|line| format!("{line}\n"))
        .collect()
}

/// The settings of this sensor in place of those of the file.
fn settings(
    family: ControlFamily,
    spec: &PointSensorSpec,
    sensor: &PointSensor,
    asked: &DigitizeQuestion,
) -> String {
    let a = sensor.direction;
    let dwell = if family == ControlFamily::Haas {
        1.0
    } else {
        1000.0
    };
    let values = [
        ("#162=", a.x),
        ("#163=", a.y),
        ("#164=", a.z),
        ("#165=", spec.stand_off_mm),
        ("#166=", spec.range_mm),
        ("#167=", f64::from(asked.by.number())),
        ("#169=", spec.max_rate_hz),
        ("#170=", dwell),
    ];
    SETTINGS
        .lines()
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
