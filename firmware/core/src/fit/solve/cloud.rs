//! A checked list of points, seen from its centroid and at unit size.

use nalgebra::Vector3;

use super::linalg::{Qr, Triangle};
use crate::fit::error::{Degeneracy, FitError, PointSet};
use crate::fit::{MAX_COORDINATE, MIN_EXTENT, SPREAD_LIMIT};
use crate::units::{Mm, Point};

/// Points that are finite, enough and not all the same, with the local
/// coordinates `(p - centroid) / scale` in which the fits work.
pub(crate) struct Cloud<'a> {
    points: &'a [Point],
    set: PointSet,
    /// The centroid is `origin + mean`: `origin` rounded, `mean` what rounding
    /// left over.
    origin: Vector3<f64>,
    mean: Vector3<f64>,
    /// A power of two, so that scaling is exact.
    scale: f64,
    inverse_scale: f64,
    /// Largest coordinate, mm.
    largest: f64,
}

/// The spread of a cloud along its principal axes.
pub(crate) struct Spread {
    /// Root of the sum of squared local coordinates along each axis, largest first.
    pub(crate) values: [f64; 3],
    /// The principal axes, a right-handed frame.
    pub(crate) axes: [Vector3<f64>; 3],
    /// Below this a value is nothing but the rounding of coordinates.
    floor: f64,
    set: PointSet,
}

impl<'a> Cloud<'a> {
    /// Checks the points and finds centroid and size.
    ///
    /// # Errors
    /// Too few points, a coordinate that is not finite or out of range, fewer
    /// than `needed` distinct points, all points coincident.
    pub(crate) fn new(points: &'a [Point], set: PointSet, needed: usize) -> Result<Self, FitError> {
        let given = points.len();
        let Some(first) = points.first().filter(|_| given >= needed) else {
            return Err(FitError::TooFewPoints { given, needed });
        };
        let mut largest = 0.0_f64;
        for (row, point) in points.iter().enumerate() {
            if !point.is_finite() {
                return Err(FitError::NotFinite { set, row });
            }
            largest = largest.max(point.mm.amax());
            if largest > MAX_COORDINATE.0 {
                return Err(FitError::OutOfRange { set, row });
            }
        }
        let distinct = distinct_up_to(points, needed);
        if distinct < needed {
            let why = if distinct <= 1 {
                Degeneracy::Coincident
            } else {
                Degeneracy::Duplicates { distinct, needed }
            };
            return Err(FitError::Degenerate { set, why });
        }

        // Differences to a point of the set are small and exact enough; their
        // mean gives the centroid, and a second pass what its rounding left.
        let origin = first.mm + mean_from(points, &first.mm);
        let mean = mean_from(points, &origin);
        let extent = points
            .iter()
            .map(|p| (p.mm - origin - mean).amax())
            .fold(0.0, f64::max);
        if extent < MIN_EXTENT.0 || extent <= 4.0 * f64::EPSILON * largest {
            return Err(FitError::Degenerate {
                set,
                why: Degeneracy::Coincident,
            });
        }
        let (_, exponent) = libm::frexp(extent);
        let scale = libm::ldexp(1.0, exponent);
        Ok(Self {
            points,
            set,
            origin,
            mean,
            scale,
            inverse_scale: 1.0 / scale,
            largest,
        })
    }

    /// Number of points.
    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// Number of points as a number to calculate with.
    pub(crate) fn count(&self) -> f64 {
        count(self.points.len())
    }

