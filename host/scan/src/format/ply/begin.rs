//! The header of a PLY file that is written.

use std::fmt::Write;

/// Digits of the greatest number of points.
const DIGITS: usize = 20;

/// A header of binary little endian vertices, in mm; `properties`: type and name of each.
///
/// It is of one length for any number of points, so that it can be written again when the points are counted: a comment
/// takes up the digits that are missing.
pub(crate) fn begin<'a>(
    points: u64,
    properties: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> String {
    let number = points.to_string();
    let fill = "-".repeat(DIGITS - number.len());
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\ncomment unit mm\ncomment offset_mm 0 0 0\nelement vertex {number}\ncomment {fill}\n"
    );
    for (kind, name) in properties {
        // Writing to a string does not fail.
        let _ = writeln!(text, "property {kind} {name}");
    }
    text + "end_header\n"
}

#[cfg(test)]
mod tests {
    use super::begin;

    #[test]
    fn no_number_of_points_changes_its_length() {
        let none = begin(0, [("float", "x")]);
        assert_eq!(begin(u64::MAX, [("float", "x")]).len(), none.len());
        assert!(none.ends_with("property float x\nend_header\n"));
    }
}
