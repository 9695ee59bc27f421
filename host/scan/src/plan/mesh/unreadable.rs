//! How a mesh file that breaks its own format is refused.

use crate::ScanError;

/// A refusal of a file that breaks its own format.
pub(super) fn unreadable(why: impl std::fmt::Display) -> ScanError {
    ScanError::refused(
        "mesh_unreadable",
        format_args!("The file breaks off or breaks its format: {why}. Export it anew."),
    )
}
