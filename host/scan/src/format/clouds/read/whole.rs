//! A cloud read at once, by its first bytes.

use std::path::Path;

use super::{las, pcd, ply, table};
use crate::ScanError;
use crate::cloud::ScanCloud;
use crate::surface::{Mesh, stl_triangles, whole_file};

/// The points of a file: PLY, PCD, LAS, LAZ, E57 or STL (the corners of its triangles, each once) by its first bytes, else
/// numbers in columns (CSV). As they stand there: mm if the file is in mm. An E57 file has metres, which become mm.
///
/// # Errors
/// `bad_file` with what is wrong.
pub fn read_cloud(path: &Path) -> Result<ScanCloud, ScanError> {
    let bytes = whole_file(path).map_err(|error| {
        ScanError::unreadable(
            "bad_file",
            format_args!("{}: cannot be read: {error}", path.display()),
        )
    })?;
    let cloud = cloud_from_bytes(&bytes).map_err(|refusal| {
        // An STL file that is cut looks like none.
        let of_its_name = is_named_stl(path).then(|| crate::surface::stl_from_bytes(&bytes));
        of_its_name.and_then(Result::err).map_or(refusal, of_stl)
    });
    cloud.map_err(|refusal| ScanError {
        message: format!("{}: {}", path.display(), refusal.message),
        ..refusal
    })
}

/// The points in the bytes of a file, as [`read_cloud`] reads them.
///
/// # Errors
/// `bad_file` with what is wrong.
pub fn cloud_from_bytes(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    if bytes.starts_with(b"PAR1") {
        Err(ScanError::unreadable(
            "bad_file",
            "it is a Parquet file, which is written and not read: give the cloud as PLY, E57 or CSV (in DuckDB: \
             COPY (FROM 'cloud.parquet') TO 'cloud.csv')",
        ))
    } else if bytes.starts_with(b"ply") {
        ply::read(bytes)
    } else if bytes.starts_with(b"LASF") {
        las::read(bytes)
    } else if bytes.starts_with(b"ASTM-E57") {
        #[cfg(feature = "cloud-formats")]
        return super::e57::read(bytes);
        #[cfg(not(feature = "cloud-formats"))]
        return Err(ScanError::unreadable(
            "bad_file",
            "it is an E57 file, which this build does not read: write it as PLY, PCD or LAS",
        ));
    } else if pcd::is_pcd(bytes) {
        pcd::read(bytes)
    } else if crate::surface::is_stl(bytes, bytes.len() as u64) {
        corners(&stl_triangles(bytes)?).map_err(of_stl)
    } else {
        table::read(bytes)
    }
}

/// Whether the first bytes are those of a format that has no reader point by point: PCD, LAS, LAZ, E57, STL; or of Parquet,
/// which has none at all.
pub(super) fn is_whole(begin: &[u8], bytes: u64) -> bool {
    begin.starts_with(b"LASF")
        || begin.starts_with(b"PAR1")
        || crate::surface::is_stl(begin, bytes)
        || begin.starts_with(b"ASTM-E57")
        || pcd::is_pcd(begin)
}

/// Whether a file calls itself STL.
pub(super) fn is_named_stl(path: &Path) -> bool {
    let extension = path.extension();
    extension.is_some_and(|extension| extension.eq_ignore_ascii_case("stl"))
}

/// Why an STL file is no scan.
fn of_stl(refusal: ScanError) -> ScanError {
    if refusal.code != "empty_model" {
        return refusal;
    }
    ScanError::unreadable(
        "bad_file",
        "no triangle of this STL file has an area, and a scan in STL is the corners of its triangles: give points as PLY or CSV",
    )
}

/// The corners of triangles, each once, in their order; behind them those that are not finite, which whoever takes the points
/// drops and counts.
fn corners(triangles: &[[crate::rigid::Vec3; 3]]) -> Result<ScanCloud, ScanError> {
    let is_finite = |t: &&[crate::rigid::Vec3; 3]| t.iter().flatten().all(|x| x.is_finite());
    let finite: Vec<_> = triangles.iter().filter(is_finite).copied().collect();
    let mut known = std::collections::HashSet::new();
    let mut cloud = ScanCloud::default();
    let mesh = Mesh::new(&finite)?;
    let others = triangles
        .iter()
        .filter(|t| !is_finite(t))
        .flatten()
        .copied();
    for corner in mesh
        .triangles()
        .iter()
        .flat_map(|t| t.corners)
        .chain(others)
    {
        // Zero has two signs.
        if known.insert([corner.x, corner.y, corner.z].map(|x| (x + 0.0).to_bits())) {
            cloud.push(corner);
        }
    }
    Ok(cloud)
}
