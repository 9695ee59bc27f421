//! STEP files are refused so far.

use super::RawMesh;
use crate::ScanError;

/// Refuses: surfaces and their trimming are not read.
pub(super) fn read(_bytes: &[u8]) -> Result<RawMesh, ScanError> {
    Err(ScanError::refused(
        "mesh_format",
        "STEP surfaces are not read. Export the part as STL, OBJ or PLY with a chord of 0.01 mm.",
    ))
}
