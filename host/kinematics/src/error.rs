//! What is wrong with a machine file.

use std::fmt;

/// A machine that cannot be: the file is no TOML, or describes what no machine is.
///
/// The stable name of the error is `machine` ([`Self::CODE`]).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MachineError {
    /// What is wrong and what to do.
    pub message: String,
    /// The text is no machine file at all: bad TOML, a missing or an unknown field.
    pub unreadable: bool,
}

impl MachineError {
    /// The stable name.
    pub const CODE: &'static str = "machine";

    /// The file is well formed, but no machine is like this.
    pub(crate) fn wrong(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            unreadable: false,
        }
    }

    /// The text is no machine file.
    pub(crate) fn unreadable(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            unreadable: true,
        }
    }
}

impl fmt::Display for MachineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for MachineError {}
