//! PLY clouds, text and binary of either byte order, point by point.

use std::io::{BufRead, Read};

use super::{CloudColumns, CloudPoint};
use crate::ScanError;

/// Lines of a header at most, and bytes of a line: a file that is no PLY is not searched to its end.
const HEADER_LINES: usize = 1000;
const LONGEST_LINE: u64 = 1 << 16;

#[derive(Clone, Copy, PartialEq)]
enum Order {
    Text,
    Little,
    Big,
}

/// Bytes of a number, and what it is.
#[derive(Clone, Copy)]
enum Number {
    Signed(usize),
    Unsigned(usize),
    Real(usize),
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Signed(1),
            "uchar" | "uint8" => Self::Unsigned(1),
            "short" | "int16" => Self::Signed(2),
            "ushort" | "uint16" => Self::Unsigned(2),
            "int" | "int32" => Self::Signed(4),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Real(4),
            "double" | "float64" => Self::Real(8),
            _ => return None,
        })
    }

    const fn size(self) -> usize {
        match self {
            Self::Signed(n) | Self::Unsigned(n) | Self::Real(n) => n,
        }
    }

    /// The number in bytes that are as many as its size.
    fn read(self, bytes: &[u8], order: Order) -> f64 {
        let mut raw = 0_u64;
        for (k, byte) in bytes.iter().enumerate() {
            let place = if order == Order::Big {
                bytes.len() - 1 - k
            } else {
                k
            };
            raw |= u64::from(*byte) << (8 * place);
        }
        match self {
            Self::Unsigned(_) => raw as f64,
            Self::Signed(n) => {
                let unused = 64 - 8 * n as u32;
                ((raw << unused).cast_signed() >> unused) as f64
            }
            Self::Real(4) => f64::from(f32::from_bits(raw as u32)),
            Self::Real(_) => f64::from_bits(raw),
        }
    }
}

/// What a property is of a point.
#[derive(Clone, Copy, PartialEq)]
enum Meaning {
    At(usize),
    Profile,
    Index,
    Intensity,
    Other,
}

pub(super) struct PlyReader<R> {
    input: R,
    name: String,
    order: Order,
    properties: Vec<(Meaning, Number)>,
    left: u64,
    total: u64,
    record: Vec<u8>,
    line: String,
}

