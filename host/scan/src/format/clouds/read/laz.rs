//! LAZ files, compressed LAS, by the crate `las`.

use std::io::Cursor;

use las::Reader;

use super::foreign::guarded;
use crate::ScanError;
use crate::cloud::ScanCloud;
use crate::rigid::Vec3;

/// Points that are unpacked at once: a header's word takes no more memory than that.
const AT_ONCE: u64 = 1 << 16;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    guarded("LAZ", || points(bytes).map_err(|error| error.to_string()))
}

fn points(bytes: &[u8]) -> las::Result<ScanCloud> {
    let mut reader = Reader::new(Cursor::new(bytes.to_vec()))?;
    let mut cloud = ScanCloud::default();
    loop {
        let some = reader.read_points(AT_ONCE)?;
        if some.is_empty() {
            return Ok(cloud);
        }
        for ((x, y), z) in some.x().zip(some.y()).zip(some.z()) {
            cloud.push(Vec3::new(x, y, z));
        }
    }
}
