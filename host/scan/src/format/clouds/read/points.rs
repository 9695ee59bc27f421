//! Clouds from files, point by point.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::whole::{is_whole, read_cloud};
use crate::ScanError;
use crate::cloud::{CloudColumns, CloudPoint, Points};
use crate::format::ply::PlyReader;
use crate::format::table::{Column, TableReader};
use crate::rigid::Vec3;

/// A cloud that is read from its beginning to its end.
pub struct CloudReader {
    /// What it says of its points beside their coordinates.
    pub columns: CloudColumns,
    /// Points that are not finite numbers; they are not handed out.
    pub not_finite: u64,
    source: Source,
}

enum Source {
    Table(Box<TableReader<BufReader<File>>>, Places),
    /// The reader, and the file's name for what it says.
    Ply(PlyReader<BufReader<File>>, String),
    /// Points of a format that is read at once.
    Whole(std::vec::IntoIter<Vec3>),
}

/// The columns of a table.
struct Places {
    at: [Column; 3],
    profile: Option<Column>,
    index: Option<Column>,
    intensity: Option<Column>,
}

impl CloudReader {
    /// Opens a cloud: PLY, PCD, LAS, LAZ or E57 by its first bytes, else a table with the columns `x_mm,y_mm,z_mm` (or `x,y,z`) and,
    /// where it has them, `profile`, `index`, `intensity`.
    ///
    /// PLY and tables are read point by point, in constant memory; of the others all coordinates are held, and only they.
    ///
    /// # Errors
    /// `file`, `bad_file` for a PLY header, `missing_column` and `corrupt` for a table's first line.
    pub fn open(path: &Path) -> Result<Self, ScanError> {
        let file = File::open(path).map_err(|error| ScanError::file("read", path, &error))?;
        let mut input = BufReader::with_capacity(1 << 18, file);
        let begin = input
            .fill_buf()
            .map_err(|error| ScanError::file("read", path, &error))?;
        let name = path.display().to_string();
        if begin.starts_with(b"ply") {
            let ply = PlyReader::new(input).map_err(|refusal| named(refusal, &name))?;
            return Ok(Self {
                columns: ply.columns(),
                not_finite: 0,
                source: Source::Ply(ply, name),
            });
        }
        if is_whole(begin) {
            let cloud = read_cloud(path)?;
            return Ok(Self {
                columns: CloudColumns::default(),
                not_finite: cloud.not_finite as u64,
                source: Source::Whole(cloud.points.into_iter()),
            });
        }
        let table = TableReader::new(input, name)?;
        let axis = |long: &str, short: &str| match table.optional(long) {
            Some(column) => Ok(column),
            None => table.optional(short).map_or_else(|| table.column(long), Ok),
        };
        let places = Places {
            at: [axis("x_mm", "x")?, axis("y_mm", "y")?, axis("z_mm", "z")?],
            profile: table.optional("profile"),
            index: table.optional("index"),
            intensity: table.optional("intensity"),
        };
        Ok(Self {
            columns: CloudColumns {
                profile: places.profile.is_some(),
                index: places.index.is_some(),
                intensity: places.intensity.is_some(),
            },
            not_finite: 0,
            source: Source::Table(Box::new(table), places),
        })
    }

    /// All points from here on.
    pub fn points(&mut self) -> Points<'_> {
        Box::new(std::iter::from_fn(|| self.next_point().transpose()))
    }

    /// The next finite point.
    ///
    /// # Errors
    /// `corrupt`, `truncated` or `bad_file` with what is wrong and where.
    pub fn next_point(&mut self) -> Result<Option<CloudPoint>, ScanError> {
        loop {
            let point = match &mut self.source {
                Source::Ply(ply, name) => {
                    ply.next_point().map_err(|refusal| named(refusal, name))?
                }
                Source::Whole(points) => points.next().map(|p| CloudPoint {
                    at: p.into(),
                    profile: 0,
                    index: 0,
                    intensity: 0.0,
                }),
                Source::Table(table, places) => match table.next_row()? {
                    None => None,
                    Some(row) => {
                        let [x, y, z] = places.at;
                        Some(CloudPoint {
                            at: [row.number(x)?, row.number(y)?, row.number(z)?],
                            profile: places.profile.map_or(Ok(0), |c| row.integer(c))?,
                            index: places.index.map_or(Ok(0), |c| row.integer(c))?,
                            intensity: places.intensity.map_or(Ok(0.0), |c| row.number(c))?,
                        })
                    }
                },
            };
            let Some(point) = point else { return Ok(None) };
            if point.at.iter().all(|x| x.is_finite()) {
                return Ok(Some(point));
            }
            self.not_finite += 1;
        }
    }
}

fn named(refusal: ScanError, name: &str) -> ScanError {
    ScanError {
        message: format!("{name}: {}", refusal.message),
        ..refusal
    }
}
