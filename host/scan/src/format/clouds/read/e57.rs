//! E57 files (ASTM E2807) by the crate `e57`: all clouds of a file, each by its pose, in the file's own coordinates.

use std::io::Cursor;

use e57::{CartesianCoordinate, E57Reader, PointCloud, RecordName, RecordValue};

use super::foreign::guarded;
use crate::ScanError;
use crate::cloud::{BesidePoint, CloudColumns, ScanCloud};
use crate::rigid::Vec3;

const MM_PER_M: f64 = 1000.0;
const US_PER_S: f64 = 1e6;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    guarded("E57", || points(bytes).map_err(|error| error.to_string()))
}

fn points(bytes: &[u8]) -> e57::Result<ScanCloud> {
    // Its pages carry check sums: what is damaged is not read.
    E57Reader::validate_crc(Cursor::new(bytes))?;
    let mut reader = E57Reader::new(Cursor::new(bytes))?;
    let mut cloud = ScanCloud {
        states_unit: true,
        ..ScanCloud::default()
    };
    let scans = reader.pointclouds();
    // A column is one of the cloud if all scans of the file have it.
    let all = |name: RecordName| {
        let has = |scan: &PointCloud| scan.prototype.iter().any(|record| record.name == name);
        !scans.is_empty() && scans.iter().all(has)
    };
    cloud.columns = CloudColumns {
        profile: all(RecordName::RowIndex)
            || !scans.is_empty() && scans.iter().all(|scan| of_name(scan).is_some()),
        index: all(RecordName::ColumnIndex),
        time: all(RecordName::TimeStamp),
        intensity: all(RecordName::Intensity),
        mount_u: false,
        interpolated: false,
    };
    for scan in scans {
        let of_name = of_name(&scan);
        let times_us = if cloud.columns.time {
            times_us(&mut reader, &scan)?
        } else {
            Vec::new()
        };
        let mut points = reader.pointcloud_simple(&scan)?;
        points.normalize_intensity(false);
        for (place, point) in points.enumerate() {
            let point = point?;
            let beside = BesidePoint {
                profile: of_name
                    .or_else(|| u64::try_from(point.row).ok())
                    .unwrap_or(0),
                index: u32::try_from(point.column).unwrap_or(0),
                t_us: times_us.get(place).copied().unwrap_or(0.0),
                intensity: f64::from(point.intensity.unwrap_or(0.0)),
                mount_u_mm: 0.0,
                interpolated: false,
            };
            match point.cartesian {
                CartesianCoordinate::Valid { x, y, z } => {
                    cloud.push_with(Vec3::new(x, y, z) * MM_PER_M, beside);
                }
                CartesianCoordinate::Direction { .. } | CartesianCoordinate::Invalid => {
                    cloud.not_finite += 1;
                }
            }
        }
    }
    Ok(cloud)
}

/// The times of a scan's points, which the crate's simple points do not have.
fn times_us(reader: &mut E57Reader<Cursor<&[u8]>>, scan: &PointCloud) -> e57::Result<Vec<f64>> {
    let records = scan.prototype.iter();
    let Some(place) = records
        .map(|record| &record.name)
        .position(|name| *name == RecordName::TimeStamp)
    else {
        return Ok(Vec::new());
    };
    let kind = &scan.prototype[place].data_type;
    let seconds = |values: Vec<RecordValue>| values.get(place).map(|value| value.to_f64(kind));
    let mut times_us = Vec::new();
    for point in reader.pointcloud_raw(scan)? {
        times_us.push(seconds(point?).transpose()?.unwrap_or(0.0) * US_PER_S);
    }
    Ok(times_us)
}

/// The number of a profile that has a scan of its own, by the scan's name, as `umi scan merge --each-profile` writes it.
fn of_name(scan: &PointCloud) -> Option<u64> {
    scan.name.as_deref()?.strip_prefix("profile ")?.parse().ok()
}
