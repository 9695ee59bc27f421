//! PLY meshes: text and binary of either byte order, scalars of any kind, polygons of any count.

use nalgebra::Vector3;

use super::RawMesh;
use super::polygon::Polygons;
use super::unreadable::unreadable;
use crate::ScanError;
use crate::format::ply::{Encoding, Header, Scalar};

/// What follows the header, value by value.
struct Body<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
}

impl Body<'_> {
    fn next(&mut self, kind: Scalar) -> Result<f64, ScanError> {
        if self.encoding == Encoding::Text {
            let text = self.bytes.trim_ascii_start();
            let end = text.iter().position(u8::is_ascii_whitespace);
            let (word, rest) = text.split_at(end.unwrap_or(text.len()));
            self.bytes = rest;
            return std::str::from_utf8(word)
                .ok()
                .and_then(|word| word.parse().ok())
                .ok_or_else(|| unreadable("a number is missing or is none"));
        }
        let Some((value, rest)) = self.bytes.split_at_checked(kind.size()) else {
            return Err(unreadable("the file ends before its elements do"));
        };
        self.bytes = rest;
        Ok(kind.read(value, self.encoding))
    }
}

/// Reads vertices and faces, skipping every other element and property.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let mut rest = bytes;
    let header = Header::read(&mut rest).map_err(unreadable)?;
    let mut body = Body {
        bytes: rest,
        encoding: header.encoding,
    };
    let mut raw = RawMesh::default();
    let mut polygons = Polygons::default();
    for element in &header.elements {
        if element.properties.is_empty() {
            continue;
        }
        for _ in 0..element.count {
            let mut place = Vector3::repeat(f64::NAN);
            for property in &element.properties {
                let Some(count) = property.count else {
                    let value = body.next(property.value)?;
                    match property.name.as_str() {
                        "x" => place.x = value,
                        "y" => place.y = value,
                        "z" => place.z = value,
                        _ => {}
                    }
                    continue;
                };
                let count = body.next(count)?;
                // A count beyond what a polygon has is a damaged file; reading on would take memory without end.
                if !(0.0..=1e6).contains(&count) {
                    return Err(unreadable("a list has no sensible count"));
                }
                let mut corners = Vec::new();
                for _ in 0..count as usize {
                    let value = body.next(property.value)?;
                    if value < 0.0 || value.fract() != 0.0 || value > 4e9 {
                        corners.push(usize::MAX);
                    } else {
                        corners.push(value as usize);
                    }
                }
                if element.name == "face"
                    && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
                {
                    if corners.len() < 3 {
                        return Err(unreadable("a face needs three corners at least"));
                    }
                    polygons.add(&mut raw, corners);
                }
            }
            if element.name == "vertex" {
                raw.vertices.push(place);
            }
        }
    }
    polygons.cut(&mut raw)?;
    Ok(raw)
}
