//! Readings of a point sensor to points.

use std::io::{self, Write};
use std::path::Path;

use umi_core::units::{Mm, Point};

use super::calibration::{KnownSensor, OffsetAndDirection};
use super::readings::SensorReadings;
use crate::ScanError;
use crate::format::clouds::write_ply;
use crate::rigid::Vec3;

/// Points with what the calibration leaves uncertain of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorCloud {
    /// The points, mm.
    pub points: Vec<Vec3>,
    /// Standard uncertainties of x, y and z for each point, mm, if the calibration has a
    /// covariance. The readings' own noise is not in them.
    pub u_mm: Option<Vec<[f64; 3]>>,
}

/// Makes the points of readings; `covariance` is that of offset and direction.
#[must_use]
pub fn points(
    readings: &SensorReadings,
    known: &KnownSensor,
    covariance: Option<&OffsetAndDirection>,
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

/// Writes a cloud: PLY if the file is called so, else CSV.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, cloud: &SensorCloud) -> Result<(), ScanError> {
    let ply = path
        .extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("ply"));
    let mut bytes = Vec::new();
    let written = if ply {
        write_ply(&mut bytes, &cloud.points, None)
    } else {
        write_csv(&mut bytes, cloud)
    };
    written
        .and_then(|()| std::fs::write(path, bytes))
        .map_err(|error| ScanError::file("write", path, &error))
}

/// Every digit that a number has, so that nothing is lost on the way.
fn write_csv(out: &mut impl Write, cloud: &SensorCloud) -> io::Result<()> {
    let more = if cloud.u_mm.is_some() {
        ",u_x_mm,u_y_mm,u_z_mm"
    } else {
        ""
    };
    writeln!(out, "x_mm,y_mm,z_mm{more}")?;
    for (place, p) in cloud.points.iter().enumerate() {
        write!(out, "{},{},{}", p.x, p.y, p.z)?;
        if let Some([x, y, z]) = cloud.u_mm.as_ref().and_then(|all| all.get(place)) {
            write!(out, ",{x},{y},{z}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}
