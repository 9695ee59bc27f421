//! Clouds from files, point by point.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::ply_in::PlyReader;
use super::{CloudColumns, CloudPoint, Points};
use crate::ScanError;
use crate::format::table::{Column, TableReader};

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
    Ply(PlyReader<BufReader<File>>),
}

/// The columns of a table.
struct Places {
    at: [Column; 3],
    profile: Option<Column>,
    index: Option<Column>,
    intensity: Option<Column>,
}

impl CloudReader {
    /// Opens a cloud: PLY by its first bytes, else a table with the columns `x_mm,y_mm,z_mm` (or `x,y,z`) and, where it has
    /// them, `profile`, `index`, `intensity`.
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
            let ply = PlyReader::new(input, name)?;
            return Ok(Self {
                columns: ply.columns(),
                not_finite: 0,
                source: Source::Ply(ply),
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
                Source::Ply(ply) => ply.next_point()?,
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
