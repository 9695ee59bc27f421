//! A file that appears under its name only when it is complete.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use crate::ScanError;

pub(super) struct Partial {
    path: PathBuf,
    /// Where it is until then.
    at: PathBuf,
    complete: bool,
}

impl Partial {
    pub fn new(path: &Path) -> Self {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        Self {
            path: path.to_owned(),
            at: path.with_file_name(name),
            complete: false,
        }
    }

    /// Begins it anew, to be written and read. A link that somebody has put under its name is taken away, not followed.
    pub fn begin(&self) -> Result<File, ScanError> {
        let begin = || match std::fs::remove_file(&self.at) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => OpenOptions::new()
                .create_new(true)
                .read(true)
                .write(true)
                .open(&self.at),
        };
        begin().map_err(|error| ScanError::file("write", &self.at, &error))
    }

    /// What the system says against writing it.
    pub fn failed(&self, error: &io::Error) -> ScanError {
        ScanError::file("write", &self.path, error)
    }

    /// What a format's writer says against it.
    pub fn refused(&self, error: impl std::fmt::Display) -> ScanError {
        ScanError::unreadable(
            "file",
            format_args!("cannot write {}: {error}", self.path.display()),
        )
    }

    pub fn complete(&mut self) -> Result<(), ScanError> {
        std::fs::rename(&self.at, &self.path).map_err(|error| self.failed(&error))?;
        self.complete = true;
        Ok(())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.complete {
            // Nothing is left of a cloud that was refused; if that fails, nobody can be told.
            let _ = std::fs::remove_file(&self.at);
        }
    }
}
