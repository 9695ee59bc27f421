//! OBJ: vertices and faces; all else (normals, textures, materials, groups) says nothing about the shape.

use std::borrow::Cow;

use nalgebra::Vector3;

use super::RawMesh;
use super::polygon::Polygons;
use super::unreadable::unreadable;
use crate::ScanError;

/// A line without its comment; one that ends with a backslash goes on in the next.
fn whole<'a>(line: &'a str, mut next: impl FnMut() -> Option<&'a str>) -> Cow<'a, str> {
    let bare = |line: &'a str| line.split('#').next().unwrap_or_default().trim_end();
    let mut line = Cow::from(bare(line));
    while line.ends_with('\\') {
        let all = line.to_mut();
        all.pop();
        all.push(' ');
        all.push_str(next().map(bare).unwrap_or_default());
    }
    line
}

/// Reads the text; polygons become triangles.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let text =
        std::str::from_utf8(bytes).map_err(|_| unreadable("an OBJ file is text, this is none"))?;
    let mut raw = RawMesh::default();
    let mut polygons = Polygons::default();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let line = whole(line, || lines.next().map(|(_, line)| line));
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

#[cfg(test)]
mod tests {
    use super::read;

    #[test]
    fn comments_and_lines_that_go_on_are_read() {
        let plain = read(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
        let other = b"v 0 0 0 # first\nv 1 0 0\nv 1 \\\n1 0\nv 0 1 0\n# f 1 2 9\nf 1 2 \\ \n 3\\\n 4 # all\nf 1 2 3\\";
        let other = read(other).unwrap();
        assert_eq!(plain.vertices, other.vertices);
        // Triangles stand before what is cut into them.
        assert_eq!(other.faces, [&[[0, 1, 2]][..], &plain.faces].concat());
    }
}
