//! E57 (ASTM E2807) by the crate `e57`: coordinates as doubles in metres, profiles as rows, places in them as columns, times
//! in seconds.

use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};

use super::CloudStyle;
use super::counted::Counted;
use crate::ScanError;
use crate::format::partial::Partial;

const MM_PER_M: f64 = 1000.0;
const S_PER_US: f64 = 1e-6;

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    let refused = |error: e57::Error| partial.refused(error);
    let columns = style.columns;
    let whole = |name: RecordName| Record {
        name,
        data_type: RecordDataType::Integer {
            min: 0,
            max: i64::from(u32::MAX),
        },
    };
    let mut prototype = vec![
        Record::CARTESIAN_X_F64,
        Record::CARTESIAN_Y_F64,
        Record::CARTESIAN_Z_F64,
    ];
    if columns.profile {
        prototype.push(whole(RecordName::RowIndex));
    }
    if columns.index {
        prototype.push(whole(RecordName::ColumnIndex));
    }
    if columns.time {
        prototype.push(Record {
            name: RecordName::TimeStamp,
            data_type: RecordDataType::F64,
        });
    }
    if columns.intensity {
        prototype.push(Record {
            name: RecordName::Intensity,
            data_type: RecordDataType::F32,
        });
    }
    let mut file = E57Writer::new(partial.begin()?, &guid(0)).map_err(refused)?;
    let mut cloud = file.add_pointcloud(&guid(1), prototype).map_err(refused)?;
    cloud.set_name(Some("scan".into()));
    while let Some(p) = points.next_point()? {
        let mut values = Vec::with_capacity(7);
        values.extend(p.at.map(|v| RecordValue::Double(v / MM_PER_M)));
        if columns.profile {
            if p.profile > u64::from(u32::MAX) {
                return Err(partial.refused("a profile's number is beyond 32 bits"));
            }
            values.push(RecordValue::Integer(p.profile as i64));
        }
        if columns.index {
            values.push(RecordValue::Integer(i64::from(p.index)));
        }
        if columns.time {
            values.push(RecordValue::Double(p.t_us * S_PER_US));
        }
        if columns.intensity {
            values.push(RecordValue::Single(p.intensity as f32));
        }
        cloud.add_point(values).map_err(refused)?;
    }
    cloud.finalize().map_err(refused)?;
    file.finalize().map_err(refused)
}

/// A name that no other file has, by the clock (a UUID's form, version 8: of its maker's own making).
pub(crate) fn guid(part: u64) -> String {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let now = since.map_or(0, |d| d.as_nanos()) as u64;
    let process = u64::from(std::process::id());
    format!(
        "{{{:08X}-{:04X}-8{:03X}-A{:03X}-{:012X}}}",
        now >> 32,
        (now >> 16) & 0xFFFF,
        now & 0xFFF,
        (part >> 32) & 0xFFF,
        (part << 16 | process & 0xFFFF) & 0xFFFF_FFFF_FFFF
    )
}
