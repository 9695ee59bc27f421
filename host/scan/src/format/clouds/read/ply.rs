//! The vertices of a PLY file.

use crate::ScanError;
use crate::cloud::ScanCloud;
use crate::format::ply::PlyReader;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let mut reader = PlyReader::new(bytes)?;
    if reader.bytes_left() > bytes.len() as u64 {
        return Err(ScanError::unreadable(
            "bad_file",
            format_args!(
                "its header states {} points, more than its {} bytes can hold: it is cut short",
                reader.left(),
                bytes.len()
            ),
        ));
    }
    let mut cloud = ScanCloud::default();
    // No more than what the bytes hold, as was just seen.
    cloud.points.reserve_exact(reader.left() as usize);
    while let Some(point) = reader.next_point()? {
        cloud.push(point.at.into());
    }
    Ok(cloud)
}
