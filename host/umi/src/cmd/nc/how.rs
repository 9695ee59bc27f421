//! Options that rewriting and checking have in common.

use std::path::PathBuf;

use clap::Args;
use umi::failure::Failure;
use umi::toolpath::{self, Source};
use umi_core::nc::rewrite::Settings;
use umi_core::registration::RigidTransform;

use crate::cmd::control::Control;

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

/// What the control takes, and what is known of its work offsets.
#[derive(Args)]
pub struct How {
    #[command(flatten)]
    control: Control,
    /// The origin of a work offset in machine coordinates, as G55=250,0,-40 (repeatable):
    /// a program with two of them and a rotation needs both
    #[arg(long, value_name = "G54=X,Y,Z", value_parser = origin)]
    origin: Vec<(usize, [f64; 3])>,
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
    pub fn settings(&self, transform: RigidTransform) -> Result<Settings, Failure> {
        let mut origins_mm = [None; 6];
        for (index, place) in &self.origin {
            if let Some(slot) = origins_mm.get_mut(*index) {
                *slot = Some(*place);
            }
        }
        Ok(Settings {
            origins_mm,
            ..self.control.settings(transform)?
        })
    }
}
