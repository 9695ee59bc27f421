//! When planning ends.

use std::time::{Duration, Instant};

use crate::ScanError;

/// A search that may last no longer than it was told.
#[derive(Debug, Clone, Copy)]
pub struct Deadline(Option<Instant>);

impl Deadline {
    /// So long after a moment; a limit beyond all time is no limit.
    pub fn after(begun: Instant, limit: Duration) -> Self {
        Self(begun.checked_add(limit))
    }

    /// No limit.
    pub fn never() -> Self {
        Self(None)
    }

    /// Refuses once the time is up.
    ///
    /// # Errors
    /// `time_limit`.
    pub fn check(self) -> Result<(), ScanError> {
        if self.more() {
            return Ok(());
        }
        Err(ScanError::refused(
            "time_limit",
            "Planning was not done within --time-limit. Thin the mesh, plan a part of it, or allow more time.",
        ))
    }

    /// Is there so much time left?
    pub fn lasts(self, time: Duration) -> bool {
        self.0.is_none_or(|end| {
            Instant::now()
                .checked_add(time)
                .is_some_and(|then| then < end)
        })
    }

    /// Is there time for something that could be left out?
    pub fn more(self) -> bool {
        self.0.is_none_or(|end| Instant::now() < end)
    }
}
