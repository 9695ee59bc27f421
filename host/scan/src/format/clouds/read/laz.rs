//! LAZ files, compressed LAS, by the crate `las`.

use std::io::Cursor;

use las::Reader;

use super::foreign::guarded;
use crate::ScanError;
use crate::cloud::{BesidePoint, CloudColumns, ScanCloud};
use crate::format::clouds::LAS_SOFTWARE;
use crate::rigid::Vec3;

const US_PER_S: f64 = 1e6;
/// Points that are unpacked at once: a header's word takes no more memory than that.
const AT_ONCE: u64 = 1 << 16;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    guarded("LAZ", || points(bytes).map_err(|error| error.to_string()))
}

fn points(bytes: &[u8]) -> las::Result<ScanCloud> {
    let mut reader = Reader::new(Cursor::new(bytes.to_vec()))?;
    let mut cloud = ScanCloud::default();
    cloud.columns.intensity = true;
    cloud.columns.time = reader.header().point_format().has_gps_time;
    cloud.columns.interpolated = true;
    let is_ours = reader.header().generating_software() == LAS_SOFTWARE;
    loop {
        let some = reader.read_points(AT_ONCE)?;
        if some.is_empty() {
            // Every point has a place for it; where it is 0 in all of them, nobody has measured it.
            cloud.columns.intensity = cloud.beside.iter().any(|beside| beside.intensity != 0.0);
            cloud.columns.time = cloud.beside.iter().any(|beside| beside.t_us != 0.0);
            cloud.columns.interpolated = cloud.beside.iter().any(|beside| beside.interpolated);
            if cloud.columns == CloudColumns::default() {
                cloud.beside = Vec::new();
            }
            return Ok(cloud);
        }
        let mut times = some.gps_time();
        let at = some.x().zip(some.y()).zip(some.z());
        let mut synthetic = is_ours.then(|| some.points());
        for (((x, y), z), bright) in at.zip(some.intensity()) {
            let interpolated = match synthetic.as_mut().and_then(Iterator::next) {
                Some(point) => point?.is_synthetic,
                None => false,
            };
            let beside = BesidePoint {
                t_us: times.as_mut().and_then(Iterator::next).unwrap_or(0.0) * US_PER_S,
                intensity: f64::from(bright),
                interpolated,
                ..BesidePoint::default()
            };
            cloud.push_with(Vec3::new(x, y, z), beside);
        }
    }
}
