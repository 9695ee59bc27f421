//! Merged points to files, by the extension of their name; profile by profile.
//!
//! * `.csv`: `profile,index,x_mm,y_mm,z_mm`, as many digits as the doubles need.
//! * `.ply`: binary little endian, x y z as floats or doubles.
//!
//! A file appears under its name only when it is complete.

mod csv;
mod ply;

use std::io::BufWriter;
use std::path::Path;

use crate::ScanError;
use crate::format::partial::Partial;

/// Takes the points of a scan.
pub trait PointSink {
    /// Takes the points of a profile, each with its index in the sensor's array.
    ///
    /// # Errors
    /// They cannot be written.
    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError>;

    /// There are no more; `points` came in all.
    ///
    /// # Errors
    /// The end cannot be written.
    fn finish(&mut self, points: u64) -> Result<(), ScanError>;
}

/// A file of points that is being written.
pub struct PointFile {
    // Closed before the partial file is taken away.
    sink: Box<dyn PointSink>,
    partial: Partial,
}

impl PointFile {
    /// Begins a file. `double`: coordinates of a PLY file as doubles.
    ///
    /// # Errors
    /// `format` for an extension that is unknown; the file cannot be written.
    pub fn create(path: &Path, double: bool) -> Result<Self, ScanError> {
        let extension = path
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        if !matches!(extension.as_str(), "csv" | "ply") {
            return Err(ScanError::unreadable(
                "format",
                format_args!(
                    "{}: points are written as .csv or .ply, by the extension",
                    path.display()
                ),
            ));
        }
        let partial = Partial::new(path);
        let out = BufWriter::with_capacity(1 << 20, partial.begin()?);
        let shown = path.display().to_string();
        let sink: Box<dyn PointSink> = if extension == "csv" {
            Box::new(csv::CsvPoints::new(out, shown)?)
        } else {
            Box::new(ply::PlyPoints::new(out, shown, double)?)
        };
        Ok(Self { sink, partial })
    }
}

impl PointSink for PointFile {
    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        self.sink.profile(profile, points)
    }

    fn finish(&mut self, points: u64) -> Result<(), ScanError> {
        self.sink.finish(points)?;
        self.sink = Box::new(Nothing);
        self.partial.complete()
    }
}

/// Takes nothing: behind the end of a file.
struct Nothing;

impl PointSink for Nothing {
    fn profile(&mut self, _: u64, _: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        Ok(())
    }

    fn finish(&mut self, _: u64) -> Result<(), ScanError> {
        Ok(())
    }
}
