//! What a command moves by: a verdict or a transform. The options mean the same everywhere.

use std::path::{Path, PathBuf};

use clap::Args;
use umi_client::files::tool_path;
use umi_client::job::correction::{Basis, WhichVerdict};
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
                if which != WhichVerdict::Last {
                    return Err(Failure::trouble(
                        "usage",
                        "--plate and --entry are for a journal",
                    ));
                }
                Some(Basis::board(&mut self.board.connect()?)?)
            }
            (Some(path), _) => Some(Basis::verdict(path, which)?),
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
