//! Points to a file, by its extension.

mod counted;
#[cfg(feature = "cloud-formats")]
mod e57;
mod figures;
#[cfg(feature = "cloud-formats")]
mod las;
mod notes;
#[cfg(feature = "cloud-formats")]
mod parquet;
mod pcd;
mod ply;
mod records;
mod stl;
mod text;

use std::path::Path;

use crate::ScanError;
use crate::cloud::{CloudColumns, Points};
use crate::format::partial::Partial;
use counted::Counted;

#[cfg(feature = "cloud-formats")]
pub(crate) use e57::guid;
pub use figures::write_ply;
pub use notes::notes;
pub(crate) use ply::is_far;

/// How a cloud is written.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CloudStyle {
    /// What is written beside the coordinates.
    pub columns: CloudColumns,
    /// Coordinates of PLY and PCD as doubles instead of floats. PLY has them also where its first point lies beyond 2 m.
    pub double: bool,
    /// The longest edge of a mesh (STL), in mm; without, by the grid's own pitch.
    pub longest_mm: Option<f64>,
}

/// What a format does: points to the file under its partial name; how many there were.
type Write = fn(&Partial, CloudStyle, &mut Counted<'_>) -> Result<(), ScanError>;

/// The extensions that clouds are written under.
pub const EXTENSIONS: &str = if cfg!(feature = "cloud-formats") {
    ".csv, .ply, .pcd, .las, .laz, .e57, .parquet, or .stl for a grid"
} else {
    ".csv, .ply, .pcd, or .stl for a grid"
};

/// How a file is written, by its extension.
fn format_of(path: &Path) -> Result<Write, ScanError> {
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    Ok(match extension.as_str() {
        "csv" => text::write,
        "ply" => ply::write,
        "pcd" => pcd::write,
        "stl" => stl::write,
        #[cfg(feature = "cloud-formats")]
        "las" => |file, style, points| las::write(file, style, points, false),
        #[cfg(feature = "cloud-formats")]
        "laz" => |file, style, points| las::write(file, style, points, true),
        #[cfg(feature = "cloud-formats")]
        "e57" => e57::write,
        #[cfg(feature = "cloud-formats")]
        "parquet" => parquet::write,
        _ => {
            return Err(ScanError::unreadable(
                "format",
                format_args!(
                    "{}: clouds are written as {EXTENSIONS}, by the extension",
                    path.display()
                ),
            ));
        }
    })
}

/// Refuses an extension that no cloud is written under.
///
/// # Errors
/// `format`.
pub fn check_extension(path: &Path) -> Result<(), ScanError> {
    format_of(path).map(|_| ())
}

/// Whether the format has room for the points' uncertainty by the mount.
#[must_use]
pub fn holds_uncertainty(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        let is = |name: &str| extension.eq_ignore_ascii_case(name);
        ["csv", "ply", "pcd", "parquet"].into_iter().any(is)
    })
}

/// Whether the format has room for the mark of points that were placed between latches: LAS and LAZ call them synthetic.
#[must_use]
pub fn holds_interpolated(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        let is = |name: &str| extension.eq_ignore_ascii_case(name);
        holds_uncertainty(path) || is("las") || is("laz")
    })
}

/// What came of a cloud that was written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrittenCloud {
    /// How many points it has.
    pub points: u64,
    /// Their greatest coordinate, whichever its sign.
    pub farthest_mm: f64,
}

/// Writes all points; how many there were, and how far out.
///
/// # Errors
/// `format` for an unknown extension, `file`, or what the points themselves answer. Then no file is left.
pub fn write_cloud(
    path: &Path,
    style: CloudStyle,
    points: Points<'_>,
) -> Result<WrittenCloud, ScanError> {
    let write = format_of(path)?;
    let mut partial = Partial::new(path);
    let mut counted = Counted::new(points);
    write(&partial, style, &mut counted)?;
    partial.complete()?;
    Ok(WrittenCloud {
        points: counted.count,
        farthest_mm: counted.farthest_mm,
    })
}
