//! The vertices of a PLY file, one after the other.

use std::io::{BufRead, ErrorKind, Read};

use super::header::Element;
use super::{Encoding, Header, Scalar};
use crate::ScanError;
use crate::cloud::{CloudColumns, CloudPoint};

/// Bytes of a line at most.
const LONGEST_LINE: u64 = 1 << 16;
/// Whole numbers up to here are exact as a double.
const MOST_PROFILE: f64 = 9_007_199_254_740_992.0;

/// What a property is of a point.
#[derive(Clone, Copy, PartialEq)]
enum Meaning {
    At(usize),
    Profile,
    Index,
    Time,
    Intensity,
    MountU,
    Interpolated,
    Other,
}

/// Reads the vertices of a file.
pub(crate) struct PlyReader<R> {
    input: R,
    encoding: Encoding,
    properties: Vec<(Meaning, Scalar)>,
    left: u64,
    total: u64,
    record: Vec<u8>,
    line: String,
}

impl<R: BufRead> PlyReader<R> {
    /// Reads the header, and what stands before the vertices.
    ///
    /// # Errors
    /// `bad_file` with what is wrong.
    pub fn new(mut input: R) -> Result<Self, ScanError> {
        let header = Header::read(&mut input).map_err(bad)?;
        for element in &header.elements {
            if element.name == "vertex" {
                return Self::vertices(input, header.encoding, element);
            }
            skip(&mut input, header.encoding, element)?;
        }
        Err(bad("it has no element `vertex`"))
    }

    fn vertices(input: R, encoding: Encoding, vertex: &Element) -> Result<Self, ScanError> {
        if vertex.properties.iter().any(|p| p.count.is_some()) {
            return Err(bad("its vertices have a list as a property: not read"));
        }
        let meaning = |name: &str| match name {
            "x" => Meaning::At(0),
            "y" => Meaning::At(1),
            "z" => Meaning::At(2),
            "profile" => Meaning::Profile,
            "index" => Meaning::Index,
            "t_us" => Meaning::Time,
            "intensity" | "scalar_intensity" | "scalar_Intensity" => Meaning::Intensity,
            "mount_u_mm" => Meaning::MountU,
            "interpolated" => Meaning::Interpolated,
            _ => Meaning::Other,
        };
        let properties: Vec<(Meaning, Scalar)> = vertex
            .properties
            .iter()
            .map(|p| (meaning(&p.name), p.value))
            .collect();
        for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
            if !properties.iter().any(|(m, _)| *m == Meaning::At(k)) {
                return Err(bad(format_args!("its vertices have no property `{axis}`")));
            }
        }
        let stride = properties.iter().map(|(_, kind)| kind.size()).sum();
        Ok(Self {
            input,
            encoding,
            properties,
            left: vertex.count,
            total: vertex.count,
            record: vec![0; stride],
            line: String::new(),
        })
    }

    /// What is said of the points beside their coordinates.
    pub fn columns(&self) -> CloudColumns {
        let has = |meaning: Meaning| self.properties.iter().any(|(m, _)| *m == meaning);
        CloudColumns {
            profile: has(Meaning::Profile),
            index: has(Meaning::Index),
            time: has(Meaning::Time),
            intensity: has(Meaning::Intensity),
            mount_u: has(Meaning::MountU),
            interpolated: has(Meaning::Interpolated),
        }
    }

    /// Points that are left.
    pub const fn left(&self) -> u64 {
        self.left
    }

    /// Bytes of the points that are left, at least: the shortest number with what parts it from the next takes two.
    pub fn bytes_left(&self) -> u64 {
        let record = match self.encoding {
            Encoding::Text => 2 * self.properties.len(),
            _ => self.record.len(),
        };
        self.left.saturating_mul(record as u64)
    }

    /// The next point, finite or not.
    ///
    /// # Errors
    /// `bad_file` with the point's number.
    pub fn next_point(&mut self) -> Result<Option<CloudPoint>, ScanError> {
        if self.left == 0 {
            return Ok(None);
        }
        let number = self.total - self.left + 1;
        let total = self.total;
        let wrong = |what: &str| bad(format_args!("point {number} of {total}: {what}"));
        let ended = |error: &std::io::Error| {
            if error.kind() == ErrorKind::UnexpectedEof {
                wrong("the file ends before it: it is cut short")
            } else {
                wrong(&error.to_string())
            }
        };
        let mut point = CloudPoint::default();
        let mut odd = None;
        let mut whole = |what: &'static str, value: f64, most: f64| {
            if !(0.0..=most).contains(&value) || value.fract() != 0.0 {
                odd = Some((what, value));
            }
            value
        };
        let mut take = |meaning: Meaning, value: f64| match meaning {
            Meaning::At(k) => point.at[k] = value,
            Meaning::Profile => point.profile = whole("profile", value, MOST_PROFILE) as u64,
            Meaning::Index => {
                point.index = whole("index", value, f64::from(u32::MAX)) as u32;
            }
            Meaning::Time => point.t_us = value,
            Meaning::Intensity => point.intensity = value,
            Meaning::MountU => point.mount_u_mm = value,
            Meaning::Interpolated => point.interpolated = value != 0.0,
            Meaning::Other => {}
        };
        if self.encoding == Encoding::Text {
            next_line(&mut self.input, &mut self.line).map_err(|error| ended(&error))?;
            let mut words = self.line.split_ascii_whitespace();
            for (meaning, _) in &self.properties {
                let value = words
                    .next()
                    .and_then(|w| w.parse().ok())
                    .ok_or_else(|| wrong("a number is missing or is none"))?;
                take(*meaning, value);
            }
        } else {
            self.input
                .read_exact(&mut self.record)
                .map_err(|error| ended(&error))?;
            let mut rest = self.record.as_slice();
            for (meaning, kind) in &self.properties {
                take(*meaning, kind.read(rest, self.encoding));
                rest = &rest[kind.size()..];
            }
        }
        if let Some((what, value)) = odd {
            return Err(wrong(&format!(
                "its {what} is {value}; a whole number from 0 on is wanted"
            )));
        }
        self.left -= 1;
        Ok(Some(point))
    }
}

