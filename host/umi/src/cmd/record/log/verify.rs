//! `umi log verify`: whether a file is the board's word.

use std::path::PathBuf;

use clap::Args;
use umi_client::files::{head_file, key_file};
use umi_client::journal::{self, verify};

use super::{Format, sum_up};
use crate::failure::Failure;

/// Check a pulled journal: every entry, and every head that the board has signed
#[derive(Args)]
#[command(after_help = "\
Without --key a file is held against the key in its own heads: that shows what was changed by
somebody without that key, not whose key it is. Get the board's key at the board, once:
`umi access board-key -o board.pub`. A head that you keep elsewhere (`umi log head -o`) shows a
file that was cut short, and a board whose older memory was put back; the file must hold its place.

Examples:
  umi log verify monday.umij
  umi log verify monday.umij --key board.pub
  umi log verify monday.umij --key board.pub --after friday.head --json

Exit status: 0 it holds; with --key, all of it is signed by that key. 1 a file or the usage.
2 it does not hold: the error names the first wrong entry (`seq`) and why.")]
pub(super) struct Verify {
    /// The journal
    #[arg(value_name = "FILE.umij")]
    file: PathBuf,
    /// The board's public key: all of the file must be signed by it
    #[arg(long, value_name = "BOARD.pub")]
    key: Option<PathBuf>,
    /// A head that was kept: the file must go on from it
    #[arg(long, value_name = "FILE.head")]
    after: Option<PathBuf>,
    #[command(flatten)]
    format: Format,
}

impl Verify {
    pub fn run(self) -> Result<(), Failure> {
        let bytes = journal::load(&self.file)?;
        let key = self.key.as_deref().map(key_file::read_public).transpose()?;
        let after = self.after.as_deref().map(head_file::read).transpose()?;
        let verified = verify::verify(&bytes, key, after.as_ref())?;
        let is_known = self.key.is_some() || self.after.is_some();
        sum_up(self.format.json, &verified, Some(&self.file), is_known)
    }
}
