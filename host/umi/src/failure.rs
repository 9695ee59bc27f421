//! A command's failure, and its exit status.
//!
//! | status | meaning |
//! | --- | --- |
//! | 0 | done; a verdict is OK |
//! | 1 | it could not be done: usage, a file, a port, the board's connection |
//! | 2 | it was done and the answer is no: refused, NG, a faulty record |

use std::fmt;
use std::path::Path;

use umi_client::problem::{Problem, ProblemKind};

/// Why a command does not end well.
#[derive(Debug)]
pub(crate) enum Failure {
    /// It could not be done (exit status 1), or the answer is no (exit status 2).
    Told(Problem),
    /// The answer is no and has been shown already, as a verdict NG. Exit status 2.
    Negative,
    /// Whoever reads our output has had enough, as `head` does. Exit status 0.
    OutputClosed,
}

impl Failure {
    /// It could not be done, because of `message`.
    pub fn trouble(code: &'static str, message: impl fmt::Display) -> Self {
        Self::Told(Problem::trouble(code, message))
    }

    /// It was done and the answer is no, because of `message`.
    pub fn refused(code: &'static str, message: impl fmt::Display) -> Self {
        Self::Told(Problem::refused(code, message))
    }

    /// A file could not be read or written (`what`: "read", "write").
    pub fn file(what: &str, path: &Path, error: &std::io::Error) -> Self {
        Self::Told(Problem::file(what, path, error))
    }

    /// With something more to say.
    #[must_use]
    pub fn noted(mut self, note: &str) -> Self {
        if let Self::Told(problem) = &mut self {
            problem.message += note;
        }
        self
    }

    /// The exit status.
    #[must_use]
    pub const fn status(&self) -> u8 {
        match self {
            Self::OutputClosed => 0,
            Self::Told(problem) => match problem.kind {
                ProblemKind::Trouble => 1,
                ProblemKind::Refused => 2,
            },
            Self::Negative => 2,
        }
    }

    /// What to say, if it has not been said.
    #[must_use]
    pub const fn problem(&self) -> Option<&Problem> {
        match self {
            Self::Told(problem) => Some(problem),
            Self::Negative | Self::OutputClosed => None,
        }
    }
}

impl<P: Into<Problem>> From<P> for Failure {
    fn from(problem: P) -> Self {
        Self::Told(problem.into())
    }
}
