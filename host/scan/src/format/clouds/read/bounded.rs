//! A cloud of any size, in bounded memory: what does not fit is thinned while it is read, and nothing is put on disk.

use std::collections::HashSet;
use std::hash::BuildHasherDefault;
use std::io::Read as _;
use std::path::Path;

use super::{CloudReader, read_cloud};
use crate::ScanError;
use crate::cloud::{CubeHasher, ScanCloud};
use crate::rigid::Vec3;

/// Points that were read, and what was kept of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundedCloud {
    /// The points that were kept, in the order of the file.
    pub cloud: ScanCloud,
    /// All finite points of the file.
    pub read: usize,
    /// The edge of the cubes of which one point each was kept, in the unit of the file; none if all were.
    pub cell: Option<f64>,
}

/// The first cubes are this share of the size of what was read so far; later ones hold eight of the former each.
const FIRST: f64 = 1.0 / 4000.0;
const WIDER: f64 = 2.0;

/// The points of a file, as [`read_cloud`] reads them, but `most` at most: of more, the first point of each cube is kept,
/// of cubes as small as `most` allows. PLY is read point by point; a file of another format must not be larger than
/// `most_bytes`.
///
/// # Errors
/// As [`read_cloud`]; `too_large` for a file that is not read point by point.
pub fn read_bounded(path: &Path, most: usize, most_bytes: u64) -> Result<BoundedCloud, ScanError> {
    let trouble = |error| ScanError::file("read", path, &error);
    let mut begin = [0; 3];
    let mut file = std::fs::File::open(path).map_err(|error| {
        ScanError::unreadable(
            "bad_file",
            format_args!("{}: cannot be read: {error}", path.display()),
        )
    })?;
    let size = file.metadata().map_err(trouble)?.len();
    let is_ply = file.read_exact(&mut begin).is_ok() && &begin == b"ply";
    drop(file);
    // What a file of this size can hold at most is far less than what may be kept.
    if !is_ply || size / 3 <= most as u64 {
        if size > most_bytes {
            return Err(ScanError::unreadable(
                "too_large",
                format_args!(
                    "{}: {} MB are more than the memory that may be used; write it as PLY, which is read point by point, or give more by --memory-mb",
                    path.display(),
                    size / 1_000_000
                ),
            ));
        }
        let cloud = read_cloud(path)?;
        let (not_finite, states_unit, unit_mm) =
            (cloud.not_finite, cloud.states_unit, cloud.unit_mm);
        let mut kept = Kept::new(most);
        for point in cloud.points {
            kept.take(point);
        }
        let mut bounded = kept.done(not_finite);
        (bounded.cloud.states_unit, bounded.cloud.unit_mm) = (states_unit, unit_mm);
        return Ok(bounded);
    }
    let mut reader = CloudReader::open(path)?;
    let mut kept = Kept::new(most);
    while let Some(point) = reader.next_point()? {
        kept.take(Vec3::from(point.at));
    }
    Ok(kept.done(reader.not_finite as usize))
}

struct Kept {
    most: usize,
    points: Vec<Vec3>,
    read: usize,
    cell: Option<f64>,
    taken: HashSet<[i32; 3], BuildHasherDefault<CubeHasher>>,
}

impl Kept {
    fn new(most: usize) -> Self {
        Self {
            most: most.max(1000),
            points: Vec::new(),
            read: 0,
            cell: None,
            taken: HashSet::default(),
        }
    }

    fn take(&mut self, point: Vec3) {
        self.read += 1;
        if let Some(cell) = self.cell
            && !self.taken.insert(self.cube(&point, cell))
        {
            return;
        }
        self.points.push(point);
        while self.points.len() > self.most {
            let next = self.cell.map_or_else(
                || {
                    let (low, high) = crate::surface::bounds(self.points.iter());
                    (high - low).norm() * FIRST
                },
                |cell| cell * WIDER,
            );
            self.thin(next.max(f64::MIN_POSITIVE));
        }
    }

    /// One point of each cube; cubes far outside of what an `i32` counts are one.
    fn thin(&mut self, cell: f64) {
        self.cell = Some(cell);
        self.taken.clear();
        let origin = self.points.first().copied().unwrap_or_default();
        let taken = &mut self.taken;
        self.points.retain(|p| taken.insert(key(p, &origin, cell)));
    }

    fn cube(&self, point: &Vec3, cell: f64) -> [i32; 3] {
        key(point, self.points.first().unwrap_or(point), cell)
    }

    fn done(self, not_finite: usize) -> BoundedCloud {
        BoundedCloud {
            read: self.read,
            cell: self.cell,
            cloud: ScanCloud {
                points: self.points,
                not_finite,
                ..ScanCloud::default()
            },
        }
    }
}

fn key(point: &Vec3, origin: &Vec3, cell: f64) -> [i32; 3] {
    let at = (point - origin) / cell;
    [at.x, at.y, at.z].map(|x| x.floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(count: usize) -> String {
        let head = format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        );
        let points = (0..count).map(|i| format!("{} {} 0\n", i % 100, i / 100));
        head + &points.collect::<String>()
    }

    #[test]
    fn what_fits_is_kept_whole_and_what_does_not_is_thinned_evenly() {
        let folder = std::env::temp_dir().join(format!("umi-bounded-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("cloud.ply");
        std::fs::write(&path, line(10_000)).unwrap();
        let whole = read_bounded(&path, 10_000, 1 << 30).unwrap();
        assert_eq!((whole.read, whole.cell), (10_000, None));
        assert_eq!(whole.cloud, read_cloud(&path).unwrap());
        let few = read_bounded(&path, 2000, 1 << 30).unwrap();
        let cell = few.cell.unwrap();
        assert!((300..=2000).contains(&few.cloud.points.len()));
        assert_eq!(few.read, 10_000);
        // Every point has a kept one in its cube, and no two share one.
        let origin = few.cloud.points[0];
        let cubes: HashSet<_> = few
            .cloud
            .points
            .iter()
            .map(|p| key(p, &origin, cell))
            .collect();
        assert_eq!(cubes.len(), few.cloud.points.len());
        assert!(
            whole
                .cloud
                .points
                .iter()
                .all(|p| cubes.contains(&key(p, &origin, cell)))
        );
        // A table is read at once: it must fit.
        let table = folder.join("cloud.csv");
        std::fs::write(&table, "x,y,z\n1,2,3\n").unwrap();
        assert_eq!(read_bounded(&table, 2000, 4).unwrap_err().code, "too_large");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
