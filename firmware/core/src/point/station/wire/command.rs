//! The lines of the macro.
//!
//! ```text
//! UMIP S   12 K 1 A 2000.000 B 4000.000 D  400.000 E   44.000 F    1.000 H    1.000 C 4711
//! UMIP S   13 K 2 C 1234
//! ```
//!
//! `S` counts the lines, `K` is the command, `C` their check value. Blanks may stand anywhere
//! between letters and numbers, as DPRNT makes them.

use umi_protocol::point_sensor::MAX_COMMAND;

pub use umi_protocol::point_sensor::CommandFault;

use super::buffer::{LineBuffer, TooLong};
use crate::units::Mm;

/// Longest line.
const LINE: usize = MAX_COMMAND;

/// With what a line begins.
const NAME: &[u8] = b"UMIP";

/// The letters of a line in the order of the check value.
const LETTERS: [u8; 8] = *b"SKABDEFH";

/// A board goes this much beyond the target, away from the surface, so that it is always
/// approached from there.
const OVERSHOOT: Mm = Mm(0.05);

/// How the sensor is to be driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorConfiguration {
    /// Captures per second.
    pub rate_hz: f64,
    /// Power of the laser.
    pub power: f64,
    /// Captures at each place.
    pub captures: u32,
    /// Reading to which the sensor is brought.
    pub target: Mm,
    /// How far beyond it a trip away from the surface is.
    pub overshoot: Mm,
    /// Whether a signal that is lost on the way stops the axes.
    pub guards: bool,
    /// From place to place along X.
    pub interval: Mm,
}

/// What the macro asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorCommand {
    /// 1: configure the sensor.
    Configure(SensorConfiguration),
    /// 2: measure to adapt.
    Adapt,
    /// 3: measure.
    Measure,
    /// 4: finish.
    Finish,
    /// 5: raise the skip line at the target, from farther away.
    TripNear,
    /// 6: raise the skip line beyond the target, from nearer.
    TripFar,
    /// 7: pulses along X from here, a step and a half before the first place.
    Pulses,
    /// 8: no more pulses.
    Rest,
}

impl SensorCommand {
    /// Whether a control that is served calls for the answer: captures are over by then.
    #[must_use]
    pub const fn is_served(&self) -> bool {
        matches!(
            self,
            Self::Configure(_) | Self::Adapt | Self::Measure | Self::Finish
        )
    }
}

/// The check value of whole numbers, as the macro calculates it within eight digits.
#[must_use]
pub fn check_value(values: &[i64]) -> i64 {
    values.iter().fold(1, |check, value| {
        (check * 337 + value.rem_euclid(9973 * 1_000_000) + 3_330_982).rem_euclid(9973)
    })
}

/// A line as it comes.
#[derive(Debug, Default)]
pub struct CommandLine(LineBuffer<LINE>);

impl CommandLine {
    /// Nothing has come.
    #[must_use]
    pub const fn new() -> Self {
        Self(LineBuffer::new())
    }

    /// Whether what has come of a line so far may become a command.
    #[must_use]
    pub fn is_of_a_sensor(&self) -> bool {
        self.0.so_far().trim_ascii_start().starts_with(NAME)
    }

    /// The next byte; at the end of a line with something on it, what it asks for.
    pub fn byte(&mut self, byte: u8) -> Option<Result<(u16, SensorCommand), CommandFault>> {
        match byte & 0x7F {
            b'\n' | b'\r' => {}
            // Device controls, fill characters.
            control if control < b' ' => return None,
            byte => {
                self.0.push(byte);
                return None;
            }
        }
        match self.0.end().map(<[u8]>::trim_ascii) {
            Ok(b"" | b"%") => None,
            Ok(line) => Some(command(line)),
            Err(TooLong) => Some(Err(CommandFault::Unreadable)),
        }
    }
}

/// What a line asks for.
fn command(line: &[u8]) -> Result<(u16, SensorCommand), CommandFault> {
    let rest = line.strip_prefix(NAME).ok_or(CommandFault::Unreadable)?;
    let mut values = [None; LETTERS.len()];
    let mut check = None;
    let mut rest = rest.trim_ascii_start();
    while let Some((letter, behind)) = rest.split_first() {
        let (value, behind) = thousandths(behind).ok_or(CommandFault::Unreadable)?;
        if *letter == b'C' {
            check = Some(value);
        } else {
            let place = LETTERS.iter().position(|l| l == letter);
            let slot = place.and_then(|place| values.get_mut(place));
            match slot {
                Some(slot) if slot.is_none() => *slot = Some(value),
                _ => return Err(CommandFault::Unreadable),
            }
        }
        rest = behind.trim_ascii_start();
    }
    let mut told = [0; LETTERS.len()];
    let mut count = 0;
    for (slot, value) in told.iter_mut().zip(values.iter().flatten()) {
        *slot = *value;
        count += 1;
    }
    let stated = check.ok_or(CommandFault::Unreadable)?;
    if stated != check_value(told.get(..count).unwrap_or_default()) * 1000 {
        return Err(CommandFault::CheckValue);
    }
    let [Some(s), Some(k), rest @ ..] = values else {
        return Err(CommandFault::Unreadable);
    };
    let sequence = u16::try_from(s / 1000).map_err(|_| CommandFault::Value)?;
    let command = match (k, rest) {
        (1000, [Some(a), Some(b), Some(d), Some(e), Some(f), Some(h)]) => {
            SensorCommand::Configure(SensorConfiguration {
                rate_hz: a as f64 / 1000.0,
                power: b as f64 / 1000.0,
                captures: u32::try_from(d / 1000).map_err(|_| CommandFault::Value)?,
                target: Mm(e as f64 / 1000.0),
                overshoot: OVERSHOOT,
                guards: f > 0,
                interval: Mm(h as f64 / 1000.0),
            })
        }
        (2000, _) => SensorCommand::Adapt,
        (3000, _) => SensorCommand::Measure,
        (4000, _) => SensorCommand::Finish,
        (5000, _) => SensorCommand::TripNear,
        (6000, _) => SensorCommand::TripFar,
        (7000, _) => SensorCommand::Pulses,
        (8000, _) => SensorCommand::Rest,
        _ => return Err(CommandFault::Value),
    };
    Ok((sequence, command))
}

/// A number with up to three decimals in thousandths, and what stands behind it.
fn thousandths(text: &[u8]) -> Option<(i64, &[u8])> {
    let mut rest = text.trim_ascii_start();
    let is_negative = rest.first() == Some(&b'-');
    if is_negative {
        rest = rest.get(1..).unwrap_or_default().trim_ascii_start();
    }
    let (mut value, mut digits, mut decimals) = (0_i64, 0, None);
    while let Some((byte, behind)) = rest.split_first() {
        match byte {
            b'0'..=b'9' if digits < 12 && decimals != Some(3) => {
                value = value * 10 + i64::from(byte - b'0');
                digits += 1;
                decimals = decimals.map(|d: u32| d + 1);
            }
            b'0'..=b'9' => return None,
            b'.' if decimals.is_none() => decimals = Some(0),
            _ => break,
        }
        rest = behind;
    }
    if digits == 0 {
        return None;
    }
    for _ in decimals.unwrap_or(0)..3 {
        value *= 10;
    }
    Some((if is_negative { -value } else { value }, rest))
}
