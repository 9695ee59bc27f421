//! How a command ends when it does not end well, and the exit status for it.
//!
//! | status | meaning |
//! | --- | --- |
//! | 0 | done; a verdict is OK |
//! | 1 | it could not be done: usage, a file, a port, the board's connection |
//! | 2 | it was done and the answer is no: refused, NG, a faulty record |

use std::fmt;
use std::path::Path;

use serde_json::{Map, Value, json};

use crate::link::LinkError;

/// Why a command does not end well.
#[derive(Debug)]
pub enum Failure {
    /// It could not be done. Exit status 1.
    Trouble(Explained),
    /// It was done and the answer is no. Exit status 2.
    Refused(Explained),
    /// The answer is no and has been shown already, as a verdict NG. Exit status 2.
    Negative,
    /// Whoever reads our output has had enough, as `head` does. Exit status 0.
    OutputClosed,
}

/// What is wrong and what to do, for people and for machines.
#[derive(Debug)]
pub struct Explained {
    /// The stable name.
    pub code: &'static str,
    /// The sentence.
    pub message: String,
    /// Figures and places, for machines only.
    pub details: Map<String, Value>,
}

impl Failure {
    /// It could not be done, because of `message`.
    pub fn trouble(code: &'static str, message: impl fmt::Display) -> Self {
        Self::Trouble(Explained::new(code, message))
    }

    /// It was done and the answer is no, because of `message`.
    pub fn refused(code: &'static str, message: impl fmt::Display) -> Self {
        Self::Refused(Explained::new(code, message))
    }

    /// A file could not be read or written (`what`: "read", "write").
    pub fn file(what: &str, path: &Path, error: &std::io::Error) -> Self {
        Self::trouble(
            "file",
            format_args!("cannot {what} {}: {error}", path.display()),
        )
    }

    /// The exit status.
    #[must_use]
    pub const fn status(&self) -> u8 {
        match self {
            Self::OutputClosed => 0,
            Self::Trouble(_) => 1,
            Self::Refused(_) | Self::Negative => 2,
        }
    }

    /// What to say, if it has not been said.
    #[must_use]
    pub const fn explained(&self) -> Option<&Explained> {
        match self {
            Self::Trouble(explained) | Self::Refused(explained) => Some(explained),
            Self::Negative | Self::OutputClosed => None,
        }
    }
}

impl Explained {
    /// With no details.
    pub fn new(code: &'static str, message: impl fmt::Display) -> Self {
        Self {
            code,
            message: message.to_string(),
            details: Map::new(),
        }
    }

    /// With one more detail.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.details.insert(name.to_owned(), value.into());
        self
    }

    /// `{"error":{"code":…,"message":…}}`, with the details behind them.
    #[must_use]
    pub fn json(&self) -> Value {
        let mut error = Map::new();
        error.insert("code".into(), self.code.into());
        error.insert("message".into(), self.message.as_str().into());
        error.extend(self.details.clone());
        json!({ "error": error })
    }
}

impl From<umi_core::fit::FitError> for Failure {
    fn from(error: umi_core::fit::FitError) -> Self {
        Self::refused(error.code(), error)
    }
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Self {
        let code = match &error {
            LinkError::BadAddress { .. } => "bad_address",
            LinkError::NoSuchPort { .. } => "no_such_port",
            LinkError::CannotOpen { .. } => "cannot_open",
            LinkError::Closed(_) => "connection_closed",
            LinkError::NobodyAnswers { .. } => "nobody_answers",
            LinkError::Mismatch { .. } => "version_mismatch",
            LinkError::BoardChanged => "board_changed",
            LinkError::NoAnswer { .. } => "no_answer",
            LinkError::Damaged { .. } => "damaged_answer",
            LinkError::JobOutcomeUnknown { .. } => "job_outcome_unknown",
            LinkError::NotUnderstood { .. } => "not_understood",
            LinkError::WrongAnswer { .. } => "wrong_answer",
            LinkError::StorageFailed => "storage_failed",
        };
        Self::trouble(code, error)
    }
}
