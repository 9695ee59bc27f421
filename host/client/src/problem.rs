//! What is wrong and what to do: a sentence for people, a stable code for machines.

use std::fmt;
use std::path::Path;

use serde_json::{Map, Value, json};

/// A text of somebody else as one line: its line ends stand there in letters, so that it makes no line
/// that looks like one of ours.
#[must_use]
pub fn one_line(text: impl fmt::Display) -> String {
    text.to_string().replace('\r', "\\r").replace('\n', "\\n")
}

/// Why something could not be done, or was done with the answer no.
#[derive(Debug)]
pub struct Problem {
    /// Whether it could be done at all.
    pub kind: ProblemKind,
    /// The stable name.
    pub code: &'static str,
    /// The sentence.
    pub message: String,
    /// Figures and places, for machines only.
    pub details: Map<String, Value>,
}

/// Whether it could be done at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProblemKind {
    /// It could not be done: usage, a file, a port, the board's connection.
    Trouble,
    /// It was done and the answer is no.
    Refused,
}

impl Problem {
    /// It could not be done, because of `message`.
    pub fn trouble(code: &'static str, message: impl fmt::Display) -> Self {
        Self::new(ProblemKind::Trouble, code, message)
    }

    /// It was done and the answer is no, because of `message`.
    pub fn refused(code: &'static str, message: impl fmt::Display) -> Self {
        Self::new(ProblemKind::Refused, code, message)
    }

    /// A file could not be read or written (`what`: "read", "write").
    pub fn file(what: &str, path: &Path, error: &std::io::Error) -> Self {
        let message = format_args!("cannot {what} {}: {error}", path.display());
        Self::trouble("file", message)
    }

    fn new(kind: ProblemKind, code: &'static str, message: impl fmt::Display) -> Self {
        Self {
            kind,
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

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Problem {}

impl From<umi_core::fit::FitError> for Problem {
    fn from(error: umi_core::fit::FitError) -> Self {
        Self::refused(error.code(), error)
    }
}