fn bad(what: impl std::fmt::Display) -> ScanError {
    ScanError::unreadable("bad_file", what)
}

/// The next line that is not empty.
fn next_line(input: &mut impl BufRead, line: &mut String) -> std::io::Result<()> {
    line.clear();
    while line.trim().is_empty() {
        line.clear();
        if Read::take(&mut *input, LONGEST_LINE).read_line(line)? == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
    }
    Ok(())
}

/// Reads over what stands before the vertices.
fn skip(input: &mut impl BufRead, encoding: Encoding, element: &Element) -> Result<(), ScanError> {
    let short = |error: std::io::Error| {
        bad(format_args!(
            "what stands before its points is cut short: {error}"
        ))
    };
    if element.properties.is_empty() {
        return Ok(());
    }
    if let Some(stride) = element.stride().filter(|_| encoding != Encoding::Text) {
        let bytes = element.count.saturating_mul(stride as u64);
        return pass_over(input, bytes).map_err(short);
    }
    let mut line = String::new();
    let mut head = [0; 8];
    for _ in 0..element.count {
        if encoding == Encoding::Text {
            next_line(input, &mut line).map_err(short)?;
            continue;
        }
        for property in &element.properties {
            let mut values = 1;
            if let Some(count) = property.count {
                let head = &mut head[..count.size()];
                input.read_exact(head).map_err(short)?;
                // Counts of lists are small integers; a negative one becomes 0.
                values = count.read(head, encoding) as u64;
            }
            let bytes = values.saturating_mul(property.value.size() as u64);
            pass_over(input, bytes).map_err(short)?;
        }
    }
    Ok(())
}

fn pass_over(input: &mut impl BufRead, bytes: u64) -> std::io::Result<()> {
    let passed = std::io::copy(&mut Read::take(input, bytes), &mut std::io::sink())?;
    if passed < bytes {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    Ok(())
}
