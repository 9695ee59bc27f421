//! Polygons of more than three corners, cut as fans of triangles.

use std::ops::Range;

use super::RawMesh;
use super::unreadable::unreadable;
use crate::ScanError;

/// The fans of a mesh that is being read, as ranges of its faces.
#[derive(Debug, Default)]
pub(super) struct Fans(Vec<Range<usize>>);

impl Fans {
    /// Cuts a polygon from its first corner.
    pub fn cut(&mut self, raw: &mut RawMesh, corners: &[usize]) {
        let first = raw.faces.len();
        if let [tip, rest @ ..] = corners {
            let pairs = rest.windows(2);
            raw.faces.extend(pairs.map(|pair| [*tip, pair[0], pair[1]]));
        }
        if raw.faces.len() > first + 1 {
            self.0.push(first..raw.faces.len());
        }
    }

    /// Whether every face names vertices that are there, and every fan is its polygon: where a corner turns inwards
    /// or sides cross, a triangle of the fan lies the other way round, beyond the polygon.
    ///
    /// # Errors
    /// `mesh_unreadable`.
    pub fn check(&self, raw: &RawMesh) -> Result<(), ScanError> {
        if raw.faces.iter().flatten().any(|&i| i >= raw.vertices.len()) {
            return Err(unreadable("a face names a vertex that is not there"));
        }
        for fan in &self.0 {
            let faces = &raw.faces[fan.clone()];
            let area = |&[a, b, c]: &[usize; 3]| {
                let [a, b, c] = [a, b, c].map(|i| raw.vertices[i]);
                (b - a).cross(&(c - a))
            };
            let whole = faces.iter().map(area).sum::<nalgebra::Vector3<f64>>();
            // What lies straight has no area, but for rounding.
            if faces
                .iter()
                .any(|face| area(face).dot(&whole) < -1e-9 * whole.norm_squared())
            {
                return Err(unreadable(
                    "a face of more than three corners has one that turns inwards, or sides that cross: cut \
                     such faces into triangles",
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{obj, ply};

    const DART: &str = "v 0 0 0\nv 10 0 0\nv 2 2 0\nv 0 10 0\n";

    /// From the corner that turns inwards a dart's fan is right; from another one it covers what is beside it.
    #[test]
    fn a_fan_beyond_its_polygon_is_refused() {
        let read = |faces: &str| obj::read(format!("{DART}{faces}").as_bytes());
        assert_eq!(read("f 3 4 1 2\n").unwrap().faces.len(), 2);
        assert_eq!(read("f 1 2 3 4\n").unwrap().faces.len(), 2);
        for bad in ["f 2 3 4 1\n", "f 4 1 2 3\n", "f 1 2 4 3\n"] {
            assert_eq!(read(bad).unwrap_err().code, "mesh_unreadable", "{bad}");
        }
        let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_indices\nend_header\n\
                   0 0 0\n10 0 0\n2 2 0\n0 10 0\n4 1 2 3 0\n";
        assert_eq!(
            ply::read(ply.as_bytes()).unwrap_err().code,
            "mesh_unreadable"
        );
        // A flat square, and one whose corners do not lie in a plane.
        for z in ["0", "1"] {
            let text = format!("v 0 0 0\nv 10 0 0\nv 10 10 {z}\nv 0 10 0\nf 1 2 3 4\n");
            assert_eq!(obj::read(text.as_bytes()).unwrap().faces.len(), 2);
        }
    }
}
