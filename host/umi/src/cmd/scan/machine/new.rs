//! `umi scan machine new`

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::super::super::Format;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{print, print_as_json};

/// A machine file to begin with
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct New {
    /// Which axes it has
    #[arg(value_enum)]
    preset: Preset,
    /// Where it goes; standard output without
    #[arg(short, long, value_name = "MACHINE.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Every figure of a preset is to be replaced by the machine's own: counts of the encoders,
places of the rotary axes (umi scan calibrate axis), the sensor's mount (umi scan calibrate
sensor). Its comments say which.

Examples:
  umi scan machine new mill -o mill.toml
  umi scan machine new c800u | less

With --json the answer names the preset and the file; without -o it has the file's text.";

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Preset {
    /// Three linear axes
    Mill,
    /// Three linear axes, a table that tilts (A) and turns (C), as a Hermle C 800 U has
    C800u,
    /// Three linear axes, a fork head that turns (C) and tilts (A)
    ForkHead,
    /// A bridge coordinate measuring machine with an indexing head
    BridgeCmm,
}

impl Preset {
    pub(super) const fn text(self) -> &'static str {
        match self {
            Self::Mill => include_str!("presets/mill.toml"),
            Self::C800u => include_str!("presets/c800u.toml"),
            Self::ForkHead => include_str!("presets/fork_head.toml"),
            Self::BridgeCmm => include_str!("presets/bridge_cmm.toml"),
        }
    }
}

impl New {
    pub fn run(&self) -> Result<(), Failure> {
        if let Some(path) = &self.output {
            self.force.write(path, &[], self.preset.text())?;
        }
        let preset = self.preset.to_possible_value();
        let preset = preset.as_ref().map(clap::builder::PossibleValue::get_name);
        match &self.output {
            Some(path) if self.format.json => print_as_json(
                &json!({"kind": "machine_new", "preset": preset, "output": path.display().to_string()}),
            ),
            None if self.format.json => print_as_json(
                &json!({"kind": "machine_new", "preset": preset, "text": self.preset.text()}),
            ),
            Some(_) => Ok(()),
            None => print(self.preset.text()),
        }
    }
}
