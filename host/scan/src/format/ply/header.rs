//! What a PLY file says that it holds.

use std::io::{BufRead, Read};

use super::{Encoding, Scalar};

/// Lines of a header at most, and bytes of a line: a file that is no PLY is not searched to its end.
const LINES: usize = 10_000;
const LONGEST_LINE: u64 = 1 << 16;

/// The header of a file.
#[derive(Debug)]
pub(crate) struct Header {
    pub encoding: Encoding,
    /// In the order in which they follow.
    pub elements: Vec<Element>,
}

/// Things of one kind that follow: vertices, faces.
#[derive(Debug)]
pub(crate) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

/// What is said of each of them.
#[derive(Debug)]
pub(crate) struct Property {
    pub name: String,
    /// Type of the count, where it is a list.
    pub count: Option<Scalar>,
    pub value: Scalar,
}

impl Element {
    /// Bytes of one, if no property is a list.
    pub fn stride(&self) -> Option<usize> {
        let size = |p: &Property| p.count.is_none().then(|| p.value.size());
        self.properties.iter().map(size).sum()
    }
}

impl Header {
    /// Reads a header to its end; the input stands behind it then.
    ///
    /// # Errors
    /// What is wrong, for a sentence of the caller.
    pub fn read(input: &mut impl BufRead) -> Result<Self, String> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut bytes = Vec::new();
        for number in 1..=LINES {
            bytes.clear();
            Read::take(&mut *input, LONGEST_LINE)
                .read_until(b'\n', &mut bytes)
                .map_err(|error| error.to_string())?;
            let ends = bytes.last() == Some(&b'\n');
            // Comments may be in any character set.
            let line = String::from_utf8_lossy(&bytes);
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let wrong = |what: &str| format!("line {number} of its header: {what}");
            let scalar = |name: &str| {
                Scalar::named(name).ok_or_else(|| wrong("a type that PLY does not have"))
            };
            match words.as_slice() {
                // A file may end with its header.
                ["end_header"] => {
                    let encoding = encoding.ok_or_else(|| wrong("no `format` before it"))?;
                    return Ok(Self { encoding, elements });
                }
                _ if !ends => break,
                ["ply"] | [] | ["comment" | "obj_info", ..] => {}
                ["format", kind, ..] => {
                    encoding = Some(match *kind {
                        "ascii" => Encoding::Text,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(wrong("a format that PLY does not have")),
                    });
                }
                ["element", name, count] => elements.push(Element {
                    name: (*name).to_owned(),
                    count: count
                        .parse()
                        .map_err(|_| wrong("the count is no whole number"))?,
                    properties: Vec::new(),
                }),
                ["property", kind @ .., name] if matches!(kind.len(), 1 | 3) => {
                    let (count, value) = match kind {
                        ["list", count, value] => (Some(scalar(count)?), scalar(value)?),
                        [value] => (None, scalar(value)?),
                        _ => return Err(wrong("a type that PLY does not have")),
                    };
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| wrong("a property of no element"))?;
                    if element.properties.iter().any(|known| known.name == *name) {
                        return Err(wrong(&format!("a second property `{name}`")));
                    }
                    element.properties.push(Property {
                        name: (*name).to_owned(),
                        count,
                        value,
                    });
                }
                _ => return Err(wrong(&format!("`{}` is not understood", line.trim()))),
            }
        }
        Err("its header has no end (`end_header`)".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_says_what_follows_and_ends_where_the_numbers_begin() {
        let mut bytes: &[u8] = b"ply\r\nformat binary_big_endian 1.0\r\ncomment \xe4\nelement vertex 2\nproperty float x\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\x01";
        let header = Header::read(&mut bytes).unwrap();
        assert_eq!(header.encoding, Encoding::BigEndian);
        assert_eq!(bytes, [1]);
        let [vertex, face] = header.elements.as_slice() else {
            panic!("two elements");
        };
        assert_eq!((vertex.count, vertex.stride()), (2, Some(4)));
        assert_eq!((face.name.as_str(), face.stride()), ("face", None));
    }

    #[test]
    fn a_wrong_header_names_its_line() {
        for (text, what) in [
            ("", "no end"),
            ("ply\nformat ascii 1.0\n", "no end"),
            ("ply\nend_header\n", "line 2 of its header: no `format`"),
            ("ply\nformat utf8 1.0\n", "line 2 of its header: a format"),
            ("ply\nproperty float x\n", "a property of no element"),
            ("ply\nelement vertex -1\n", "no whole number"),
            ("ply\nelement vertex 1\nproperty half x\n", "a type"),
            ("ply\nelement vertex 1\nproperty list int x\n", "line 3"),
            (
                "ply\nelement vertex 1\nproperty float x\nproperty float x\n",
                "a second property `x`",
            ),
            ("ply\nfor whom\n", "`for whom` is not understood"),
        ] {
            let told = Header::read(&mut text.as_bytes()).unwrap_err();
            assert!(told.contains(what), "{text:?}: {told}");
        }
    }

    #[test]
    fn a_line_without_end_is_not_read_to_its_end() {
        struct Endless(u64);
        impl Read for Endless {
            fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
                self.0 += buffer.len() as u64;
                buffer.fill(b'a');
                Ok(buffer.len())
            }
        }
        let mut input = std::io::BufReader::new(Endless(0));
        assert!(Header::read(&mut input).is_err());
        assert!(input.get_ref().0 < 2 * LONGEST_LINE);
    }
}
