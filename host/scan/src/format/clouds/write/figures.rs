//! A cloud as a PLY file, with figures of each point for a viewer to colour it by.

use std::io::{self, Write};

use crate::format::ply;
use crate::rigid::Vec3;

/// Writes `points` (mm) as binary PLY of double precision; `figures`: names, each with a figure for
/// each point.
///
/// # Errors
/// What `out` answers.
pub fn write_ply(
    out: &mut impl Write,
    points: &[Vec3],
    figures: &[(&str, &[f64])],
) -> io::Result<()> {
    let names = ["x", "y", "z"]
        .into_iter()
        .chain(figures.iter().map(|(name, _)| *name));
    let header = ply::begin(points.len() as u64, names.map(|name| ("double", name)));
    out.write_all(header.as_bytes())?;
    for (i, p) in points.iter().enumerate() {
        for x in p.iter() {
            out.write_all(&x.to_le_bytes())?;
        }
        for (_, figures) in figures {
            let figure = figures.get(i).copied().unwrap_or(f64::NAN);
            out.write_all(&figure.to_le_bytes())?;
        }
    }
    Ok(())
}
