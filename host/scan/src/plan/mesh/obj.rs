//! OBJ: vertices and faces; all else (normals, textures, materials, groups) says nothing about the shape.

use nalgebra::Vector3;

use super::RawMesh;
use super::polygon::Polygons;
use super::unreadable::unreadable;
use crate::ScanError;

/// Reads the text; polygons become triangles.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let text =
        std::str::from_utf8(bytes).map_err(|_| unreadable("an OBJ file is text, this is none"))?;
    let mut raw = RawMesh::default();
    let mut polygons = Polygons::default();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        let wrong = |what: &str| unreadable(format_args!("line {}: {what}", number + 1));
        match words.next() {
            Some("v") => {
                let mut next = || {
                    words
                        .next()
                        .and_then(|w| w.parse::<f64>().ok())
                        .ok_or_else(|| wrong("a vertex needs three numbers"))
                };
                raw.vertices.push(Vector3::new(next()?, next()?, next()?));
            }
            Some("f") => {
                let mut corners = Vec::with_capacity(4);
                for word in words {
                    let index: i64 = word
                        .split('/')
                        .next()
                        .and_then(|w| w.parse().ok())
                        .ok_or_else(|| wrong("a face needs vertex numbers"))?;
                    // Counted from 1, or backwards from the last vertex so far.
                    let place = if index > 0 {
                        usize::try_from(index - 1).ok()
                    } else {
                        usize::try_from(-index).ok().and_then(|back| {
                            (back > 0)
                                .then(|| raw.vertices.len().checked_sub(back))
                                .flatten()
                        })
                    };
                    corners.push(
                        place.ok_or_else(|| wrong("a face names a vertex that is not there"))?,
                    );
                }
                if corners.len() < 3 {
                    return Err(wrong("a face needs three corners at least"));
                }
                polygons.add(&mut raw, corners);
            }
            _ => {}
        }
    }
    polygons.cut(&mut raw)?;
    Ok(raw)
}
