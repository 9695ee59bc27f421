//! Clouds point by point, in constant memory: what the tools for clouds read and write.
//!
//! In: CSV with named columns, PLY (text and binary). Out, by the file's extension: `.csv`, `.ply`, `.pcd`, `.las`,
//! `.laz`, `.e57`, `.parquet`. Coordinates are in mm; E57 has metres, because its standard says so. A file appears under
//! its name only when it is complete.
//!
//! * [`read`]: [`CloudReader`]; [`mod@write`]: by the extension.

mod counted;
#[cfg(feature = "cloud-formats")]
mod e57;
#[cfg(feature = "cloud-formats")]
mod las;
#[cfg(feature = "cloud-formats")]
mod parquet;
mod pcd;
mod ply;
pub mod read;
mod records;
#[cfg(test)]
mod tests;
mod text;
pub mod write;

pub use read::CloudReader;
pub use write::write_cloud;

/// A point of a cloud with what its file says of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// x, y, z in mm.
    pub at: [f64; 3],
    /// The profile it is of; 0 where the cloud does not say.
    pub profile: u64,
    /// Its place in the sensor's array; 0 where the cloud does not say.
    pub index: u32,
    /// How bright it was, in the sensor's own measure; 0 where the cloud does not say.
    pub intensity: f64,
}

/// What a cloud says of its points beside their coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CloudColumns {
    /// Their profiles.
    pub profile: bool,
    /// Their places in the profiles.
    pub index: bool,
    /// Their intensity.
    pub intensity: bool,
}

/// How a cloud is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CloudStyle {
    /// What is written beside the coordinates.
    pub columns: CloudColumns,
    /// Coordinates of PLY and PCD as doubles instead of floats.
    pub double: bool,
}

/// Points one after the other, all finite.
pub type Points<'a> = Box<dyn Iterator<Item = Result<CloudPoint, crate::ScanError>> + 'a>;
