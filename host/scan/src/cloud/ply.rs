//! PLY files: text, and binary of either byte order (Turk, The PLY Polygon File Format, 1994).

use super::ScanCloud;
use crate::ScanError;
use crate::rigid::Vec3;

/// Lines of a header at most: a file without `end_header` is not searched to its end.
const HEADER_LINES: usize = 10_000;

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, PartialEq)]
enum Number {
    Int(usize, bool),
    Float,
    Double,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Int(1, true),
            "uchar" | "uint8" => Self::Int(1, false),
            "short" | "int16" => Self::Int(2, true),
            "ushort" | "uint16" => Self::Int(2, false),
            "int" | "int32" => Self::Int(4, true),
            "uint" | "uint32" => Self::Int(4, false),
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::Int(size, _) => size,
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// The number in the first bytes of `bytes`, which are as many as its size.
    fn read(self, bytes: &[u8], encoding: Encoding) -> f64 {
        let size = self.size();
        let mut raw: u64 = 0;
        for i in 0..size {
            let at = if encoding == Encoding::BigEndian {
                size - 1 - i
            } else {
                i
            };
            raw |= u64::from(bytes[at]) << (8 * i);
        }
        match self {
            Self::Float => f64::from(f32::from_bits(raw as u32)),
            Self::Double => f64::from_bits(raw),
            Self::Int(size, signed) => {
                let unused = 64 - 8 * size as u32;
                if signed {
                    ((raw << unused) as i64 >> unused) as f64
                } else {
                    raw as f64
                }
            }
        }
    }
}

enum Property {
    One(String, Number),
    /// A list: the type of its count, the type of its items.
    List(Number, Number),
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

impl Element {
    /// Bytes of one, if no property is a list.
    fn stride(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|p| match p {
                Property::One(_, number) => Some(number.size()),
                Property::List(..) => None,
            })
            .sum()
    }

    /// What x, y, z are among the properties.
    fn place(&self, axis: &str) -> Result<usize, ScanError> {
        self.properties
            .iter()
            .position(|p| matches!(p, Property::One(name, _) if name == axis))
            .ok_or_else(|| {
                ScanError::unreadable(
                    "bad_file",
                    format_args!("its vertices have no property `{axis}`"),
                )
            })
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let (encoding, elements, body) = header(bytes)?;
    let at = elements
        .iter()
        .position(|e| e.name == "vertex")
        .ok_or_else(|| ScanError::unreadable("bad_file", "it has no element `vertex`"))?;
    let (before, vertex) = (&elements[..at], &elements[at]);
    let places = [vertex.place("x")?, vertex.place("y")?, vertex.place("z")?];
    if encoding == Encoding::Text {
        text(body, before, vertex, places)
    } else {
        binary(body, before, vertex, places, encoding)
    }
}

fn header(bytes: &[u8]) -> Result<(Encoding, Vec<Element>, &[u8]), ScanError> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut rest = bytes;
    for number in 1..=HEADER_LINES {
        let Some(end) = rest.iter().position(|&b| b == b'\n') else {
            break;
        };
        let line = rest[..end].trim_ascii();
        rest = &rest[end + 1..];
        let wrong = |what: &str| {
            ScanError::unreadable(
                "bad_file",
                format_args!("line {number} of its header: {what}"),
            )
        };
        let line = std::str::from_utf8(line).map_err(|_| wrong("it is not text"))?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["ply"] | [] | ["comment" | "obj_info", ..] => {}
            ["format", kind, _] => {
                encoding = Some(match *kind {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(wrong("a format that PLY does not have")),
                });
            }
            ["element", name, count] => elements.push(Element {
                name: (*name).to_string(),
                count: count
                    .parse()
                    .map_err(|_| wrong("the count is no whole number"))?,
                properties: Vec::new(),
            }),
            ["property", "list", count, item, _] => {
                let list = Number::named(count).zip(Number::named(item));
                let (count, item) = list.ok_or_else(|| wrong("a type that PLY does not have"))?;
                let element = elements
                    .last_mut()
                    .ok_or_else(|| wrong("a property of no element"))?;
                element.properties.push(Property::List(count, item));
            }
            ["property", kind, name] => {
                let kind =
                    Number::named(kind).ok_or_else(|| wrong("a type that PLY does not have"))?;
                let element = elements
                    .last_mut()
                    .ok_or_else(|| wrong("a property of no element"))?;
                element
                    .properties
                    .push(Property::One((*name).to_string(), kind));
            }
            ["end_header"] => {
                let encoding = encoding.ok_or_else(|| wrong("no `format` before it"))?;
                return Ok((encoding, elements, rest));
            }
            _ => return Err(wrong(&format!("`{line}` is not understood"))),
        }
    }
    Err(ScanError::unreadable(
        "bad_file",
        "its header has no end (`end_header`)",
    ))
}

