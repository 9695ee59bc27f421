//! Points on their way to a file, counted.

use crate::ScanError;
use crate::cloud::{CloudPoint, Points};

/// The greatest coordinate of a point, whichever its sign.
pub(crate) fn farthest_mm(at: &[f64; 3]) -> f64 {
    at.iter().fold(0.0, |most, mm| mm.abs().max(most))
}

/// Points that count themselves.
pub(super) struct Counted<'a> {
    points: Points<'a>,
    /// A point that was looked at, and is taken next.
    ahead: Option<CloudPoint>,
    /// How many were taken.
    pub count: u64,
    /// The greatest coordinate of all that were taken, whichever its sign.
    pub farthest_mm: f64,
}

impl<'a> Counted<'a> {
    /// None is taken yet.
    pub fn new(points: Points<'a>) -> Self {
        Self {
            points,
            ahead: None,
            count: 0,
            farthest_mm: 0.0,
        }
    }

    /// The next point, if there is one more, without taking it.
    pub fn look(&mut self) -> Result<Option<CloudPoint>, ScanError> {
        if self.ahead.is_none() {
            self.ahead = self.points.next().transpose()?;
        }
        Ok(self.ahead)
    }

    /// The next point, if there is one more.
    pub fn next_point(&mut self) -> Result<Option<CloudPoint>, ScanError> {
        let point = match self.ahead.take() {
            None => self.points.next().transpose()?,
            some => some,
        };
        if let Some(point) = &point {
            self.count += 1;
            self.farthest_mm = farthest_mm(&point.at).max(self.farthest_mm);
        }
        Ok(point)
    }
}