    /// The points in local coordinates: no coordinate beyond 1.
    pub(crate) fn local(&self) -> impl Iterator<Item = Vector3<f64>> + Clone + use<'a> {
        let Self {
            points,
            origin,
            mean,
            inverse_scale,
            ..
        } = *self;
        points
            .iter()
            .map(move |p| (p.mm - origin - mean) * inverse_scale)
    }

    /// At most `limit` of the local points, evenly picked along the list. A solver that runs over
    /// a sample takes all points by this iterator too: a second kind is a second solver in the image.
    pub(crate) fn sample(
        &self,
        limit: usize,
    ) -> impl Iterator<Item = Vector3<f64>> + Clone + use<'a> {
        let stride = self.points.len().div_ceil(limit.max(1)).max(1);
        self.local().step_by(stride)
    }

    /// Size of the local unit, mm.
    pub(crate) fn scale(&self) -> f64 {
        self.scale
    }

    /// A local position in the coordinates of the points.
    pub(crate) fn point_at(&self, local: &Vector3<f64>) -> Point {
        Point {
            mm: self.origin + (self.mean + local * self.scale),
        }
    }

    /// A local length in millimetres.
    pub(crate) fn mm(&self, local: f64) -> Mm {
        Mm(local * self.scale)
    }

    /// What one rounding of the largest coordinate is worth, mm.
    pub(crate) fn rounding(&self) -> Mm {
        Mm(f64::EPSILON * self.largest)
    }

    /// A local spread below this is nothing but the rounding of coordinates.
    pub(crate) fn spread_floor(&self) -> f64 {
        4.0 * self.rounding().0 * self.inverse_scale * libm::sqrt(self.count())
    }

    /// Refuses points that are all one point or collinear; the triangle of the others.
    pub(crate) fn require_plane(&self) -> Result<Triangle<3>, FitError> {
        let triangle = self.triangle();
        if !triangle.surely_spans_plane(SPREAD_LIMIT, self.spread_floor()) {
            self.spread().require_plane()?;
        }
        Ok(triangle)
    }

    /// Refuses points that do not span space.
    pub(crate) fn require_space(&self) -> Result<(), FitError> {
        let triangle = self.triangle();
        let floor = self.spread_floor();
        // Space has a plane in it: the smallest singular value is below the middle one.
        if triangle.surely_spans_space(SPREAD_LIMIT, floor) {
            return Ok(());
        }
        self.spread().require_space()
    }

    /// The triangle of the matrix whose rows are the local coordinates.
    fn triangle(&self) -> Triangle<3> {
        let mut qr = Qr::<3>::new();
        for q in self.local() {
            qr.add([q.x, q.y, q.z], 0.0);
        }
        qr.triangle()
    }

    /// The principal axes and the spread along them.
    pub(crate) fn spread(&self) -> Spread {
        let svd = self.triangle().svd();
        Spread {
            values: svd.values,
            axes: svd.right,
            floor: self.spread_floor(),
            set: self.set,
        }
    }
}

impl Spread {
    fn missing(&self, value: f64) -> bool {
        let [largest, ..] = self.values;
        value <= SPREAD_LIMIT * largest || value <= self.floor
    }

    /// An error if all points are on one line.
    pub(crate) fn require_plane(&self) -> Result<(), FitError> {
        let [_, middle, _] = self.values;
        if self.missing(middle) {
            return Err(FitError::Degenerate {
                set: self.set,
                why: Degeneracy::Collinear,
            });
        }
        Ok(())
    }

    /// An error if all points are on one line or in one plane.
    pub(crate) fn require_space(&self) -> Result<(), FitError> {
        self.require_plane()?;
        let [_, _, smallest] = self.values;
        if self.missing(smallest) {
            return Err(FitError::Degenerate {
                set: self.set,
                why: Degeneracy::Coplanar,
            });
        }
        Ok(())
    }
}

/// A number of points as a number to calculate with (exact below 2^53).
#[allow(clippy::cast_precision_loss)]
pub(crate) fn count(n: usize) -> f64 {
    n as f64
}

fn mean_from(points: &[Point], reference: &Vector3<f64>) -> Vector3<f64> {
    let sum = points
        .iter()
        .fold(Vector3::zeros(), |sum: Vector3<f64>, p| {
            sum + (p.mm - reference)
        });
    sum / count(points.len())
}

/// How many different points there are, counting no further than `needed`.
fn distinct_up_to(points: &[Point], needed: usize) -> usize {
    /// No geometry needs more points than a cone.
    const MOST: usize = 6;
    let mut seen = [None; MOST];
    let mut distinct = 0;
    for point in points {
        if distinct >= needed.min(MOST) {
            break;
        }
        if seen.iter().flatten().all(|other| other != point)
            && let Some(slot) = seen.get_mut(distinct)
        {
            *slot = Some(*point);
            distinct += 1;
        }
    }
    distinct
}
