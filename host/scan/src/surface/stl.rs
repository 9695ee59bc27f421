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
    let bytes = whole_file(path).map_err(|error| named(&format!("cannot be read: {error}")))?;
    stl_from_bytes(&bytes).map_err(|refusal| ScanError {
        message: format!("{}: {}", path.display(), refusal.message),
        ..refusal
    })
}

/// All bytes of a file. A device never ends, so it is none.
pub(crate) fn whole_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = std::fs::File::open(path)?;
    #[cfg(unix)]
    if std::os::unix::fs::FileTypeExt::is_char_device(&file.metadata()?.file_type()) {
        return Err(std::io::Error::other("it is a device, and no file"));
    }
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut file, &mut bytes)?;
    Ok(bytes)
}

/// Whether a file that begins so and has so many bytes is an STL file, whole or cut: its size is what its header states,
/// or it begins as a text or as the header that many programs write.
pub(crate) fn is_stl(begin: &[u8], bytes: u64) -> bool {
    let ends_word = |b: &u8| b.is_ascii_whitespace() || *b == 0;
    let solid = begins_as_text(begin) && after_mark(begin).get(5).is_none_or(ends_word);
    solid || is_binary(begin, bytes)
}

/// What stands behind blanks and a byte order mark, with which some editors begin a text.
fn after_mark(bytes: &[u8]) -> &[u8] {
    let bytes = bytes.trim_ascii_start();
    bytes
        .strip_prefix(b"\xEF\xBB\xBF")
        .unwrap_or(bytes)
        .trim_ascii_start()
}

/// Does a line begin with a word, in small letters or large?
fn begins_with(line: &[u8], word: &[u8]) -> bool {
    line.get(..word.len())
        .is_some_and(|begin| begin.eq_ignore_ascii_case(word))
}

/// Does a file begin as a text STL file?
pub(crate) fn begins_as_text(bytes: &[u8]) -> bool {
    begins_with(after_mark(bytes), b"solid")
}

/// Whether the file is as large as a binary header states. Some programs write a few bytes behind the last triangle; as
/// many as a triangle has are a triangle too many.
fn is_binary(begin: &[u8], bytes: u64) -> bool {
    let stated = begin.get(80..HEADER).and_then(|b| b.try_into().ok());
    let stated = stated.map(|b| u64::from(u32::from_le_bytes(b)));
    stated.is_some_and(|n| {
        let behind = bytes.checked_sub(HEADER as u64 + n * RECORD as u64);
        behind == Some(0) || (n > 0 && behind.is_some_and(|b| b < RECORD as u64))
    })
}

/// The model in the bytes of an STL file. Which of the two kinds it is, its size says: binary files begin with `solid` too.
///
/// # Errors
/// As [`read_stl`].
pub fn stl_from_bytes(bytes: &[u8]) -> Result<Mesh, ScanError> {
    outward(Mesh::new(&stl_triangles(bytes)?)?)
}

/// The corners of all triangles in the bytes of an STL file, whatever they are.
///
/// # Errors
/// `bad_file` as [`read_stl`].
pub(crate) fn stl_triangles(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, ScanError> {
    let stated = bytes
        .get(80..HEADER)
        .and_then(|b| b.try_into().ok())
        .map(|b| u32::from_le_bytes(b) as usize);
    let there = bytes.len().saturating_sub(HEADER) / RECORD;
    // No text has a byte of 0, and no binary file is without.
    let is_text = begins_as_text(bytes) && !bytes.contains(&0);
    if is_binary(bytes, bytes.len() as u64) {
        Ok(binary(&bytes[HEADER..]))
    } else if is_text {
        text(after_mark(bytes))
    } else if bytes.starts_with(b"ply") {
        Err(ScanError::unreadable(
            "bad_file",
            "it is a PLY file, and a part is read from STL: were scan and part exchanged?",
        ))
    } else if let Some(stated) = stated {
        Err(ScanError::unreadable(
            "bad_file",
            format_args!(
                "the header states {stated} triangles, but the file's {} bytes hold {there}: it is cut short or no STL file",
                bytes.len()
            ),
        ))
    } else {
        Err(ScanError::unreadable(
            "bad_file",
            "it is cut short or no STL file: shorter than the header of a binary one",
        ))
    }
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
    // Of the last body's two lines the second, which a cut takes first.
    let ends = (bytes.split(|&b| b == b'\n').rev())
        .map(<[u8]>::trim_ascii_start)
        .find(|line| begins_with(line, b"solid") || begins_with(line, b"endsolid"));
    let cut = ScanError::unreadable(
        "bad_file",
        "it begins as a text STL file and its last body has no `endsolid`: it is cut short",
    );
    if !ends.is_some_and(|line| begins_with(line, b"endsolid")) {
        return Err(cut);
    }
    let mut corners: Vec<Vec3> = Vec::new();
    let mut triangles = Vec::new();
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let wrong =
            |what: &str| ScanError::unreadable("bad_file", format_args!("line {}: {what}", i + 1));
        let line = std::str::from_utf8(line).map_err(|_| wrong("it is not text"))?;
        let mut words = line.split_ascii_whitespace();
        let word = words.next().unwrap_or_default();
        match word.to_ascii_lowercase().as_str() {
            "vertex" => {
                let mut next = || {
                    words
                        .next()
                        .and_then(|word| word.parse::<f64>().ok())
                        .ok_or_else(|| wrong("`vertex` needs three numbers"))
                };
                // As a binary file has them: a model is the same in both.
                corners.push(Vec3::new(next()?, next()?, next()?).map(|x| f64::from(x as f32)));
            }
            "endfacet" => {
                let three: [Vec3; 3] = corners
                    .as_slice()
                    .try_into()
                    .map_err(|_| wrong("a facet needs three vertices"))?;
                triangles.push(three);
                corners.clear();
            }
            _ => {}
        }
    }
    if corners.is_empty() {
        Ok(triangles)
    } else {
        Err(cut)
    }
}
