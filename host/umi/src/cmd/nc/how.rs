//! Options that rewriting and checking have in common.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use umi::failure::Failure;
use umi::toolpath::{self, Source};
use umi_core::nc::rewrite::{Integers, Settings, Unit};
use umi_core::registration::RigidTransform;
use umi_core::units::Mm;

/// Which transform.
#[derive(Args)]
pub struct Which {
    /// The last verdict of a file of `umi replay --json`; it must be OK
    #[arg(long, value_name = "FILE", conflicts_with = "transform")]
    verdict: Option<PathBuf>,
    /// A JSON file: {"rotation": 3 rows, "translation_mm": [x, y, z]}
    #[arg(long, value_name = "FILE")]
    transform: Option<PathBuf>,
}

impl Which {
    /// The transform, if one was named.
    pub fn read(&self) -> Result<Option<Source>, Failure> {
        match (&self.verdict, &self.transform) {
            (Some(path), _) => toolpath::verdict(path).map(Some),
            (None, Some(path)) => toolpath::transform(path).map(Some),
            (None, None) => Ok(None),
        }
    }
}

/// What the control takes.
#[derive(Args)]
pub struct How {
    /// The control's smallest step, a power of ten; a tenth of the number in inches
    #[arg(long, value_name = "MM", default_value_t = 0.001)]
    increment_mm: f64,
    /// How far an arc may lie from its image, rounding included
    #[arg(long, value_name = "MM", default_value_t = 0.01)]
    chord_mm: f64,
    /// What a length without a decimal point counts; without this it is refused
    #[arg(long, value_enum)]
    integers: Option<Count>,
    /// The unit where the program says neither G20 nor G21
    #[arg(long, value_enum)]
    unit: Option<Length>,
    /// The origin of a work offset in machine coordinates, as G55=250,0,-40 (repeatable):
    /// a program with two of them and a rotation needs both
    #[arg(long, value_name = "G54=X,Y,Z", value_parser = origin)]
    origin: Vec<(usize, [f64; 3])>,
    /// How far pecks retract where a canned cycle is written out
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    clearance_mm: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Count {
    /// X100 is 100 mm (or inches)
    Units,
    /// X100 is 100 increments
    Increments,
}

#[derive(Clone, Copy, ValueEnum)]
enum Length {
    /// Millimetres
    Mm,
    /// Inches
    Inch,
}

fn origin(text: &str) -> Result<(usize, [f64; 3]), String> {
    let parsed = || {
        let (name, place) = text.split_once('=')?;
        let number: usize = name.trim_start_matches(['G', 'g']).parse().ok()?;
        let index = number.checked_sub(54).filter(|index| *index < 6)?;
        let numbers: Result<Vec<f64>, _> = place.split(',').map(|x| x.trim().parse()).collect();
        Some((index, numbers.ok()?.try_into().ok()?))
    };
    parsed().ok_or_else(|| "give it as G54=100,-250,-40.5 (G54 to G59, mm)".into())
}

impl How {
    /// The settings for a transform.
    pub fn settings(&self, transform: RigidTransform) -> Result<Settings<'static>, Failure> {
        let decimals = -self.increment_mm.log10();
        let is_power =
            (decimals - decimals.round()).abs() < 1e-9 && (1.0..=6.0).contains(&decimals.round());
        if !is_power {
            return Err(Failure::trouble(
                "usage",
                "--increment-mm is 0.1, 0.01 … 0.000001",
            ));
        }
        let mut origins_mm = [None; 6];
        for (index, place) in &self.origin {
            if let Some(slot) = origins_mm.get_mut(*index) {
                *slot = Some(*place);
            }
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "1 to 6"
        )]
        Ok(Settings {
            decimals_mm: decimals.round() as u8,
            chord: Mm(self.chord_mm),
            integers: self.integers.map(|count| match count {
                Count::Units => Integers::Units,
                Count::Increments => Integers::Steps,
            }),
            unit: self.unit.map(|unit| match unit {
                Length::Mm => Unit::Millimetre,
                Length::Inch => Unit::Inch,
            }),
            origins_mm,
            clearance: Mm(self.clearance_mm),
            ..Settings::new(transform)
        })
    }
}
