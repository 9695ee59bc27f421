//! Points as records of bytes behind a text header, as PLY and PCD have them. The number of points stands in the header and
//! is known at the end: it is written into blanks that were left for it.

use std::io::{BufWriter, Seek, SeekFrom, Write};

use super::CloudStyle;
use super::counted::Counted;
use crate::ScanError;
use crate::format::partial::Partial;

/// Writes header and records; `header` gives a text of one length for any number of points.
pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
    header: impl Fn(u64) -> String,
) -> Result<(), ScanError> {
    let io = |error: std::io::Error| partial.failed(&error);
    let mut out = BufWriter::with_capacity(1 << 20, partial.begin()?);
    out.write_all(header(0).as_bytes()).map_err(io)?;
    let columns = style.columns;
    let mut record = Vec::with_capacity(48);
    while let Some(p) = points.next_point()? {
        record.clear();
        for value in p.at {
            if style.double {
                record.extend_from_slice(&value.to_le_bytes());
            } else {
                record.extend_from_slice(&(value as f32).to_le_bytes());
            }
        }
        if columns.profile {
            let number = u32::try_from(p.profile).map_err(|_| {
                partial.refused("a profile's number is beyond 32 bits: write .csv instead")
            })?;
            record.extend_from_slice(&number.to_le_bytes());
        }
        if columns.index {
            record.extend_from_slice(&p.index.to_le_bytes());
        }
        if columns.time {
            record.extend_from_slice(&p.t_us.to_le_bytes());
        }
        if columns.intensity {
            record.extend_from_slice(&(p.intensity as f32).to_le_bytes());
        }
        if columns.mount_u {
            record.extend_from_slice(&(p.mount_u_mm as f32).to_le_bytes());
        }
        if columns.interpolated {
            record.push(u8::from(p.interpolated));
        }
        out.write_all(&record).map_err(io)?;
    }
    out.seek(SeekFrom::Start(0)).map_err(io)?;
    out.write_all(header(points.count).as_bytes()).map_err(io)?;
    out.flush().map_err(io)
}

/// Names and kinds of the columns, in the order of the bytes.
pub(super) fn columns(style: CloudStyle) -> Vec<(&'static str, Kind)> {
    let mut all = vec![
        ("x", Kind::Coordinate),
        ("y", Kind::Coordinate),
        ("z", Kind::Coordinate),
    ];
    if style.columns.profile {
        all.push(("profile", Kind::Number));
    }
    if style.columns.index {
        all.push(("index", Kind::Number));
    }
    if style.columns.time {
        all.push(("t_us", Kind::Time));
    }
    if style.columns.intensity {
        all.push(("intensity", Kind::Measure));
    }
    if style.columns.mount_u {
        all.push(("mount_u_mm", Kind::Measure));
    }
    if style.columns.interpolated {
        all.push(("interpolated", Kind::Flag));
    }
    all
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Coordinate,
    Number,
    /// Always a double: a float of microseconds is off by a millisecond after three hours.
    Time,
    /// A float is enough.
    Measure,
    /// A byte, 0 or 1.
    Flag,
}
