//! Profiles from files, one after the other in constant memory.
//!
//! * [`csv`]: a row per sample; [`three_lines`]: three lines a profile.
//! * [`gocator`]: a sensor's data channel, byte for byte; [`groups`]: its groups as they come.

pub mod csv;
pub mod gocator;
pub mod groups;
pub mod three_lines;

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
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
    /// Their samples, and how bright each was where the file says so.
    Intensities,
}

/// Hands out every profile of a file in its order: a `.gocator` capture, a table of three lines a
/// profile where the first line has no column names, else CSV. It says which frames a capture left out
/// ([`gocator::visit`]).
///
/// # Errors
/// `truncated`, `corrupt`, `not_finite`, or what `take` refuses.
pub fn visit(
    path: &Path,
    depth: Depth,
    take: impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
) -> Result<Vec<u64>, ScanError> {
    let name = path.display().to_string();
    if path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("gocator"))
    {
        let file = File::open(path).map_err(|error| ScanError::file("read", path, &error))?;
        gocator::visit(BufReader::with_capacity(1 << 18, file), &name, depth, take)
    } else if has_three_lines(path)? {
        let file = File::open(path).map_err(|error| ScanError::file("read", path, &error))?;
        three_lines::visit(BufReader::with_capacity(1 << 16, file), &name, take)
            .map(|()| Vec::new())
    } else {
        csv::visit(TableReader::open(path)?, depth, take).map(|()| Vec::new())
    }
}

/// Whether the first line that holds something begins a table of three lines a profile.
fn has_three_lines(path: &Path) -> Result<bool, ScanError> {
    let unread = |error: std::io::Error| ScanError::file("read", path, &error);
    let file = File::open(path).map_err(unread)?;
    let mut lines = BufReader::new(file.take(1 << 16));
    let mut line = Vec::new();
    loop {
        line.clear();
        let read = lines.read_until(b'\n', &mut line).map_err(unread)?;
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_start_matches('\u{FEFF}').trim();
        if read == 0 || !(text.is_empty() || text.starts_with('#')) {
            return Ok(three_lines::begins(text));
        }
    }
}

/// Who the profiles of a file are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ProfileStamps {
    /// In the order of the file.
    pub stamps: Vec<Stamp>,
    /// Frames whose profile is missing in its group.
    pub left_out: Vec<u64>,
}

impl ProfileStamps {
    /// What was left out, in words.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        const MOST: usize = 12;
        let first: Vec<String> = self
            .left_out
            .iter()
            .take(MOST)
            .map(u64::to_string)
            .collect();
        let more = if self.left_out.len() > MOST {
            ", …"
        } else {
            ""
        };
        (!first.is_empty()).then(|| {
            format!(
                "profile_lost: {} frames are left out ({}{more}): profiles of their groups were lost on the way, and \
                 nothing says whose",
                self.left_out.len(),
                first.join(", ")
            )
        })
    }
}

/// Who the profiles of a file are.
///
/// # Errors
/// As [`visit`].
pub fn stamps(path: &Path) -> Result<ProfileStamps, ScanError> {
    let mut stamps = Vec::new();
    let left_out = visit(path, Depth::Stamps, |profile| {
        stamps.push(profile.stamp);
        Ok(())
    })?;
    Ok(ProfileStamps { stamps, left_out })
}
