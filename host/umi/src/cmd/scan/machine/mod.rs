//! `umi scan machine`: machine files to begin with, and a look at one.

mod check;
mod new;

use clap::{Args, Subcommand};

use crate::failure::Failure;

/// Machine files: presets with comments, and what a file says
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi scan machine new mill -o mill.toml
  umi scan machine check mill.toml

Exit status: 0 answered, 1 usage or a file that cannot be understood, 2 refused.")]
pub(crate) struct Machine {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    New(new::New),
    Check(check::Check),
}

impl Machine {
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::New(command) => command.run(),
            What::Check(command) => command.run(),
        }
    }
}
