//! Points of a scan, and the files they come in.

mod ply;
mod table;
#[cfg(test)]
mod tests;
pub mod tree;
mod write;

use std::path::Path;

use crate::ScanError;
use crate::rigid::Vec3;

pub use write::write_ply;

/// The points of a scan, all finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScanCloud {
    /// The points in mm, in the order of the file.
    pub points: Vec<Vec3>,
    /// How many points of the file were not finite numbers; they are not among the points.
    pub not_finite: usize,
}

/// The points of a file: PLY by its first bytes, else numbers in columns (CSV). As they stand there: mm if the file is in mm.
///
/// # Errors
/// `bad_file` with what is wrong.
pub fn read_cloud(path: &Path) -> Result<ScanCloud, ScanError> {
    let bytes = std::fs::read(path).map_err(|error| {
        ScanError::unreadable(
            "bad_file",
            format_args!("{}: cannot be read: {error}", path.display()),
        )
    })?;
    cloud_from_bytes(&bytes).map_err(|refusal| ScanError {
        message: format!("{}: {}", path.display(), refusal.message),
        ..refusal
    })
}

/// The points in the bytes of a file, as [`read_cloud`] reads them.
///
/// # Errors
/// `bad_file` with what is wrong.
pub fn cloud_from_bytes(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    if bytes.starts_with(b"ply") {
        ply::read(bytes)
    } else {
        table::read(bytes)
    }
}

impl ScanCloud {
    fn push(&mut self, point: Vec3) {
        if point.iter().all(|x| x.is_finite()) {
            self.points.push(point);
        } else {
            self.not_finite += 1;
        }
    }

    /// Every coordinate times `factor`: a file in inches becomes mm by 25.4.
    pub fn scale(&mut self, factor: f64) {
        for p in &mut self.points {
            *p *= factor;
        }
    }
}
