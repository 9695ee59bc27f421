//! A file that appears under its name only when it is complete.
//!
//! Until then it is `NAME.part`. A run that ends by itself, or by a signal that it can take ([`remove_unfinished`]), takes
//! it away; what a killed run left, the next one to the same name takes the place of.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::ScanError;

/// What this process has begun and not ended.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Takes away all files that are begun and not complete, for a process that an interrupt ends, and ends it: `exit` does not
/// return, so that nothing is begun behind this.
pub fn remove_unfinished(exit: impl FnOnce()) {
    let left = unfinished();
    for path in left.iter() {
        // If that fails, nobody can be told; the next run takes its place.
        let _ = std::fs::remove_file(path);
    }
    exit();
}

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
        let mut left = unfinished();
        let begin = || match std::fs::remove_file(&self.at) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => OpenOptions::new()
                .create_new(true)
                .read(true)
                .write(true)
                .open(&self.at),
        };
        let file = begin().map_err(|error| ScanError::file("write", &self.at, &error))?;
        left.push(self.at.clone());
        Ok(file)
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
        let mut left = unfinished();
        std::fs::rename(&self.at, &self.path).map_err(|error| self.failed(&error))?;
        left.retain(|path| *path != self.at);
        self.complete = true;
        Ok(())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.complete {
            unfinished().retain(|path| *path != self.at);
            // Nothing is left of a cloud that was refused; if that fails, nobody can be told.
            let _ = std::fs::remove_file(&self.at);
        }
    }
}
