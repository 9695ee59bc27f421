//! Readings of a point sensor to points.

use std::io::{self, Write};
use std::path::Path;

use umi_core::units::{Mm, Point};

use super::calibration::{KnownSensor, SensorCovariance};
use super::readings::SensorReadings;
use crate::ScanError;
use crate::format::clouds::write::{check_extension, write_ply};
use crate::rigid::Vec3;

/// What the uncertainties of a point are called.
const U_NAMES: [&str; 3] = ["u_x_mm", "u_y_mm", "u_z_mm"];

/// Points with what the calibration leaves uncertain of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorCloud {
    /// The points, mm.
    pub points: Vec<Vec3>,
    /// Standard uncertainties of x, y and z for each point, mm, if the calibration has a
    /// covariance. The readings' own noise is not in them.
    pub u_mm: Option<Vec<[f64; 3]>>,
}

/// Makes the points of readings; `covariance` is that of offset, direction and gain.
#[must_use]
pub fn points(
    readings: &SensorReadings,
    known: &KnownSensor,
    covariance: Option<&SensorCovariance>,
) -> SensorCloud {
    let of = |axes_mm, gamma_mm| {
        let place = known
            .sensor
            .place(Point::from_array_mm(axes_mm), Mm(gamma_mm));
        place.mm
    };
    let used = &readings.used;
    SensorCloud {
        points: used.iter().map(|r| of(r.axes_mm, r.gamma_mm)).collect(),
        u_mm: covariance.map(|covariance| {
            used.iter()
                .map(|r| {
                    let place = known.sensor.place_covariance(Mm(r.gamma_mm), covariance);
                    [0, 1, 2].map(|axis: usize| place[axis][axis].max(0.0).sqrt())
                })
                .collect()
        }),
    }
}

/// Refuses a file whose ending is another cloud format's than the ones that are written.
///
/// # Errors
/// `format`.
pub fn check_ending(path: &Path, written: &[&str]) -> Result<(), ScanError> {
    if has_ending(path, written) || check_extension(path).is_err() {
        return Ok(());
    }
    Err(ScanError::unreadable(
        "format",
        format_args!(
            "{}: readings become points as {} here; umi scan convert makes the other formats of that",
            path.display(),
            written.join(" or ")
        ),
    ))
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension()
        .is_some_and(|ending| endings.iter().any(|of| ending.eq_ignore_ascii_case(of)))
}

/// Writes a cloud: PLY if the file is called so, else CSV.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, cloud: &SensorCloud) -> Result<(), ScanError> {
    let mut bytes = Vec::new();
    let written = if has_ending(path, &["ply"]) {
        let u = |axis: usize| -> Vec<f64> {
            let all = cloud.u_mm.iter().flatten();
            all.filter_map(|u| u.get(axis).copied()).collect()
        };
        let (x, y, z) = (u(0), u(1), u(2));
        let figures = U_NAMES.into_iter().zip([&*x, &*y, &*z]);
        let figures: Vec<(&str, &[f64])> =
            cloud.u_mm.iter().flat_map(|_| figures.clone()).collect();
        write_ply(&mut bytes, &cloud.points, &figures)
    } else {
        write_csv(&mut bytes, cloud)
    };
    written
        .and_then(|()| std::fs::write(path, bytes))
        .map_err(|error| ScanError::file("write", path, &error))
}

/// Every digit that a number has, so that nothing is lost on the way.
fn write_csv(out: &mut impl Write, cloud: &SensorCloud) -> io::Result<()> {
    write!(out, "x_mm,y_mm,z_mm")?;
    for name in cloud.u_mm.iter().flat_map(|_| U_NAMES) {
        write!(out, ",{name}")?;
    }
    writeln!(out)?;
    for (place, p) in cloud.points.iter().enumerate() {
        write!(out, "{},{},{}", p.x, p.y, p.z)?;
        if let Some([x, y, z]) = cloud.u_mm.as_ref().and_then(|all| all.get(place)) {
            write!(out, ",{x},{y},{z}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}
