//! STL files, binary and text.

use std::path::Path;

use super::mesh::Mesh;
use super::outward::outward;
use crate::ScanError;
use crate::rigid::Vec3;

const HEADER: usize = 84;
const RECORD: usize = 50;

/// The model of an STL file, in mm. The triangles of a closed surface look outwards, whichever way the file has them.
///
/// # Errors
/// `bad_file` if the file cannot be read as STL, `empty_model` and `not_finite` as [`Mesh::new`].
pub fn read_stl(path: &Path) -> Result<Mesh, ScanError> {
    let named = |message: &str| {
        ScanError::unreadable("bad_file", format_args!("{}: {message}", path.display()))
    };
    let bytes = std::fs::read(path).map_err(|error| named(&format!("cannot be read: {error}")))?;
    stl_from_bytes(&bytes).map_err(|refusal| ScanError {
        message: format!("{}: {}", path.display(), refusal.message),
        ..refusal
    })
}

/// Whether these are the bytes of an STL file, whole or cut: its size is what its header states, or its text begins as one.
pub(crate) fn is_stl(bytes: &[u8]) -> bool {
    let text = bytes.trim_ascii_start();
    let solid = text.starts_with(b"solid")
        && text.get(5).is_none_or(u8::is_ascii_whitespace)
        && std::str::from_utf8(text).is_ok();
    solid || is_binary(bytes)
}

/// Whether the file is as large as a binary header states. Some programs write a few bytes behind the last triangle; as
/// many as a triangle has are a triangle too many.
fn is_binary(bytes: &[u8]) -> bool {
    let stated = bytes.get(80..HEADER).and_then(|b| b.try_into().ok());
    let stated = stated.map(|b| u32::from_le_bytes(b) as usize);
    stated.is_some_and(|n| {
        let behind = n
            .checked_mul(RECORD)
            .and_then(|size| (bytes.len() - HEADER).checked_sub(size));
        behind == Some(0) || (n > 0 && behind.is_some_and(|b| b < RECORD))
    })
}

/// The model in the bytes of an STL file. Which of the two kinds it is, its size says: binary files begin with `solid` too.
///
/// # Errors
/// As [`read_stl`].
pub fn stl_from_bytes(bytes: &[u8]) -> Result<Mesh, ScanError> {
    let stated = bytes
        .get(80..HEADER)
        .and_then(|b| b.try_into().ok())
        .map(|b| u32::from_le_bytes(b) as usize);
    let there = bytes.len().saturating_sub(HEADER) / RECORD;
    let corners = if is_binary(bytes) {
        binary(&bytes[HEADER..])
    } else if bytes.trim_ascii_start().starts_with(b"solid") {
        text(bytes)?
    } else if let Some(stated) = stated {
        return Err(ScanError::unreadable(
            "bad_file",
            format_args!(
                "the header states {stated} triangles, but the file's {} bytes hold {there}: it is cut short or no STL file",
                bytes.len()
            ),
        ));
    } else {
        return Err(ScanError::unreadable(
            "bad_file",
            "it is no STL file: shorter than a header, and it does not begin with `solid`",
        ));
    };
    outward(Mesh::new(&corners)?)
}

fn binary(records: &[u8]) -> Vec<[Vec3; 3]> {
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let corner = |b: &[u8]| Vec3::new(number(&b[0..4]), number(&b[4..8]), number(&b[8..12]));
    records
        .chunks_exact(RECORD)
        .map(|r| [corner(&r[12..24]), corner(&r[24..36]), corner(&r[36..48])])
        .collect()
}

fn text(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, ScanError> {
    let mut corners: Vec<Vec3> = Vec::new();
    let mut triangles = Vec::new();
    let mut ended = false;
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let wrong =
            |what: &str| ScanError::unreadable("bad_file", format_args!("line {}: {what}", i + 1));
        let line = std::str::from_utf8(line).map_err(|_| wrong("it is not text"))?;
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("vertex") => {
                let mut next = || {
                    words
                        .next()
                        .and_then(|word| word.parse::<f64>().ok())
                        .ok_or_else(|| wrong("`vertex` needs three numbers"))
                };
                // As a binary file has them: a model is the same in both.
                corners.push(Vec3::new(next()?, next()?, next()?).map(|x| f64::from(x as f32)));
            }
            Some("endfacet") => {
                let three: [Vec3; 3] = corners
                    .as_slice()
                    .try_into()
                    .map_err(|_| wrong("a facet needs three vertices"))?;
                triangles.push(three);
                corners.clear();
            }
            Some("endsolid") => ended = true,
            _ => {}
        }
    }
    if ended && corners.is_empty() {
        Ok(triangles)
    } else {
        Err(ScanError::unreadable(
            "bad_file",
            "it begins as a text STL file and has no `endsolid`: it is cut short",
        ))
    }
}
