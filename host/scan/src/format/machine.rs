//! The machine file, from disk.

use std::path::Path;

use umi_kinematics::AxisChain;

use crate::ScanError;

/// Reads a machine file.
///
/// # Errors
/// The file cannot be read; code `machine` where it describes none.
pub fn read(path: &Path) -> Result<AxisChain, ScanError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    AxisChain::parse(&text).map_err(|error| {
        let mut error = ScanError::from(error);
        error.message = format!("{}: {}", path.display(), error.message);
        error
    })
}
