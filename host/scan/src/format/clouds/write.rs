//! Points to a file, by its extension.

use std::path::Path;

use super::counted::Counted;
use super::{CloudStyle, Points};
use crate::ScanError;
use crate::format::partial::Partial;

/// What a format does: points to the file under its partial name; how many there were.
type Write = fn(&Partial, CloudStyle, &mut Counted<'_>) -> Result<(), ScanError>;

/// The extensions that clouds are written under.
pub const EXTENSIONS: &str = if cfg!(feature = "cloud-formats") {
    ".csv, .ply, .pcd, .las, .laz, .e57 or .parquet"
} else {
    ".csv, .ply or .pcd"
};

/// How a file is written, by its extension.
fn format_of(path: &Path) -> Result<Write, ScanError> {
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    Ok(match extension.as_str() {
        "csv" => super::text::write,
        "ply" => super::ply::write,
        "pcd" => super::pcd::write,
        #[cfg(feature = "cloud-formats")]
        "las" => |file, style, points| super::las::write(file, style, points, false),
        #[cfg(feature = "cloud-formats")]
        "laz" => |file, style, points| super::las::write(file, style, points, true),
        #[cfg(feature = "cloud-formats")]
        "e57" => super::e57::write,
        #[cfg(feature = "cloud-formats")]
        "parquet" => super::parquet::write,
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

/// Writes all points; how many there were.
///
/// # Errors
/// `format` for an unknown extension, `file`, or what the points themselves answer. Then no file is left.
pub fn write_cloud(path: &Path, style: CloudStyle, points: Points<'_>) -> Result<u64, ScanError> {
    let write = format_of(path)?;
    let mut partial = Partial::new(path);
    let mut counted = Counted::new(points);
    write(&partial, style, &mut counted)?;
    partial.complete()?;
    Ok(counted.count)
}
