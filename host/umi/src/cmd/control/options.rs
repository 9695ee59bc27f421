//! Options about the control, for all commands that rewrite a program for it.

use crate::failure::Failure;
use clap::{Args, ValueEnum};
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{Integers, RewriteSettings, Rewriter, Unit};
use umi_core::units::Mm;
use umi_protocol::program::{IntegerRule, RewriteSpec, UnitRule};

use super::stated::Said;

/// What the control takes.
#[derive(Args)]
pub(crate) struct Control {
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
    /// How far pecks retract (G73), and stop short of the last depth (G83), where a canned cycle is
    /// written out: the control's parameter (Fanuc 5114, 5115). By itself 1 mm; with --dialect
    /// linuxcnc its 0.254 mm (0.010 inch)
    #[arg(long, value_name = "MM")]
    clearance_mm: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Count {
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

impl Control {
    fn decimals(&self) -> Result<u8, Failure> {
        let decimals = -self.increment_mm.log10();
        let whole = decimals.round();
        if (decimals - whole).abs() > 1e-9 || !(1.0..=6.0).contains(&whole) {
            return Err(Failure::trouble(
                "usage",
                "--increment-mm is 0.1, 0.01 … 0.000001",
            ));
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "1 to 6"
        )]
        Ok(whole as u8)
    }

    fn clearance_mm(&self, said: &Said) -> f64 {
        self.clearance_mm.unwrap_or_else(|| said.clearance_mm())
    }

    /// The settings for a transform.
    pub fn settings(
        &self,
        transform: RigidTransform,
        said: &Said,
    ) -> Result<RewriteSettings, Failure> {
        Ok(RewriteSettings {
            decimals_mm: self.decimals()?,
            chord: Mm(self.chord_mm),
            integers: self.integers.map(|count| match count {
                Count::Units => Integers::Units,
                Count::Increments => Integers::Steps,
            }),
            unit: self.unit.map(|unit| match unit {
                Length::Mm => Unit::Millimetre,
                Length::Inch => Unit::Inch,
            }),
            clearance: Mm(self.clearance_mm(said)),
            ..RewriteSettings::new(transform)
        })
    }

    /// What a board keeps with a program that it rewrites.
    pub fn spec(&self, said: &Said) -> Result<RewriteSpec, Failure> {
        let settings = self.settings(RigidTransform::identity(), said)?;
        Rewriter::new(&settings).map_err(|error| Failure::trouble("usage", error))?;
        Ok(RewriteSpec {
            decimals_mm: self.decimals()?,
            chord_um: micrometres("--chord-mm", self.chord_mm)?,
            clearance_um: micrometres("--clearance-mm", self.clearance_mm(said))?,
            integers: match self.integers {
                None => IntegerRule::Refused,
                Some(Count::Units) => IntegerRule::Units,
                Some(Count::Increments) => IntegerRule::Increments,
            },
            unit: match self.unit {
                None => UnitRule::Said,
                Some(Length::Mm) => UnitRule::Mm,
                Some(Length::Inch) => UnitRule::Inch,
            },
        })
    }
}

/// Whole micrometres, as a board keeps them.
fn micrometres(option: &str, mm: f64) -> Result<u16, Failure> {
    let um = (mm * 1000.0).round();
    if (um - mm * 1000.0).abs() > 1e-6 || !(0.0..=65_535.0).contains(&um) {
        return Err(Failure::trouble(
            "usage",
            format_args!("{option} is whole micrometres up to 65 mm where a board rewrites"),
        ));
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to 65535"
    )]
    Ok(um as u16)
}
