//! Numbers in columns: CSV with `x,y,z`, or the same parted by semicolons, tabs or blanks, with names or without.

use std::io::BufRead;

use crate::ScanError;
use crate::cloud::{BesidePoint, CloudColumns, ScanCloud};
use crate::format::table::{Column, TableReader};
use crate::rigid::Vec3;

/// The points of a table, one after the other.
pub(super) struct TablePoints<R> {
    table: TableReader<R>,
    at: [Column; 3],
    profile: Option<Column>,
    index: Option<Column>,
    time: Option<Column>,
    intensity: Option<Column>,
    mount_u: Option<Column>,
    interpolated: Option<Column>,
}

impl<R: BufRead> TablePoints<R> {
    /// Reads the names of the columns: `x`, `Y` and `"z_mm"` are meant.
    pub fn new(input: R, name: String) -> Result<Self, ScanError> {
        let table = TableReader::of_points(input, name)?;
        let axis = |axis: &'static str| {
            let long = format!("{axis}_mm");
            let found = table.optional(&long).or_else(|| {
                table.found(|name| {
                    name.eq_ignore_ascii_case(axis) || name.eq_ignore_ascii_case(&long)
                })
            });
            found.map_or_else(|| table.column(&long), Ok)
        };
        Ok(Self {
            at: [axis("x")?, axis("y")?, axis("z")?],
            profile: table.optional("profile"),
            index: table.optional("index"),
            time: table.optional("t_us"),
            intensity: table.optional("intensity"),
            mount_u: table.optional("mount_u_mm"),
            interpolated: table.optional("interpolated"),
            table,
        })
    }

    /// What it says of its points beside their coordinates.
    pub const fn columns(&self) -> CloudColumns {
        CloudColumns {
            profile: self.profile.is_some(),
            index: self.index.is_some(),
            time: self.time.is_some(),
            intensity: self.intensity.is_some(),
            mount_u: self.mount_u.is_some(),
            interpolated: self.interpolated.is_some(),
        }
    }

    /// The next point, finite or not.
    pub fn next_point(&mut self) -> Result<Option<(Vec3, BesidePoint)>, ScanError> {
        let Some(row) = self.table.next_row()? else {
            return Ok(None);
        };
        let [x, y, z] = self.at;
        let at = Vec3::new(row.number(x)?, row.number(y)?, row.number(z)?);
        let beside = BesidePoint {
            profile: self.profile.map_or(Ok(0), |c| row.integer(c))?,
            index: self.index.map_or(Ok(0), |c| row.integer(c))?,
            t_us: self.time.map_or(Ok(0.0), |c| row.number(c))?,
            intensity: self.intensity.map_or(Ok(0.0), |c| row.number(c))?,
            mount_u_mm: self.mount_u.map_or(Ok(0.0), |c| row.number(c))?,
            interpolated: self.interpolated.map_or(Ok(0.0), |c| row.number(c))? != 0.0,
        };
        Ok(Some((at, beside)))
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let bad = |refusal: ScanError| ScanError {
        // A cut has a name of its own.
        code: if refusal.code == "truncated" {
            "truncated"
        } else {
            "bad_file"
        },
        ..refusal
    };
    let name = "neither PLY, PCD, LAS, LAZ, E57 nor STL, and as a table".to_owned();
    let mut points = TablePoints::new(bytes, name).map_err(bad)?;
    let mut cloud = ScanCloud::default();
    while let Some((at, _)) = points.next_point().map_err(bad)? {
        cloud.push(at);
    }
    Ok(cloud)
}