impl<R: BufRead> PlyReader<R> {
    pub fn new(mut input: R, name: String) -> Result<Self, ScanError> {
        let bad = |what: &str| ScanError::unreadable("bad_file", format_args!("{name}: {what}"));
        let mut order = None;
        let mut elements: Vec<String> = Vec::new();
        let mut properties = Vec::new();
        let mut total = 0;
        let mut bytes = Vec::new();
        for number in 1..=HEADER_LINES {
            bytes.clear();
            let got = Read::take(&mut input, LONGEST_LINE)
                .read_until(b'\n', &mut bytes)
                .map_err(|error| bad(&error.to_string()))?;
            if got == 0 || bytes.last() != Some(&b'\n') {
                return Err(bad("its header has no end (`end_header`)"));
            }
            let wrong = |what: &str| bad(&format!("line {number} of its header: {what}"));
            let line = std::str::from_utf8(&bytes).map_err(|_| wrong("it is not text"))?;
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["ply"] | [] | ["comment" | "obj_info", ..] => {}
                ["format", kind, _] => {
                    order = Some(match *kind {
                        "ascii" => Order::Text,
                        "binary_little_endian" => Order::Little,
                        "binary_big_endian" => Order::Big,
                        _ => return Err(wrong("a format that PLY does not have")),
                    });
                }
                ["element", element, count] => {
                    let count: u64 = count
                        .parse()
                        .map_err(|_| wrong("the count is no whole number"))?;
                    if *element == "vertex" {
                        total = count;
                    } else if !elements.iter().any(|e| e == "vertex") && count > 0 {
                        return Err(wrong("something stands before its points: not read"));
                    }
                    elements.push((*element).to_owned());
                }
                ["property", "list", ..] => {
                    if elements.last().is_some_and(|e| e == "vertex") {
                        return Err(wrong("its points have a list as a property: not read"));
                    }
                }
                ["property", kind, property] => {
                    if elements.last().is_some_and(|e| e == "vertex") {
                        let kind = Number::named(kind)
                            .ok_or_else(|| wrong("a type that PLY does not have"))?;
                        let meaning = match *property {
                            "x" => Meaning::At(0),
                            "y" => Meaning::At(1),
                            "z" => Meaning::At(2),
                            "profile" => Meaning::Profile,
                            "index" => Meaning::Index,
                            "intensity" | "scalar_intensity" | "scalar_Intensity" => {
                                Meaning::Intensity
                            }
                            _ => Meaning::Other,
                        };
                        properties.push((meaning, kind));
                    }
                }
                ["end_header"] => {
                    let order = order.ok_or_else(|| wrong("no `format` before it"))?;
                    for k in 0..3 {
                        if !properties.iter().any(|(m, _)| *m == Meaning::At(k)) {
                            return Err(bad("its points have no properties x, y, z"));
                        }
                    }
                    let stride = properties.iter().map(|(_, kind)| kind.size()).sum();
                    return Ok(Self {
                        record: vec![0; stride],
                        input,
                        order,
                        properties,
                        left: total,
                        total,
                        line: String::new(),
                        name,
                    });
                }
                _ => return Err(wrong("it is not understood")),
            }
        }
        Err(bad("its header has no end (`end_header`)"))
    }

    pub fn columns(&self) -> CloudColumns {
        let has = |meaning: Meaning| self.properties.iter().any(|(m, _)| *m == meaning);
        CloudColumns {
            profile: has(Meaning::Profile),
            index: has(Meaning::Index),
            intensity: has(Meaning::Intensity),
        }
    }

    pub fn next_point(&mut self) -> Result<Option<CloudPoint>, ScanError> {
        if self.left == 0 {
            return Ok(None);
        }
        let number = self.total - self.left + 1;
        let bad = |what: &str| {
            ScanError::unreadable(
                "bad_file",
                format_args!("{}, point {number} of {}: {what}", self.name, self.total),
            )
        };
        let mut point = CloudPoint {
            at: [0.0; 3],
            profile: 0,
            index: 0,
            intensity: 0.0,
        };
        let mut take = |meaning: Meaning, value: f64| match meaning {
            Meaning::At(k) => point.at[k] = value,
            // Casts end at the bounds: a number that is none becomes 0.
            Meaning::Profile => point.profile = value as u64,
            Meaning::Index => point.index = value as u32,
            Meaning::Intensity => point.intensity = value,
            Meaning::Other => {}
        };
        if self.order == Order::Text {
            self.line.clear();
            while self.line.trim().is_empty() {
                self.line.clear();
                let got = Read::take(&mut self.input, LONGEST_LINE)
                    .read_line(&mut self.line)
                    .map_err(|error| bad(&error.to_string()))?;
                if got == 0 {
                    return Err(bad("the file ends before it: it is cut short"));
                }
            }
            let mut words = self.line.split_ascii_whitespace();
            for (meaning, _) in &self.properties {
                let value = words
                    .next()
                    .and_then(|w| w.parse().ok())
                    .ok_or_else(|| bad("a number is missing or is none"))?;
                take(*meaning, value);
            }
        } else {
            self.input.read_exact(&mut self.record).map_err(|error| {
                if error.kind() == std::io::ErrorKind::UnexpectedEof {
                    bad("the file ends before it: it is cut short")
                } else {
                    bad(&error.to_string())
                }
            })?;
            let mut rest = self.record.as_slice();
            for (meaning, kind) in &self.properties {
                let (bytes, behind) = rest.split_at(kind.size());
                rest = behind;
                take(*meaning, kind.read(bytes, self.order));
            }
        }
        self.left -= 1;
        Ok(Some(point))
    }
}
