//! Clouds in files.
//!
//! * [`read`]: all points at once, or one after the other in constant memory.
//! * [`mod@write`]: by the file's extension: `.csv`, `.ply`, `.pcd`, `.las`, `.laz`, `.e57`, `.parquet`.
//!
//! Coordinates are in mm; E57 has metres, because its standard says so. A file appears under its name only when it is
//! complete.

pub mod read;
#[cfg(test)]
mod tests;
pub mod write;

pub use read::{CloudReader, cloud_from_bytes, read_cloud};
pub use write::{CloudStyle, write_cloud, write_ply};

/// Who wrote a LAS or LAZ file, as its header says it. In files of others a synthetic point may be anything that no sensor
/// placed; in ours it was placed between latches.
pub(crate) const LAS_SOFTWARE: &str = "openumi";
