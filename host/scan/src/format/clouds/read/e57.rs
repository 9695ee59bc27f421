//! E57 files (ASTM E2807) by the crate `e57`: all clouds of a file, each by its pose, in the file's own coordinates.

use std::io::Cursor;

use e57::{CartesianCoordinate, E57Reader};

use super::foreign::guarded;
use crate::ScanError;
use crate::cloud::ScanCloud;
use crate::rigid::Vec3;

const MM_PER_M: f64 = 1000.0;

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
    for scan in reader.pointclouds() {
        for point in reader.pointcloud_simple(&scan)? {
            match point?.cartesian {
                CartesianCoordinate::Valid { x, y, z } => {
                    cloud.push(Vec3::new(x, y, z) * MM_PER_M);
                }
                CartesianCoordinate::Direction { .. } | CartesianCoordinate::Invalid => {
                    cloud.not_finite += 1;
                }
            }
        }
    }
    Ok(cloud)
}
