//! A mesh file by its extension.

use std::path::Path;

use super::unreadable::unreadable;
use super::{PartMesh, RawMesh, obj, ply, step, weld};
use crate::ScanError;
use crate::surface::{Mesh, begins_as_text, stl_from_bytes};

/// Before the border of a STEP face: its triangles lie off the surface by up to a quarter of this.
const STEP_INSET_MM: f64 = 0.02;

/// Reads the part: STL, OBJ, PLY or STEP.
///
/// # Errors
/// A missing file is `file` (status 1); all else is refused as `mesh_format`, `mesh_unreadable`, `mesh_empty`,
/// `mesh_not_finite`, `mesh_degenerate`, `mesh_not_manifold`, `mesh_not_oriented` or `mesh_scale`.
pub fn read_part(path: &Path) -> Result<PartMesh, ScanError> {
    let mut part = PartMesh::weld(raw(path)?, true).map_err(|e| named(e, path))?;
    if !is_mesh(&extension(path)) {
        part.inset_mm = STEP_INSET_MM;
    }
    Ok(part)
}

/// Reads what stands beside the part: only its triangles count, not how they hang together.
///
/// # Errors
/// As [`read_part`], without those of topology.
pub fn read_obstacle(path: &Path) -> Result<Mesh, ScanError> {
    let part = PartMesh::weld(raw(path)?, false).map_err(|e| named(e, path))?;
    Ok(part.surface)
}

fn named(mut error: ScanError, path: &Path) -> ScanError {
    error.message = format!("{}: {}", path.display(), error.message);
    error
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}

fn is_mesh(extension: &str) -> bool {
    ["stl", "obj", "ply"].contains(&extension)
}

fn raw(path: &Path) -> Result<RawMesh, ScanError> {
    let extension = extension(path);
    if !is_mesh(&extension) && !["step", "stp"].contains(&extension.as_str()) {
        // A missing file is a missing file, whatever its name.
        std::fs::metadata(path).map_err(|e| ScanError::file("read", path, &e))?;
        return Err(ScanError::refused(
            "mesh_format",
            format_args!(
                "{}: a mesh in STL, OBJ, PLY or STEP is needed, by its extension.",
                path.display()
            ),
        ));
    }
    let bytes = std::fs::read(path).map_err(|e| ScanError::file("read", path, &e))?;
    from_bytes(&extension, &bytes).map_err(|e| named(e, path))
}

/// The part in the bytes of a file, as [`read_part`] reads it, of this extension in small letters.
///
/// # Errors
/// As [`read_part`].
pub fn part_from_bytes(extension: &str, bytes: &[u8]) -> Result<PartMesh, ScanError> {
    PartMesh::weld(from_bytes(extension, bytes)?, true)
}

/// The triangles in a file's bytes.
pub(in crate::plan) fn from_bytes(extension: &str, bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let raw = match extension {
        "stl" => stl(bytes)?,
        "obj" => obj::read(bytes)?,
        "ply" => ply::read(bytes)?,
        _ => step::read(bytes)?,
    };
    if raw.faces.is_empty() {
        return Err(ScanError::refused(
            "mesh_empty",
            "The file has no triangles.",
        ));
    }
    weld::check_finite(&raw)?;
    Ok(raw)
}

fn stl(bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let mesh = stl_from_bytes(bytes).map_err(|refusal| match refusal.code {
        "not_finite" => ScanError::refused("mesh_not_finite", refusal.message),
        // No triangle has an area; whether there is any triangle at all decides the name.
        "empty_model" => {
            let binary_none = bytes.get(80..84) == Some(&[0; 4]) && bytes.len() == 84;
            let vertex = |w: &[u8]| w.eq_ignore_ascii_case(b"vertex");
            let text_none = begins_as_text(bytes) && !bytes.windows(6).any(vertex);
            if binary_none || text_none {
                ScanError::refused("mesh_empty", "The file has no triangles.")
            } else {
                ScanError::refused("mesh_degenerate", "No triangle of the file has an area.")
            }
        }
        _ => unreadable(refusal.message),
    })?;
    let mut raw = RawMesh::default();
    for t in mesh.triangles() {
        let first = raw.vertices.len();
        raw.vertices.extend(t.corners);
        raw.faces.push([first, first + 1, first + 2]);
    }
    Ok(raw)
}
