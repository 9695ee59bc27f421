//! PLY, binary, little endian.

use super::CloudStyle;
use super::counted::Counted;
use super::records::{self, Kind};
use crate::ScanError;
use crate::format::partial::Partial;
use crate::format::ply;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    records::write(partial, style, points, |count| header(style, count))
}

fn header(style: CloudStyle, count: u64) -> String {
    let property = |(name, kind)| {
        let kind = match kind {
            Kind::Coordinate if style.double => "double",
            Kind::Coordinate | Kind::Intensity => "float",
            Kind::Number => "uint",
        };
        (kind, name)
    };
    ply::begin(count, records::columns(style).into_iter().map(property))
}
