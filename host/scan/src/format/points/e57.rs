//! E57 with a scan for each profile: points in the sensor's frame, and its pose in the workpiece's.

use std::fs::File;

use e57::Translation;
use e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use umi_kinematics::Pose;

use super::PointSink;
use crate::ScanError;
use crate::format::clouds::write::guid;

const MM_PER_M: f64 = 1000.0;
/// Each scan is an entry of the file's header, which is held in memory.
const MOST: u64 = 20_000;

pub(super) struct E57Profiles {
    file: E57Writer<File>,
    name: String,
    pose: Pose,
    scans: u64,
}

impl E57Profiles {
    pub(super) fn new(out: File, name: String) -> Result<Self, ScanError> {
        let file = E57Writer::new(out, &guid(0)).map_err(|error| failed(&name, error))?;
        Ok(Self {
            file,
            name,
            pose: Pose::identity(),
            scans: 0,
        })
    }
}

impl PointSink for E57Profiles {
    fn pose(&mut self, _: u64, pose: &Pose) -> Result<(), ScanError> {
        self.pose = *pose;
        Ok(())
    }

    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        if points.is_empty() {
            return Ok(());
        }
        self.scans += 1;
        if self.scans > MOST {
            return Err(ScanError::refused(
                "too_many_profiles",
                format_args!(
                    "a scan for each profile: an E57 file of more than {MOST} is not written; leave \
                     --each-profile out, or write --poses beside it"
                ),
            ));
        }
        let Self {
            file, name, pose, ..
        } = self;
        let failed = |error: e57::Error| failed(name, error);
        let prototype = vec![
            Record::CARTESIAN_X_F64,
            Record::CARTESIAN_Y_F64,
            Record::CARTESIAN_Z_F64,
            Record {
                name: RecordName::ColumnIndex,
                data_type: RecordDataType::Integer {
                    min: 0,
                    max: i64::from(u32::MAX),
                },
            },
        ];
        let mut scan = file
            .add_pointcloud(&guid(profile.wrapping_add(1)), prototype)
            .map_err(failed)?;
        scan.set_name(Some(format!("profile {profile}")));
        let turn = Rotation3::from_matrix_unchecked(pose.rotation);
        let turn = UnitQuaternion::from_rotation_matrix(&turn);
        let [x, y, z] = (pose.translation_mm / MM_PER_M).into();
        scan.set_transform(Some(Transform {
            rotation: Quaternion {
                w: turn.w,
                x: turn.i,
                y: turn.j,
                z: turn.k,
            },
            translation: Translation { x, y, z },
        }));
        for (index, at) in points {
            // By the quaternion that stands in the file, so that its reader gets the same point.
            let local = turn.inverse() * (Vector3::from(*at) - pose.translation_mm);
            let mut values: Vec<RecordValue> = local
                .iter()
                .map(|v| RecordValue::Double(v / MM_PER_M))
                .collect();
            values.push(RecordValue::Integer(i64::from(*index)));
            scan.add_point(values).map_err(failed)?;
        }
        scan.finalize().map_err(failed)
    }

    fn finish(&mut self, _: u64) -> Result<(), ScanError> {
        let finished = self.file.finalize();
        finished.map_err(|error| failed(&self.name, error))
    }
}

fn failed(name: &str, error: e57::Error) -> ScanError {
    ScanError::unreadable("file", format_args!("cannot write {name}: {error}"))
}
