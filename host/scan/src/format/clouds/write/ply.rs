//! PLY, binary, little endian.

use super::CloudStyle;
use super::counted::{Counted, farthest_mm};
use super::notes::{NOTHING_MM, rounding_mm};
use super::records::{self, Kind};
use crate::ScanError;
use crate::format::partial::Partial;
use crate::format::ply;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    let far = points.look()?.is_some_and(|first| is_far(&first.at));
    let style = CloudStyle {
        double: style.double || far,
        ..style
    };
    records::write(partial, style, points, |count| header(style, count))
}

/// Whether floats would round a cloud that begins there by more than what nobody measures: then it is written as doubles.
pub(crate) fn is_far(first: &[f64; 3]) -> bool {
    rounding_mm(farthest_mm(first)) > NOTHING_MM
}

fn header(style: CloudStyle, count: u64) -> String {
    let property = |(name, kind)| {
        let kind = match kind {
            Kind::Coordinate if style.double => "double",
            Kind::Time => "double",
            Kind::Coordinate | Kind::Measure => "float",
            Kind::Number => "uint",
            Kind::Flag => "uchar",
        };
        (kind, name)
    };
    ply::begin(count, records::columns(style).into_iter().map(property))
}
