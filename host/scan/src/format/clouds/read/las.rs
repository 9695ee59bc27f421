//! LAS files (ASPRS LAS 1.0 to 1.4), not compressed: coordinates are integers with a scale and an offset.

use crate::ScanError;
use crate::cloud::{BesidePoint, ScanCloud};
use crate::format::clouds::LAS_SOFTWARE;
use crate::rigid::Vec3;

/// What every header has.
const HEADER: usize = 227;
const US_PER_S: f64 = 1e6;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let bad = |what: &str| ScanError::unreadable("bad_file", what);
    if bytes.len() < HEADER {
        return Err(bad("it is a LAS file cut short in its header"));
    }
    let two = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let four = |at: usize| u32::from_le_bytes(array(bytes, at)) as usize;
    let number = |at: usize| f64::from_le_bytes(array(bytes, at));
    let (minor, start, format, stride) = (bytes[25], four(96), bytes[104], two(105));
    if format & 0xc0 != 0 {
        #[cfg(feature = "cloud-formats")]
        return super::laz::read(bytes);
        #[cfg(not(feature = "cloud-formats"))]
        return Err(bad(
            "its points are compressed (LAZ), which this build does not read: write it as LAS or PLY",
        ));
    }
    let mut count = four(107) as u64;
    // From 1.4 on a longer header states the number in 64 bits.
    if minor >= 4 && count == 0 && bytes.len() >= 255 {
        count = u64::from_le_bytes(array(bytes, 247));
    }
    let scale: [f64; 3] = std::array::from_fn(|i| number(131 + 8 * i));
    let offset: [f64; 3] = std::array::from_fn(|i| number(155 + 8 * i));
    let body = bytes.get(start..).unwrap_or_default();
    let needed = count.checked_mul(stride as u64);
    if stride < 20 || start < HEADER || needed.is_none_or(|needed| needed > body.len() as u64) {
        return Err(ScanError::unreadable(
            "bad_file",
            format_args!(
                "the header states {count} points of {stride} bytes, the file has {} for them: it is cut short or damaged",
                body.len()
            ),
        ));
    }
    // Where a record of this format has its time, in seconds.
    let time_at = match format {
        1 | 3 | 4 | 5 => Some(20),
        6..=10 => Some(22),
        _ => None,
    };
    let time_at = time_at.filter(|at| at + 8 <= stride);
    let t_us =
        |record: &[u8]| time_at.map_or(0.0, |at| f64::from_le_bytes(array(record, at)) * US_PER_S);
    let bright = |record: &[u8]| u16::from_le_bytes(array(record, 12));
    // Our own files have records of the old formats alone.
    let is_ours = format < 6 && software(bytes) == LAS_SOFTWARE.as_bytes();
    let synthetic = |record: &[u8]| is_ours && record[15] & 0b0010_0000 != 0;
    let records = || body.chunks_exact(stride).take(count as usize);
    let mut cloud = ScanCloud::default();
    // Every point has a place for it; where it is 0 in all of them, nobody has measured it.
    cloud.columns.intensity = records().any(|record| bright(record) > 0);
    cloud.columns.time = records().any(|record| t_us(record) != 0.0);
    cloud.columns.interpolated = records().any(synthetic);
    cloud.points.reserve_exact(count as usize);
    for record in records() {
        let [x, y, z] = std::array::from_fn(|i| {
            f64::from(i32::from_le_bytes(array(record, 4 * i))) * scale[i] + offset[i]
        });
        let beside = BesidePoint {
            t_us: t_us(record),
            intensity: f64::from(bright(record)),
            interpolated: synthetic(record),
            ..BesidePoint::default()
        };
        cloud.push_with(Vec3::new(x, y, z), beside);
    }
    Ok(cloud)
}

/// Who made the file, up to the zeros that fill its place.
fn software(bytes: &[u8]) -> &[u8] {
    let place = bytes.get(58..90).unwrap_or_default();
    let end = place.iter().position(|&byte| byte == 0);
    &place[..end.unwrap_or(place.len())]
}

/// The bytes from `at` on, which are there.
fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[at + i])
}
