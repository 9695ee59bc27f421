//! The balls of a calibration: `[[sphere]] id, center_mm, radius_mm [, u_center_mm, u_radius_mm]`.

use std::path::Path;

use toml::{Table, Value};
use umi_core::point::CalibrationBall;
use umi_core::units::{Mm, Point};

use super::readings::SensorReading;
use crate::ScanError;

/// The keys of a ball.
const KEYS: [&str; 5] = ["id", "center_mm", "radius_mm", "u_center_mm", "u_radius_mm"];

/// Balls and what they are called.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrationBalls {
    /// Their names, in the order of the file.
    pub ids: Vec<String>,
    /// The balls.
    pub balls: Vec<CalibrationBall>,
}

/// Reads a file of balls.
///
/// # Errors
/// Exit status 1 if the file cannot be read. Refused: `bad_sphere`, `center_unknown`.
pub fn read(path: &Path) -> Result<CalibrationBalls, ScanError> {
    let bytes = std::fs::read(path).map_err(|error| ScanError::file("read", path, &error))?;
    let text = String::from_utf8_lossy(&bytes);
    parse(&text).map_err(|error| ScanError {
        message: format!("{}: {}", path.display(), error.message),
        ..error
    })
}

/// The balls in a text, as [`read`] reads them.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str) -> Result<CalibrationBalls, ScanError> {
    let file: Table = text.parse().map_err(|error: toml::de::Error| {
        bad(format_args!("this is no TOML: {}", error.message().trim()))
    })?;
    if let Some(key) = file.keys().find(|key| *key != "sphere") {
        return Err(bad(format_args!(
            "{key:?} is not known; every ball is a table [[sphere]]"
        )));
    }
    let entries = match file.get("sphere") {
        Some(Value::Array(entries)) if !entries.is_empty() => entries,
        _ => {
            return Err(bad(
                "it names no ball; every ball is a table [[sphere]] with id, center_mm, radius_mm",
            ));
        }
    };
    let mut balls = CalibrationBalls::default();
    for (place, entry) in entries.iter().enumerate() {
        let Value::Table(entry) = entry else {
            return Err(bad("every ball is a table [[sphere]]"));
        };
        let (id, ball) = one(entry, place, entries.len())?;
        if let Some(other) = balls.ids.iter().find(|other| is_same(other, &id)) {
            return Err(bad(format_args!(
                "two balls have the ids {other} and {id}: give each its own"
            )));
        }
        balls.ids.push(id);
        balls.balls.push(ball);
    }
    Ok(balls)
}

fn one(entry: &Table, place: usize, of: usize) -> Result<(String, CalibrationBall), ScanError> {
    if let Some(key) = entry.keys().find(|key| !KEYS.contains(&key.as_str())) {
        return Err(bad(format_args!(
            "{key:?} is not known of a ball; its keys are {}",
            KEYS.join(", ")
        )));
    }
    let id = match entry.get("id") {
        Some(Value::Integer(number)) => number.to_string(),
        Some(Value::String(name)) if !name.trim().is_empty() => name.trim().to_owned(),
        None if of == 1 => "1".to_owned(),
        _ => {
            return Err(bad(format_args!(
                "ball {} has no id: a whole number or a name",
                place + 1
            )));
        }
    };
    let radius_mm = length(entry, "radius_mm", &id)?
        .filter(|radius| *radius > 0.0)
        .ok_or_else(|| bad(format_args!("ball {id}: give radius_mm, a length above 0")))?;
    let Some(center) = entry.get("center_mm") else {
        return Err(ScanError::refused(
            "center_unknown",
            format_args!(
                "ball {id} has no center_mm: the sensor's offset cannot be found without; measure the centre with the touch probe"
            ),
        ));
    };
    let coordinates: Option<Vec<f64>> = center
        .as_array()
        .and_then(|all| all.iter().map(number).collect());
    let Some([x, y, z]) = coordinates.as_deref() else {
        return Err(bad(format_args!(
            "ball {id}: center_mm is three finite numbers"
        )));
    };
    let u = |key| -> Result<Mm, ScanError> {
        let u = length(entry, key, &id)?.unwrap_or(0.0);
        if u < 0.0 {
            return Err(bad(format_args!("ball {id}: {key} is below 0")));
        }
        Ok(Mm(u))
    };
    let ball = CalibrationBall {
        center: Point::from_mm(*x, *y, *z),
        radius: Mm(radius_mm),
        u_center: u("u_center_mm")?,
        u_radius: u("u_radius_mm")?,
    };
    Ok((id, ball))
}

fn length(entry: &Table, key: &str, id: &str) -> Result<Option<f64>, ScanError> {
    entry
        .get(key)
        .map(|value| {
            number(value).ok_or_else(|| bad(format_args!("ball {id}: {key} is a finite number")))
        })
        .transpose()
}

fn number(value: &Value) -> Option<f64> {
    let number = match value {
        Value::Float(number) => *number,
        // Whole millimetres; those beyond 2^53 are no lengths on a machine.
        Value::Integer(number) => *number as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

impl CalibrationBalls {
    /// The index of the ball that a reading names; the only one if it names none.
    ///
    /// # Errors
    /// `unknown_sphere`, and `missing_column` if it names none of several.
    pub fn of(&self, reading: &SensorReading) -> Result<usize, ScanError> {
        let Some(name) = &reading.sphere else {
            return if self.ids.len() == 1 {
                Ok(0)
            } else {
                Err(ScanError::refused(
                    "missing_column",
                    format_args!(
                        "line {} does not say which of the {} balls it is of: give a column \"sphere\"",
                        reading.line,
                        self.ids.len()
                    ),
                ))
            };
        };
        self.ids
            .iter()
            .position(|id| is_same(id, name))
            .ok_or_else(|| {
                ScanError::refused(
                    "unknown_sphere",
                    format_args!(
                        "line {} is of ball {name}, which is not given; given are {}",
                        reading.line,
                        self.ids.join(", ")
                    ),
                )
            })
    }
}

/// Whether two names are one ball's: spreadsheets write 1 as `1.0`.
fn is_same(id: &str, name: &str) -> bool {
    let number = |text: &str| text.parse::<f64>().ok();
    id == name || number(id).zip(number(name)).is_some_and(|(a, b)| a == b)
}

fn bad(message: impl std::fmt::Display) -> ScanError {
    ScanError::refused("bad_sphere", message)
}
