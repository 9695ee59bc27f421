//! LAZ files, compressed LAS, by the crate `las`.

use std::io::Cursor;

use las::Reader;

use super::foreign::guarded;
use crate::ScanError;
use crate::cloud::{BesidePoint, ScanCloud};
use crate::rigid::Vec3;

/// Points that are unpacked at once: a header's word takes no more memory than that.
const AT_ONCE: u64 = 1 << 16;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    guarded("LAZ", || points(bytes).map_err(|error| error.to_string()))
}

fn points(bytes: &[u8]) -> las::Result<ScanCloud> {
    let mut reader = Reader::new(Cursor::new(bytes.to_vec()))?;
    let mut cloud = ScanCloud::default();
    cloud.columns.intensity = true;
    loop {
        let some = reader.read_points(AT_ONCE)?;
        if some.is_empty() {
            // Every point has a place for it; where it is 0 in all of them, nobody has measured it.
            if cloud.beside.iter().all(|beside| beside.intensity == 0.0) {
                cloud.columns.intensity = false;
                cloud.beside = Vec::new();
            }
            return Ok(cloud);
        }
        let at = some.x().zip(some.y()).zip(some.z());
        for (((x, y), z), bright) in at.zip(some.intensity()) {
            let beside = BesidePoint {
                intensity: f64::from(bright),
                ..BesidePoint::default()
            };
            cloud.push_with(Vec3::new(x, y, z), beside);
        }
    }
}
