//! PLY, binary, little endian (Turk, The PLY Polygon File Format, 1994).

use super::CloudStyle;
use super::counted::Counted;
use super::partial::Partial;
use super::records::{self, Kind};
use crate::ScanError;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    records::write(partial, style, points, |count| header(style, count))
}

/// Of one length for any number of points: a comment takes up the digits that are missing.
fn header(style: CloudStyle, count: u64) -> String {
    let number = count.to_string();
    let fill = "-".repeat(20 - number.len());
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\ncomment unit mm\nelement vertex {number}\ncomment {fill}\n"
    );
    for (name, kind) in records::columns(style) {
        let kind = match kind {
            Kind::Coordinate if style.double => "double",
            Kind::Coordinate | Kind::Intensity => "float",
            Kind::Number => "uint",
        };
        text += &format!("property {kind} {name}\n");
    }
    text + "end_header\n"
}
