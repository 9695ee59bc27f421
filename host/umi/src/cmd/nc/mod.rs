//! `umi nc`

mod check;
mod diff;
mod how;
mod rewrite;

use clap::{Args, Subcommand};
use umi::failure::Failure;

/// Part programs: rewrite a tool path by a transform, compare two
#[derive(Args)]
#[command(after_help = "\
Examples:
  umi nc check part.nc
  umi nc rewrite part.nc -o here.nc --verdict today.jsonl
  umi nc diff part.nc here.nc --verdict today.jsonl -o diff.html")]
pub struct Nc {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Rewrite(rewrite::Rewrite),
    Check(check::Check),
    Diff(diff::Diff),
}

impl Nc {
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Rewrite(command) => command.run(),
            What::Check(command) => command.run(),
            What::Diff(command) => command.run(),
        }
    }

    /// Whether JSON is wanted.
    pub const fn json(&self) -> bool {
        match &self.what {
            What::Rewrite(command) => command.format.json,
            What::Check(command) => command.format.json,
            What::Diff(command) => command.format.json,
        }
    }
}
