//! How a scan's work ends when it does not end well.

use std::fmt;
use std::path::Path;

use serde_json::{Map, Value};
use umi_kinematics::MachineError;

/// Whether the answer is no, or there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// A file could not be read or understood. Exit status 1.
    Unreadable,
    /// All was understood, and the answer is no. Exit status 2.
    Refused,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanError {
    /// Refused, or not understood.
    pub ending: Ending,
    /// The stable name.
    pub code: &'static str,
    /// What is wrong and what to do.
    pub message: String,
    /// Figures and places, for machines.
    pub details: Map<String, Value>,
}

impl ScanError {
    /// The answer is no.
    pub fn refused(code: &'static str, message: impl fmt::Display) -> Self {
        Self::new(Ending::Refused, code, message)
    }

    /// A file that cannot be read or understood.
    pub fn unreadable(code: &'static str, message: impl fmt::Display) -> Self {
        Self::new(Ending::Unreadable, code, message)
    }

    /// The system does not read or write a file (`what`: "read", "write").
    #[must_use]
    pub fn file(what: &str, path: &Path, error: &std::io::Error) -> Self {
        Self::unreadable(
            "file",
            format_args!("cannot {what} {}: {error}", path.display()),
        )
    }

    /// With one more detail.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.details.insert(name.to_owned(), value.into());
        self
    }

    fn new(ending: Ending, code: &'static str, message: impl fmt::Display) -> Self {
        Self {
            ending,
            code,
            message: message.to_string(),
            details: Map::new(),
        }
    }
}

impl From<MachineError> for ScanError {
    fn from(error: MachineError) -> Self {
        if error.unreadable {
            Self::unreadable(MachineError::CODE, error)
        } else {
            Self::refused(MachineError::CODE, error)
        }
    }
}

impl fmt::Display for ScanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for ScanError {}
