//! PCD 0.7, binary: the Point Cloud Library's format.

use super::CloudStyle;
use super::counted::Counted;
use super::records::{self, Kind};
use crate::ScanError;
use crate::format::partial::Partial;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    records::write(partial, style, points, |count| header(style, count))
}

/// Of one length for any number of points: blanks behind the number take up the digits that are missing.
fn header(style: CloudStyle, count: u64) -> String {
    let columns = records::columns(style);
    let row = |of: &dyn Fn(&(&'static str, Kind)) -> &'static str| -> String {
        columns.iter().map(of).collect::<Vec<_>>().join(" ")
    };
    let sizes = row(&|(_, kind)| match kind {
        Kind::Coordinate if style.double => "8",
        Kind::Time => "8",
        Kind::Flag => "1",
        _ => "4",
    });
    let types = row(&|(_, kind)| match kind {
        Kind::Number | Kind::Flag => "U",
        _ => "F",
    });
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {}\nSIZE {sizes}\nTYPE {types}\nCOUNT {}\n\
         WIDTH {count:<20}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count:<20}\nDATA binary\n",
        row(&|(name, _)| *name),
        row(&|_| "1"),
    )
}
