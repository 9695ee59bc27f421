//! `umi nc`

mod check;
mod diff;
mod how;
mod rewrite;

use crate::failure::Failure;
use clap::{Args, Subcommand};

/// Part programs: rewrite a tool path by a transform, compare two
#[derive(Args)]
#[command(after_help = "\
Read are ISO programs (G code) of Fanuc, Haas, Mitsubishi, Mazak (EIA) and LinuxCNC. Programs in a
Sinumerik's, a Heidenhain's or a Mazatrol's own language are refused: write them out as ISO.

Examples:
  umi nc check part.nc
  umi nc rewrite part.nc -o here.nc --verdict today.umij
  umi nc diff part.nc here.nc --verdict today.umij -o diff.html")]
pub(crate) struct Nc {
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
}
