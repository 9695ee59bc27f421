//! What a command moves by: a verdict or a transform. The options mean the same everywhere.

use std::path::{Path, PathBuf};

use clap::Args;
use umi_client::files::{key_file, tool_path};
use umi_client::job::correction::{Basis, JournalWord, WhichVerdict};
use umi_core::rewrite::MeasuredIn;

use crate::cmd::Board;
use crate::failure::Failure;

/// What is said where nothing was named.
pub(crate) const WHICH: &str = "by what? give --verdict FILE, --verdict board or --transform FILE";

/// By what a part is moved.
#[derive(Args)]
pub(crate) struct MovedBy {
    /// The last verdict, which must be OK: of a journal (`umi log -o`), of what `umi replay
    /// --json` printed, or `board`: of the board at --port
    #[arg(long, value_name = "FILE|board", conflicts_with = "transform")]
    verdict: Option<PathBuf>,
    /// The setup of the journal, instead of the last one
    #[arg(long = "plate", value_name = "NUMBER", requires = "verdict")]
    setup: Option<u32>,
    /// The verdict's entry in the journal, as `umi log` lists it: setups are counted anew after each
    /// start of the board
    #[arg(
        long,
        value_name = "SEQ",
        requires = "verdict",
        conflicts_with = "setup"
    )]
    entry: Option<u64>,
    /// The board's public key (umi access board-key): the journal must be signed by it
    #[arg(
        long,
        value_name = "BOARD.pub",
        requires = "verdict",
        conflicts_with = "transform"
    )]
    board_key: Option<PathBuf>,
    /// Take a journal at its word that no board has signed, as of a board without a key
    #[arg(long, requires = "verdict", conflicts_with_all = ["transform", "board_key"])]
    unsigned: bool,
    /// A JSON file: {"rotation": 3 rows, "translation_mm": [x, y, z]}
    #[arg(long, value_name = "FILE")]
    transform: Option<PathBuf>,
    #[command(flatten)]
    board: Board,
}

impl MovedBy {
    /// What was named, if anything was, in the coordinates of a work offset that is stated.
    ///
    /// # Errors
    /// It cannot be read, or is not OK; it needs the offset.
    pub fn read_in(&self, stated: Option<MeasuredIn>) -> Result<Option<Basis>, Failure> {
        let basis = self.read()?.map(|basis| basis.in_offset(stated));
        Ok(basis.transpose()?)
    }

    /// What was named, if anything was.
    ///
    /// # Errors
    /// It cannot be read, or is not OK.
    pub fn read(&self) -> Result<Option<Basis>, Failure> {
        let which = match (self.setup, self.entry) {
            (Some(setup), _) => WhichVerdict::Setup(setup),
            (None, Some(seq)) => WhichVerdict::Entry(seq),
            (None, None) => WhichVerdict::Last,
        };
        Ok(match (&self.verdict, &self.transform) {
            (Some(path), _) if path == Path::new("board") => {
                if self.board_key.is_some() {
                    return Err(Failure::trouble(
                        "usage",
                        "--board-key is for a journal: a board proves its key in a session (--key)",
                    ));
                }
                if which != WhichVerdict::Last {
                    return Err(Failure::trouble(
                        "usage",
                        "--plate and --entry are for a journal",
                    ));
                }
                Some(Basis::board(&mut self.board.connect()?)?)
            }
            (Some(path), _) => {
                let word = match &self.board_key {
                    Some(path) => JournalWord::Of(key_file::read_public(path)?),
                    None if self.unsigned => JournalWord::Unsigned,
                    None => JournalWord::Signed,
                };
                Some(Basis::verdict(path, which, &word)?)
            }
            (None, Some(path)) => Some(Basis::Given(Box::new(tool_path::transform(path)?))),
            (None, None) => None,
        })
    }

    /// Whether it is a verdict.
    pub const fn is_verdict(&self) -> bool {
        self.verdict.is_some()
    }

    /// The files that are read.
    pub fn inputs(&self) -> impl Iterator<Item = &Path> {
        [&self.verdict, &self.transform]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
    }
}
