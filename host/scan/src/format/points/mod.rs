//! Merged points to files, by the extension of their name; profile by profile.
//!
//! * `.csv`: `profile,index,x_mm,y_mm,z_mm`, as many digits as the doubles need.
//! * `.ply`: binary little endian, x y z as floats or doubles.
//!
//! A file appears under its name only when it is complete.

mod csv;
mod ply;

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use crate::ScanError;

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
    path: PathBuf,
    /// Where it is until it is complete.
    partial: PathBuf,
    sink: Box<dyn PointSink>,
    complete: bool,
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
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let partial = path.with_file_name(name);
        let file = begin(&partial).map_err(|error| ScanError::file("write", &partial, &error))?;
        let out = BufWriter::with_capacity(1 << 20, file);
        let shown = path.display().to_string();
        let mut file = Self {
            path: path.to_owned(),
            partial,
            sink: Box::new(Nothing),
            complete: false,
        };
        file.sink = if extension == "csv" {
            Box::new(csv::CsvPoints::new(out, shown)?)
        } else {
            Box::new(ply::PlyPoints::new(out, shown, double)?)
        };
        Ok(file)
    }
}

/// Begins a file anew. A link that somebody has put under its name is taken away, not followed.
fn begin(partial: &Path) -> io::Result<File> {
    match std::fs::remove_file(partial) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => File::create_new(partial),
    }
}

impl PointSink for PointFile {
    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        self.sink.profile(profile, points)
    }

    fn finish(&mut self, points: u64) -> Result<(), ScanError> {
        self.sink.finish(points)?;
        self.sink = Box::new(Nothing);
        std::fs::rename(&self.partial, &self.path)
            .map_err(|error| ScanError::file("write", &self.path, &error))?;
        self.complete = true;
        Ok(())
    }
}

impl Drop for PointFile {
    fn drop(&mut self) {
        if !self.complete {
            // Nothing is left of a scan that was refused; if that fails, nobody can be told.
            let _ = std::fs::remove_file(&self.partial);
        }
    }
}

/// Takes nothing: before a file is open and behind its end.
struct Nothing;

impl PointSink for Nothing {
    fn profile(&mut self, _: u64, _: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        Ok(())
    }

    fn finish(&mut self, _: u64) -> Result<(), ScanError> {
        Ok(())
    }
}
