//! Clouds from files, point by point.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::table::TablePoints;
use super::whole::{is_named_stl, is_whole, read_cloud};
use crate::ScanError;
use crate::cloud::{BesidePoint, CloudColumns, CloudPoint, Points, ScanCloud};
use crate::format::ply::PlyReader;
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
    Table(Box<TablePoints<BufReader<File>>>),
    /// The reader, and the file's name for what it says.
    Ply(PlyReader<BufReader<File>>, String),
    /// Points of a format that is read at once, and how many are handed out.
    Whole(ScanCloud, usize),
}

impl CloudReader {
    /// Opens a cloud: PLY, PCD, LAS, LAZ or E57 by its first bytes, else a table with the columns `x_mm,y_mm,z_mm` (or `x,y,z`, or
    /// with a unit as `X [inch]`: the points are in mm then) and, where it has them, `profile`, `index`, `t_us`, `intensity`, `mount_u_mm`, `interpolated`; or one of numbers alone.
    ///
    /// PLY and tables are read point by point, in constant memory; of the others all points are held.
    ///
    /// # Errors
    /// `file`, `bad_file` for a PLY header, `missing_column` and `corrupt` for a table's first line.
    pub fn open(path: &Path) -> Result<Self, ScanError> {
        let file = File::open(path).map_err(|error| ScanError::file("read", path, &error))?;
        let bytes = file
            .metadata()
            .map_err(|error| ScanError::file("read", path, &error))?
            .len();
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
        if is_whole(begin, bytes) || is_named_stl(path) {
            let cloud = read_cloud(path)?;
            return Ok(Self {
                columns: cloud.columns,
                not_finite: cloud.not_finite as u64,
                source: Source::Whole(cloud, 0),
            });
        }
        let table = TablePoints::new(input, name)?;
        Ok(Self {
            columns: table.columns(),
            not_finite: 0,
            source: Source::Table(Box::new(table)),
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
                Source::Whole(cloud, next) => {
                    let at = cloud.points.get(*next).copied();
                    let beside = cloud.beside.get(*next).copied().unwrap_or_default();
                    *next += 1;
                    at.map(|at| point(at, beside))
                }
                Source::Table(table) => table.next_point()?.map(|(at, beside)| point(at, beside)),
            };
            let Some(point) = point else { return Ok(None) };
            if point.at.iter().all(|x| x.is_finite()) {
                return Ok(Some(point));
            }
            self.not_finite += 1;
        }
    }
}

fn point(at: Vec3, beside: BesidePoint) -> CloudPoint {
    CloudPoint {
        at: at.into(),
        profile: beside.profile,
        index: beside.index,
        t_us: beside.t_us,
        intensity: beside.intensity,
        mount_u_mm: beside.mount_u_mm,
        interpolated: beside.interpolated,
    }
}

fn named(refusal: ScanError, name: &str) -> ScanError {
    ScanError {
        message: format!("{name}: {}", refusal.message),
        ..refusal
    }
}
