//! Profiles from files, one after the other in constant memory.
//!
//! * [`csv`]: a row per sample.
//! * [`gocator`]: a sensor's data channel, byte for byte; [`groups`]: its groups as they come.

pub mod csv;
pub mod gocator;
pub mod groups;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::table::TableReader;
use crate::ScanError;
use crate::profile::{Profile, Stamp};

/// How much of a file is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Who the profiles are; samples need not be decoded.
    Stamps,
    /// Their samples, too.
    Samples,
}

/// Hands out every profile of a file in its order: a `.gocator` capture, else CSV.
///
/// # Errors
/// `truncated`, `corrupt`, `not_finite`, or what `take` refuses.
pub fn visit(
    path: &Path,
    depth: Depth,
    take: impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let name = path.display().to_string();
    if path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("gocator"))
    {
        let file = File::open(path).map_err(|error| ScanError::file("read", path, &error))?;
        gocator::visit(BufReader::with_capacity(1 << 18, file), &name, depth, take)
    } else {
        csv::visit(TableReader::open(path)?, take)
    }
}

/// Who the profiles of a file are.
///
/// # Errors
/// As [`visit`].
pub fn stamps(path: &Path) -> Result<Vec<Stamp>, ScanError> {
    let mut stamps = Vec::new();
    visit(path, Depth::Stamps, |profile| {
        stamps.push(profile.stamp);
        Ok(())
    })?;
    Ok(stamps)
}
