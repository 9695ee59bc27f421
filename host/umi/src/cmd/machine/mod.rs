//! `umi machine`

pub(crate) mod check;
mod floor;
pub mod run;
mod show;

use crate::failure::Failure;
use clap::{Args, Subcommand};

/// A virtual machine tool with its control: run NC programs at a desk
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi machine check probe.nc
  umi machine run probe.nc --scene examples/scenes/three-spheres.toml")]
pub(crate) struct Machine {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Run(run::Run),
    Check(check::Check),
}

impl Machine {
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Run(command) => command.run(),
            What::Check(command) => command.run(),
        }
    }
}
