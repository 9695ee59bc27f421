//! Merged points to files, by the extension of their name; profile by profile.
//!
//! * `.csv`: `profile,index,x_mm,y_mm,z_mm`, as many digits as the doubles need.
//! * `.ply`: binary little endian, x y z as floats or doubles; profile and index where they are asked for.
//! * `.pcd`, and with the feature `cloud-formats` `.las`, `.laz`, `.e57`, `.parquet`: as
//!   [`super::clouds`] writes them.
//!
//! Each has the time of every point where that is asked for, and its intensity; which points were placed between latches, where any were (not E57); `.csv`, `.ply`, `.pcd` and `.parquet` its uncertainty by the mount.
//!
//! A file appears under its name only when it is complete.

mod csv;
#[cfg(feature = "cloud-formats")]
mod e57;
mod handed;
mod ply;

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use umi_kinematics::Pose;

use crate::ScanError;
use crate::cloud::CloudColumns;
use crate::format::clouds::CloudStyle;
use crate::format::clouds::write::{check_extension, holds_uncertainty};
use crate::format::partial::Partial;

/// Takes the points of a scan.
pub trait PointSink {
    /// Takes where the sensor was, in the workpiece's frame, at the profile that comes next.
    ///
    /// # Errors
    /// It cannot be written.
    fn pose(&mut self, _profile: u64, _pose: &Pose) -> Result<(), ScanError> {
        Ok(())
    }

    /// Takes when the sensor saw the profile that comes next, in microseconds of the board's clock.
    fn time(&mut self, _t_us: f64) {}

    /// Takes the standard uncertainties by the mount of the points of the profile that comes next, in mm.
    fn uncertainties(&mut self, _mount_u_mm: &[f64]) {}

    /// Takes how bright the points of the profile that comes next were, in the sensor's own measure.
    fn intensities(&mut self, _intensities: &[f64]) {}

    /// Some of the profiles of this scan had no latch and are placed between two others: told before the first profile.
    ///
    /// # Errors
    /// What says so cannot be written.
    fn interpolating(&mut self) -> Result<(), ScanError> {
        Ok(())
    }

    /// Takes whether the profile that comes next is one of those.
    fn interpolated(&mut self, _is: bool) {}

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

/// How merged points are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PointStyle {
    /// Coordinates of PLY and PCD as doubles.
    pub double: bool,
    /// Profile and index in a PLY, too. Without them it is written in the least time and space; LAS and LAZ have no room
    /// for them, all others always have them.
    pub profiles: bool,
    /// The time of each point.
    pub times: bool,
    /// The standard uncertainty of each point by the mount.
    pub uncertainties: bool,
    /// How bright the sensor saw each point.
    pub intensities: bool,
    /// Which points were placed between latches.
    pub interpolated: bool,
}

/// A file of points that is being written.
pub struct PointFile {
    // Closed before the partial file is taken away.
    sink: Box<dyn PointSink>,
    /// Of a sink that has not one of its own.
    partial: Option<Partial>,
    /// How it was begun; none where each profile is a scan of its own.
    begun: Option<(PathBuf, PointStyle)>,
}

impl PointFile {
    /// Begins a file.
    ///
    /// # Errors
    /// `format` for an extension that is unknown or has no room for profiles; the file cannot be written.
    pub fn create(path: &Path, style: PointStyle) -> Result<Self, ScanError> {
        let extension = path
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        let kind = extension.as_str();
        if style.profiles && matches!(kind, "las" | "laz") {
            return Err(ScanError::unreadable(
                "format",
                format_args!(
                    "{}: LAS and LAZ have no room for profiles; write .ply, .csv, .pcd, .e57 or .parquet",
                    path.display()
                ),
            ));
        }
        if style.uncertainties && !holds_uncertainty(path) {
            return Err(ScanError::unreadable(
                "format",
                format_args!(
                    "{}: only CSV, PLY, PCD and Parquet have room for the points' uncertainty",
                    path.display()
                ),
            ));
        }
        let profiles = style.profiles || kind != "ply";
        let plain = !style.times
            && !style.uncertainties
            && !style.intensities
            && !style.interpolated
            && (kind == "csv" || kind == "ply" && !profiles);
        if !plain {
            check_extension(path)?;
            let written = CloudStyle {
                columns: CloudColumns {
                    profile: profiles,
                    index: profiles,
                    time: style.times,
                    intensity: style.intensities,
                    mount_u: style.uncertainties,
                    interpolated: style.interpolated,
                },
                double: style.double,
                longest_mm: None,
            };
            return Ok(Self {
                sink: Box::new(handed::HandedPoints::new(path, written)),
                partial: None,
                begun: Some((path.to_owned(), style)),
            });
        }
        let partial = Partial::new(path);
        let out = BufWriter::with_capacity(1 << 20, partial.begin()?);
        let shown = path.display().to_string();
        let sink: Box<dyn PointSink> = if kind == "csv" {
            Box::new(csv::CsvPoints::new(out, shown)?)
        } else {
            Box::new(ply::PlyPoints::new(out, shown, style.double)?)
        };
        Ok(Self {
            sink,
            partial: Some(partial),
            begun: Some((path.to_owned(), style)),
        })
    }

    /// Begins an E57 file with a scan for each profile: its points in the sensor's frame, and the
    /// sensor's pose.
    ///
    /// # Errors
    /// `format` for another extension, or where E57 is not built in; the file cannot be written.
    pub fn each_profile(path: &Path) -> Result<Self, ScanError> {
        #[cfg(feature = "cloud-formats")]
        if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("e57"))
        {
            let partial = Partial::new(path);
            let shown = path.display().to_string();
            return Ok(Self {
                sink: Box::new(e57::E57Profiles::new(partial.begin()?, shown)?),
                partial: Some(partial),
                begun: None,
            });
        }
        Err(ScanError::unreadable(
            "format",
            format_args!(
                "{}: a scan for each profile is written as .e57",
                path.display()
            ),
        ))
    }
}

impl PointSink for PointFile {
    fn pose(&mut self, profile: u64, pose: &Pose) -> Result<(), ScanError> {
        self.sink.pose(profile, pose)
    }

    fn time(&mut self, t_us: f64) {
        self.sink.time(t_us);
    }

    fn uncertainties(&mut self, mount_u_mm: &[f64]) {
        self.sink.uncertainties(mount_u_mm);
    }

    fn intensities(&mut self, intensities: &[f64]) {
        self.sink.intensities(intensities);
    }

    /// Only now it is known that the points need another column: the file is begun again. Without one its bytes are what
    /// they are without this.
    fn interpolating(&mut self) -> Result<(), ScanError> {
        let Some((path, style)) = self.begun.take() else {
            return Ok(());
        };
        // Its writer ends and takes its partial file away before another one begins.
        self.sink = Box::new(Nothing);
        self.partial = None;
        let interpolated = true;
        *self = Self::create(
            &path,
            PointStyle {
                interpolated,
                ..style
            },
        )?;
        Ok(())
    }

    fn interpolated(&mut self, is: bool) {
        self.sink.interpolated(is);
    }

    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        self.sink.profile(profile, points)
    }

    fn finish(&mut self, points: u64) -> Result<(), ScanError> {
        self.sink.finish(points)?;
        self.sink = Box::new(Nothing);
        self.partial.as_mut().map_or(Ok(()), Partial::complete)
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
