//! The correction: in which words, from which work offset to which, and when it goes out.

use core::fmt;

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

/// The correction wanted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields)]
pub struct CorrectionSpec {
    /// The words that the control understands.
    pub dialect: Dialect,
    /// The work offset that was active while probing.
    pub probed_in: WorkOffset,
    /// That offset's values, machine coordinates.
    pub probed_origin_mm: [f64; 3],
    /// The work offset that the correction writes.
    pub write_to: WorkOffset,
    /// What else it writes: the set of `G54.4`, the row of the preset table.
    /// Absent: 1. Other dialects take none.
    #[serde(default)]
    pub set: Option<u16>,
    /// O-number of the correction program, 1 to 9999 without 8811 to 8849, which are the shipped
    /// macros'; part of its name where programs have one.
    pub program_number: u16,
    /// How the correction program ends.
    pub ends_with: ProgramEnd,
    /// Corner of the part with the smallest coordinates, CAD frame.
    pub part_min_mm: [f64; 3],
    /// Corner of the part with the largest coordinates, CAD frame.
    pub part_max_mm: [f64; 3],
    /// What the correction may leave at the part's corners: the tilt that the
    /// dialect cannot express, and its rounding.
    pub leftover_mm: f64,
    /// When the program goes out to the control.
    pub send: SendWhen,
}

/// The words that a control understands. What each can express, its number format and
/// where that is from, is in `umi_core::correction::dialect` and in `umi dialects`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum Dialect {
    /// `G10 L2 P` (`L20 P`) for the offset and `G68 X Y R` for the rotation in the plane.
    #[serde(rename = "g10-g68")]
    G10G68,
    /// `G10` for the offset and the three-dimensional conversion `G68 X Y Z I J K R`.
    #[serde(rename = "g68-3d")]
    G68ThreeD,
    /// Fanuc's workpiece setting error `G54.4 P`, written through its variables.
    #[serde(rename = "fanuc-g54.4")]
    FanucSettingError,
    /// Mazak's workpiece setup error `G54.4 P`, keyed in by the operator.
    #[serde(rename = "mazak-g54.4")]
    MazakSettingError,
    /// Mitsubishi's workpiece installation error `G54.4 P`, keyed in by the operator.
    #[serde(rename = "mitsubishi-g54.4")]
    MitsubishiSettingError,
    /// `#5221` and its like for the offset, a local variable for the rotation, read back.
    #[serde(rename = "variables")]
    Variables,
    /// Haas: the same, with `G154 P` beyond G59.
    #[serde(rename = "haas")]
    Haas,
    /// Haas: macro variables by `E` commands, for the macro O8830 to check and to apply.
    #[serde(rename = "haas-e")]
    HaasVariables,
    /// Siemens: a settable frame, `$P_UIFR`.
    #[serde(rename = "siemens")]
    Siemens,
    /// Heidenhain: a row of the preset table.
    #[serde(rename = "heidenhain")]
    Heidenhain,
    /// LinuxCNC: `G10 L2 P R`.
    #[serde(rename = "linuxcnc")]
    LinuxCnc,
    /// GRBL: `G10 L2 P`.
    #[serde(rename = "grbl")]
    Grbl,
}

impl Dialect {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::G10G68,
        Self::G68ThreeD,
        Self::FanucSettingError,
        Self::MazakSettingError,
        Self::MitsubishiSettingError,
        Self::Variables,
        Self::Haas,
        Self::HaasVariables,
        Self::Siemens,
        Self::Heidenhain,
        Self::LinuxCnc,
        Self::Grbl,
    ];

    /// The name used in files and on screens.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::G10G68 => "g10-g68",
            Self::G68ThreeD => "g68-3d",
            Self::FanucSettingError => "fanuc-g54.4",
            Self::MazakSettingError => "mazak-g54.4",
            Self::MitsubishiSettingError => "mitsubishi-g54.4",
            Self::Variables => "variables",
            Self::Haas => "haas",
            Self::HaasVariables => "haas-e",
            Self::Siemens => "siemens",
            Self::Heidenhain => "heidenhain",
            Self::LinuxCnc => "linuxcnc",
            Self::Grbl => "grbl",
        }
    }
}

/// A work offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum WorkOffset {
    /// `G10 L2 P1`
    G54,
    /// `G10 L2 P2`
    G55,
    /// `G10 L2 P3`
    G56,
    /// `G10 L2 P4`
    G57,
    /// `G10 L2 P5`
    G58,
    /// `G10 L2 P6`
    G59,
    /// One of the further ones by its number, in a file `{ extended = 7 }`: G54.1 P7,
    /// G154 P7 (Haas), G507 (Siemens).
    #[serde(rename = "extended")]
    Extended(u16),
}

impl WorkOffset {
    /// The P number of `G10 L2`, 1 for G54; of `G10 L20` for a further one.
    #[must_use]
    pub const fn p_number(self) -> u16 {
        match self {
            Self::G54 => 1,
            Self::G55 => 2,
            Self::G56 => 3,
            Self::G57 => 4,
            Self::G58 => 5,
            Self::G59 => 6,
            Self::Extended(number) => number,
        }
    }
}

impl fmt::Display for WorkOffset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Extended(number) => write!(f, "G54.1 P{number}"),
            _ => write!(f, "G{}", 53 + self.p_number()),
        }
    }
}

/// How the correction program ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub enum ProgramEnd {
    /// As a subprogram: back to the caller.
    M99,
    /// As a main program.
    M30,
}

/// When the correction program goes out to the control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum SendWhen {
    /// When the control asks: READ sends DC1 (XON).
    OnRequest,
    /// As soon as the verdict is OK.
    OnVerdict,
    /// Never over the serial line; only shown on the link.
    Never,
}
