//! Points of a scan: all at once ([`ScanCloud`]), or one after the other ([`Points`]).

mod cube;
pub(crate) mod curve;
pub(crate) mod oriented;
pub mod tree;

pub(crate) use cube::CubeHasher;

use crate::ScanError;
use crate::rigid::Vec3;

/// The points of a scan, all finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScanCloud {
    /// The points in mm, in the order of the file.
    pub points: Vec<Vec3>,
    /// How many points of the file were not finite numbers; they are not among the points.
    pub not_finite: usize,
    /// The file states the unit, and they are in mm by it.
    pub states_unit: bool,
    /// That unit in mm, where the file's own words say it and not its format.
    pub unit_mm: Option<f64>,
    /// What the file says beside the coordinates.
    pub columns: CloudColumns,
    /// That of each point, where the file says any of it.
    pub beside: Vec<BesidePoint>,
}

/// What a file says of a point beside its coordinates; 0 where it does not say.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BesidePoint {
    /// The profile it is of.
    pub profile: u64,
    /// Its place in the sensor's array.
    pub index: u32,
    /// When the sensor saw it, in microseconds of the board's clock.
    pub t_us: f64,
    /// How bright it was, in the sensor's own measure.
    pub intensity: f64,
    /// Its standard uncertainty by that of the sensor's mount, in mm.
    pub mount_u_mm: f64,
    /// Its profile had no latch: it was placed between two others.
    pub interpolated: bool,
}

impl ScanCloud {
    /// Takes a point with what the file says of it, or counts it if it is not finite.
    pub(crate) fn push_with(&mut self, point: Vec3, beside: BesidePoint) {
        let before = self.points.len();
        self.push(point);
        if self.points.len() > before && self.columns != CloudColumns::default() {
            self.beside.push(beside);
        }
    }

    /// Takes a point, or counts it if it is not finite.
    pub(crate) fn push(&mut self, point: Vec3) {
        if point.iter().all(|x| x.is_finite()) {
            self.points.push(point);
        } else {
            self.not_finite += 1;
        }
    }

    /// Every coordinate times `factor`, unless the file states the unit: a file in inches becomes mm by 25.4.
    pub fn scale(&mut self, factor: f64) {
        if self.states_unit {
            return;
        }
        for p in &mut self.points {
            *p *= factor;
        }
    }
}

/// A point of a cloud with what its file says of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CloudPoint {
    /// x, y, z in mm.
    pub at: [f64; 3],
    /// The profile it is of; 0 where the cloud does not say.
    pub profile: u64,
    /// Its place in the sensor's array; 0 where the cloud does not say.
    pub index: u32,
    /// When the sensor saw it, in microseconds of the board's clock; 0 where the cloud does not say.
    pub t_us: f64,
    /// How bright it was, in the sensor's own measure; 0 where the cloud does not say.
    pub intensity: f64,
    /// Its standard uncertainty by that of the sensor's mount, in mm; 0 where the cloud does not say.
    pub mount_u_mm: f64,
    /// Its profile had no latch: it was placed between two others. False where the cloud does not say.
    pub interpolated: bool,
}

/// What a cloud says of its points beside their coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CloudColumns {
    /// Their profiles.
    pub profile: bool,
    /// Their places in the profiles.
    pub index: bool,
    /// Their times.
    pub time: bool,
    /// Their intensity.
    pub intensity: bool,
    /// Their uncertainty by the mount.
    pub mount_u: bool,
    /// Which of them were placed between latches; only where some were.
    pub interpolated: bool,
}

/// Points one after the other, all finite.
pub type Points<'a> = Box<dyn Iterator<Item = Result<CloudPoint, ScanError>> + 'a>;
