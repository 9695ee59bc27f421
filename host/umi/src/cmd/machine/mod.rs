//! `umi machine`

mod check;
mod floor;
mod run;
mod show;

use clap::{Args, Subcommand};
use umi::failure::Failure;

/// A virtual machine tool with its control: run NC programs at a desk
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi machine check probe.nc
  umi machine run probe.nc --scene examples/scenes/three-spheres.toml")]
pub struct Machine {
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

    /// Whether JSON is wanted.
    pub const fn json(&self) -> bool {
        match &self.what {
            What::Run(command) => command.format.json,
            What::Check(command) => command.format.json,
        }
    }
}
