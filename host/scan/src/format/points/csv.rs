//! Points as CSV.

use std::io::Write;

use super::PointSink;
use crate::ScanError;

pub(super) struct CsvPoints<W> {
    out: W,
    name: String,
}

impl<W: Write> CsvPoints<W> {
    pub(super) fn new(mut out: W, name: String) -> Result<Self, ScanError> {
        out.write_all(b"profile,index,x_mm,y_mm,z_mm\n")
            .map_err(|error| failed(&name, &error))?;
        Ok(Self { out, name })
    }
}

impl<W: Write> PointSink for CsvPoints<W> {
    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        for (index, [x, y, z]) in points {
            // Rust prints the shortest digits that give back the same double.
            writeln!(self.out, "{profile},{index},{x},{y},{z}")
                .map_err(|error| failed(&self.name, &error))?;
        }
        Ok(())
    }

    fn finish(&mut self, _: u64) -> Result<(), ScanError> {
        self.out.flush().map_err(|error| failed(&self.name, &error))
    }
}

pub(super) fn failed(name: &str, error: &std::io::Error) -> ScanError {
    ScanError::unreadable("file", format_args!("cannot write {name}: {error}"))
}
