//! PLY meshes: text and binary of either byte order, scalars of any kind, polygons of any count.

use nalgebra::Vector3;

use super::RawMesh;
use super::unreadable::unreadable;
use crate::ScanError;

#[derive(Clone, Copy, PartialEq)]
enum Order {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

struct Property {
    name: String,
    /// Of the count, where it is a list.
    count: Option<Scalar>,
    value: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// What follows the header, value by value.
struct Body<'a> {
    bytes: &'a [u8],
    order: Order,
}

impl Body<'_> {
    fn next(&mut self, kind: Scalar) -> Result<f64, ScanError> {
        if self.order == Order::Text {
            let blank = |b: &u8| b.is_ascii_whitespace();
            let start = self
                .bytes
                .iter()
                .position(|b| !blank(b))
                .unwrap_or(self.bytes.len());
            let rest = &self.bytes[start..];
            let end = rest.iter().position(blank).unwrap_or(rest.len());
            let word = std::str::from_utf8(&rest[..end]).unwrap_or("");
            self.bytes = &rest[end..];
            return word
                .parse()
                .map_err(|_| unreadable("a number is missing or is none"));
        }
        let size = kind.size();
        let Some((value, rest)) = self.bytes.split_at_checked(size) else {
            return Err(unreadable("the file ends before its elements do"));
        };
        self.bytes = rest;
        let mut b = [0_u8; 8];
        for (k, byte) in value.iter().enumerate() {
            b[if self.order == Order::Little {
                k
            } else {
                size - 1 - k
            }] = *byte;
        }
        Ok(match kind {
            Scalar::I8 => f64::from(b[0] as i8),
            Scalar::U8 => f64::from(b[0]),
            Scalar::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Scalar::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Scalar::I32 => f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Scalar::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Scalar::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Scalar::F64 => f64::from_le_bytes(b),
        })
    }
}

fn header(bytes: &[u8]) -> Result<(Order, Vec<Element>, &[u8]), ScanError> {
    const END: &[u8] = b"end_header";
    let end = bytes
        .windows(END.len())
        .position(|w| w == END)
        .filter(|_| bytes.starts_with(b"ply"))
        .ok_or_else(|| unreadable("a PLY file begins with `ply` and has a header that ends"))?;
    let text =
        std::str::from_utf8(&bytes[..end]).map_err(|_| unreadable("the header is no text"))?;
    let mut body = &bytes[end + END.len()..];
    body = body.strip_prefix(b"\r").unwrap_or(body);
    body = body.strip_prefix(b"\n").unwrap_or(body);
    let mut order = None;
    let mut elements: Vec<Element> = Vec::new();
    for line in text.lines().skip(1) {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["format", "ascii", ..] => order = Some(Order::Text),
            ["format", "binary_little_endian", ..] => order = Some(Order::Little),
            ["format", "binary_big_endian", ..] => order = Some(Order::Big),
            ["element", name, count] => elements.push(Element {
                name: (*name).into(),
                count: count
                    .parse()
                    .map_err(|_| unreadable("an element has no count"))?,
                properties: Vec::new(),
            }),
            ["property", kind @ .., name] => {
                let known = |s: &str| {
                    Scalar::named(s)
                        .ok_or_else(|| unreadable(format_args!("no scalar is called {s}")))
                };
                let (count, value) = match kind {
                    ["list", count, value] => (Some(known(count)?), known(value)?),
                    [value] => (None, known(value)?),
                    _ => return Err(unreadable("a property has no kind")),
                };
                elements
                    .last_mut()
                    .ok_or_else(|| unreadable("a property stands before every element"))?
                    .properties
                    .push(Property {
                        name: (*name).into(),
                        count,
                        value,
                    });
            }
            _ => {}
        }
    }
    let order = order.ok_or_else(|| unreadable("the header names no format"))?;
    Ok((order, elements, body))
}

/// Reads vertices and faces, skipping every other element and property.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let (order, elements, bytes) = header(bytes)?;
    let mut body = Body { bytes, order };
    let mut raw = RawMesh::default();
    for element in &elements {
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
                    for k in 1..corners.len() - 1 {
                        raw.faces.push([corners[0], corners[k], corners[k + 1]]);
                    }
                }
            }
            if element.name == "vertex" {
                raw.vertices.push(place);
            }
        }
    }
    if raw.faces.iter().flatten().any(|&i| i >= raw.vertices.len()) {
        return Err(unreadable("a face names a vertex that is not there"));
    }
    Ok(raw)
}