fn cut(vertex: &Element, bytes: usize) -> ScanError {
    ScanError::unreadable(
        "bad_file",
        format_args!(
            "its header states {} points, but only {bytes} bytes follow: it is cut short",
            vertex.count
        ),
    )
}

fn binary(
    mut body: &[u8],
    before: &[Element],
    vertex: &Element,
    places: [usize; 3],
    encoding: Encoding,
) -> Result<ScanCloud, ScanError> {
    let short = || ScanError::unreadable("bad_file", "what stands before its points is cut short");
    for element in before {
        if let Some(stride) = element.stride() {
            let size = stride.checked_mul(element.count).ok_or_else(short)?;
            body = body.get(size..).ok_or_else(short)?;
            continue;
        }
        for _ in 0..element.count {
            for property in &element.properties {
                let size = match property {
                    Property::One(_, number) => number.size(),
                    Property::List(count, item) => {
                        let head = body.get(..count.size()).ok_or_else(short)?;
                        let n = count.read(head, encoding);
                        body = &body[count.size()..];
                        // Counts of lists are small integers; a negative one becomes 0.
                        (n as usize).checked_mul(item.size()).ok_or_else(short)?
                    }
                };
                body = body.get(size..).ok_or_else(short)?;
            }
        }
    }
    let stride = vertex.stride().filter(|s| *s > 0).ok_or_else(|| {
        ScanError::unreadable(
            "bad_file",
            "its vertices have a list as a property: not read",
        )
    })?;
    let size = stride.checked_mul(vertex.count);
    let body = size
        .and_then(|size| body.get(..size))
        .ok_or_else(|| cut(vertex, body.len()))?;
    let axes = places.map(|place| {
        let mut offset = 0;
        let mut kind = Number::Float;
        for property in &vertex.properties[..=place] {
            if let Property::One(_, number) = property {
                offset += number.size();
                kind = *number;
            }
        }
        (offset - kind.size(), kind)
    });
    let mut cloud = ScanCloud::default();
    cloud.points.reserve_exact(vertex.count);
    for record in body.chunks_exact(stride) {
        let [x, y, z] = axes.map(|(offset, kind)| kind.read(&record[offset..], encoding));
        cloud.push(Vec3::new(x, y, z));
    }
    Ok(cloud)
}

fn text(
    body: &[u8],
    before: &[Element],
    vertex: &Element,
    places: [usize; 3],
) -> Result<ScanCloud, ScanError> {
    // The shortest number with what parts it from the next takes two bytes.
    let least = 2 * vertex.properties.len().max(1);
    if vertex.count > (body.len() + 1) / least {
        return Err(cut(vertex, body.len()));
    }
    let mut lines = body
        .split(|&b| b == b'\n')
        .map(<[u8]>::trim_ascii)
        .filter(|line| !line.is_empty());
    for element in before {
        for _ in 0..element.count {
            lines.next().ok_or_else(|| cut(vertex, 0))?;
        }
    }
    let mut cloud = ScanCloud::default();
    cloud.points.reserve_exact(vertex.count);
    for i in 0..vertex.count {
        let wrong =
            |what: &str| ScanError::unreadable("bad_file", format_args!("point {}: {what}", i + 1));
        let line = lines
            .next()
            .ok_or_else(|| wrong("the file ends before it"))?;
        let line = std::str::from_utf8(line).map_err(|_| wrong("it is not text"))?;
        let mut point = [None; 3];
        for (k, word) in line.split_ascii_whitespace().enumerate() {
            for (value, place) in point.iter_mut().zip(places) {
                if k == place {
                    *value = word.parse::<f64>().ok();
                }
            }
        }
        let [Some(x), Some(y), Some(z)] = point else {
            return Err(wrong("its coordinates are no numbers"));
        };
        cloud.push(Vec3::new(x, y, z));
    }
    Ok(cloud)
}
