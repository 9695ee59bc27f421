//! Where the sensor was at each profile: `profile,x_mm,y_mm,z_mm,r11,r12,r13,r21,r22,r23,r31,r32,r33`,
//! the origin of its frame and the rows of its rotation, in the frame of the cloud.

use std::collections::HashMap;
use std::io::{BufRead, BufWriter, Write};
use std::path::Path;

use umi_kinematics::Pose;

use super::partial::Partial;
use super::table::TableReader;
use crate::ScanError;

const COLUMNS: [&str; 12] = [
    "x_mm", "y_mm", "z_mm", "r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33",
];

/// A table of poses that is being written.
pub struct PoseFile {
    // Closed before the partial file is taken away.
    out: BufWriter<std::fs::File>,
    partial: Partial,
}

impl PoseFile {
    /// Begins a table.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create(path: &Path) -> Result<Self, ScanError> {
        let partial = Partial::new(path);
        let mut out = BufWriter::new(partial.begin()?);
        writeln!(out, "profile,{}", COLUMNS.join(",")).map_err(|error| partial.failed(&error))?;
        Ok(Self { out, partial })
    }

    /// The pose of one more profile.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn pose(&mut self, profile: u64, pose: &Pose) -> Result<(), ScanError> {
        let [x, y, z] = pose.translation_mm.into();
        let write = |out: &mut BufWriter<_>| {
            write!(out, "{profile},{x},{y},{z}")?;
            for value in pose.rows().as_flattened() {
                write!(out, ",{value}")?;
            }
            writeln!(out)
        };
        write(&mut self.out).map_err(|error| self.partial.failed(&error))
    }

    /// There are no more.
    ///
    /// # Errors
    /// The end cannot be written.
    pub fn finish(&mut self) -> Result<(), ScanError> {
        let flushed = self.out.flush();
        flushed.map_err(|error| self.partial.failed(&error))?;
        self.partial.complete()
    }
}

/// Reads the poses of all profiles.
///
/// # Errors
/// `corrupt` where a profile comes twice or a pose is none, `not_finite`, or the table's own.
pub fn read<R: BufRead>(mut table: TableReader<R>) -> Result<HashMap<u64, Pose>, ScanError> {
    let profile = table.column("profile")?;
    let mut columns = Vec::with_capacity(COLUMNS.len());
    for name in COLUMNS {
        columns.push(table.column(name)?);
    }
    let mut poses = HashMap::new();
    while let Some(row) = table.next_row()? {
        let mut v = [0.0; 12];
        for (value, column) in v.iter_mut().zip(&columns) {
            *value = row.finite(*column)?;
        }
        let rows = [[v[3], v[4], v[5]], [v[6], v[7], v[8]], [v[9], v[10], v[11]]];
        let Ok(pose) = Pose::from_rows(&rows, &[v[0], v[1], v[2]]) else {
            return Err(row.wrong(columns[3], "a rotation from r11 to r33"));
        };
        if poses.insert(row.integer(profile)?, pose).is_some() {
            return Err(row.wrong(profile, "one pose for each profile"));
        }
    }
    Ok(poses)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn poses_come_back_to_the_last_bit() {
        let path = std::env::temp_dir().join(format!("umi-poses-{}.csv", std::process::id()));
        let pose = |i: u64| {
            let axis = Vector3::new(0.6, 0.0, 0.8);
            let point = Vector3::new(1.0, 2.0, 3.0);
            Pose::turn(&axis, &point, 0.1 + i as f64)
        };
        let mut file = PoseFile::create(&path).unwrap();
        for i in 0..5 {
            file.pose(2 * i, &pose(i)).unwrap();
        }
        file.finish().unwrap();
        let back = read(TableReader::open(&path).unwrap()).unwrap();
        assert_eq!(back.len(), 5);
        assert!((0..5).all(|i| back[&(2 * i)] == pose(i)));
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let code = |text: String| {
            let table = TableReader::new(text.as_bytes(), "p".into()).unwrap();
            read(table).unwrap_err().code
        };
        let row = text.lines().nth(1).unwrap();
        assert_eq!(code(format!("{text}{row}\n")), "corrupt");
        let head = text.lines().next().unwrap();
        assert_eq!(
            code(format!("{head}\n0,0,0,0,1,0,0,0,1,0,0,0,-1\n")),
            "corrupt"
        );
        assert_eq!(
            code(format!("{head}\n0,0,0,nan,1,0,0,0,1,0,0,0,1\n")),
            "not_finite"
        );
    }
}
