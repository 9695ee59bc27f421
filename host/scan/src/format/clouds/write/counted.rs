//! Points on their way to a file, counted.

use crate::ScanError;
use crate::cloud::{CloudPoint, Points};

/// Points that count themselves.
pub(super) struct Counted<'a> {
    points: Points<'a>,
    /// How many were taken.
    pub count: u64,
}

impl<'a> Counted<'a> {
    /// None is taken yet.
    pub fn new(points: Points<'a>) -> Self {
        Self { points, count: 0 }
    }

    /// The next point, if there is one more.
    pub fn next_point(&mut self) -> Result<Option<CloudPoint>, ScanError> {
        let point = self.points.next().transpose()?;
        self.count += u64::from(point.is_some());
        Ok(point)
    }
}
