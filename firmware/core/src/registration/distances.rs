//! Distances between the points of a part, measured against nominal. They do not
//! depend on where the part lies, so they tell a bad sphere or a bent part from a
//! moved one.

use crate::fit::solve::linalg::norm;
use crate::fit::{FitError, PointSet};
use crate::units::{Mm, Point};

/// The distance between two points of a part, nominal and measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Index of the first point, from 0.
    pub first: usize,
    /// Index of the second point, greater than `first`.
    pub second: usize,
    /// Distance of the nominal points, in space.
    pub nominal: Mm,
    /// Distance of the measured points, in space.
    pub measured: Mm,
}

impl Distance {
    /// Measured minus nominal.
    #[must_use]
    pub fn difference(&self) -> Mm {
        Mm(self.measured.0 - self.nominal.0)
    }
}

/// All distances of a part, in the order 0-1, 0-2, …, 1-2, …: n(n-1)/2 of them.
///
/// These are distances in space, unlike the distances in plan of the thesis'
/// table 5.3.
///
/// # Errors
/// `length_mismatch`, and `not_finite` for a coordinate that is not a number.
pub fn distances<'a>(
    nominal: &'a [Point],
    measured: &'a [Point],
) -> Result<impl Iterator<Item = Distance> + Clone + 'a, FitError> {
    if nominal.len() != measured.len() {
        return Err(FitError::LengthMismatch {
            source: nominal.len(),
            target: measured.len(),
        });
    }
    for (points, set) in [(nominal, PointSet::Source), (measured, PointSet::Target)] {
        if let Some(row) = points.iter().position(|p| !p.is_finite()) {
            return Err(FitError::NotFinite { set, row });
        }
    }
    let rows = move || nominal.iter().zip(measured).enumerate();
    Ok(rows().flat_map(move |(first, (nominal_a, measured_a))| {
        rows()
            .skip(first.saturating_add(1))
            .map(move |(second, (nominal_b, measured_b))| Distance {
                first,
                second,
                nominal: Mm(norm(&(nominal_b.mm - nominal_a.mm))),
                measured: Mm(norm(&(measured_b.mm - measured_a.mm))),
            })
    }))
}
