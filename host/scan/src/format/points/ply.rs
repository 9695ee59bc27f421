//! Points as binary PLY, little endian: x, y, z and nothing else.
//!
//! The number of points stands in the header and is known at the end: it is written into
//! blanks that were left for it.

use std::io::{Seek, SeekFrom, Write};

use super::PointSink;
use super::csv::failed;
use crate::ScanError;
use crate::format::clouds::write::is_far;
use crate::format::ply;

pub(super) struct PlyPoints<W> {
    out: W,
    name: String,
    /// Doubles or floats; not known before the first point, unless doubles are asked for.
    double: Option<bool>,
    bytes: Vec<u8>,
}

impl<W: Write + Seek> PlyPoints<W> {
    pub(super) fn new(out: W, name: String, double: bool) -> Result<Self, ScanError> {
        let mut file = Self {
            out,
            name,
            double: None,
            bytes: Vec::new(),
        };
        if double {
            file.begin(true)?;
        }
        Ok(file)
    }

    fn begin(&mut self, double: bool) -> Result<(), ScanError> {
        self.double = Some(double);
        self.out
            .write_all(header(0, double).as_bytes())
            .map_err(|error| failed(&self.name, &error))
    }
}

fn header(points: u64, double: bool) -> String {
    let kind = if double { "double" } else { "float" };
    ply::begin(points, ["x", "y", "z"].map(|name| (kind, name)))
}

impl<W: Write + Seek> PointSink for PlyPoints<W> {
    fn profile(&mut self, _: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        let Some((_, first)) = points.first() else {
            return Ok(());
        };
        if self.double.is_none() {
            self.begin(is_far(first))?;
        }
        self.bytes.clear();
        if self.double == Some(true) {
            for (_, point) in points {
                for value in point {
                    self.bytes.extend_from_slice(&value.to_le_bytes());
                }
            }
        } else {
            for (_, point) in points {
                for value in point {
                    self.bytes.extend_from_slice(&(*value as f32).to_le_bytes());
                }
            }
        }
        self.out
            .write_all(&self.bytes)
            .map_err(|error| failed(&self.name, &error))
    }

    fn finish(&mut self, points: u64) -> Result<(), ScanError> {
        let header = header(points, self.double == Some(true));
        self.out
            .seek(SeekFrom::Start(0))
            .and_then(|_| self.out.write_all(header.as_bytes()))
            .and_then(|()| self.out.flush())
            .map_err(|error| failed(&self.name, &error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn what_is_written_is_read_back_as_it_was() {
        for double in [false, true] {
            let mut bytes = Cursor::new(Vec::new());
            let far = if double { 1e9 / 7.0 } else { 800.0 };
            let points = [(0, [0.5, -1.25, far]), (7, [1.0, 2.0, 3.0])];
            {
                let mut ply = PlyPoints::new(&mut bytes, "p".into(), false).unwrap();
                ply.profile(0, &points).unwrap();
                ply.profile(1, &[]).unwrap();
                ply.finish(2).unwrap();
            }
            let cloud = crate::format::clouds::cloud_from_bytes(bytes.get_ref()).unwrap();
            assert_eq!(cloud.points.len(), 2);
            for (read, (_, written)) in cloud.points.iter().zip(points) {
                assert_eq!(<[f64; 3]>::from(*read), written);
            }
        }
    }
}
