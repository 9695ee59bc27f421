//! Start values for surfaces with an axis, without a hint.
//!
//! # Design
//! The sum of squares has many local minima over the direction of the axis. So
//! a lattice of directions is scored, once even over the hemisphere and once
//! stretched like the points (long point sets have close minima near their long
//! axis): with the direction held, the rest of the surface is a linear problem.
//! Every direction that is better than its neighbours starts a damped Newton
//! iteration; so do directions around the best minimum found, until none is
//! better. If another minimum is about as good as the best, the points do not
//! tell which surface it is: refused.
//!
//! # Limitations
//! * Lists of more than [`SAMPLE`] points are searched through that many of
//!   them, evenly picked (the fit then uses all).
//! * The search is thorough, not exhaustive. The tests know of no miss in 2000
//!   random cylinders and cones (discs, needles, arcs of 100 degrees, from eight
//!   points; cones from twelve). Six points, which lie on several cones, are
//!   nearly always refused as ambiguous, but one in 150 was not: a hint helps.

use heapless::Vec;
use nalgebra::Vector3;

use super::axis::Axis;
use super::cloud::{Cloud, Spread, count};
use super::least_squares::{Surface, descend};
use super::linalg::unit;
use crate::fit::FitError;

/// Points that take part in the search.
const SAMPLE: usize = 128;
/// Fewest iterations started from each lattice.
const STARTS: usize = 8;
/// Points times iterations started from each lattice: few points have more
/// minima, and cost less.
const WORK: usize = 192;
/// Steps of each.
const STEPS: u32 = 60;
/// Cosine of the angle within which lattice directions are neighbours (15 degrees).
const NEIGHBOUR: f64 = 0.965_925_826_289_068_3;
/// Cosine of the angle that a hint may be off (30 degrees).
const NEAR: f64 = 0.866_025_403_784_438_6;
/// Most rounds of looking around the best minimum.
const ROUNDS: u32 = 4;
/// A second minimum with less than twice the rms of the best makes the answer
/// ambiguous.
const AMBIGUOUS: f64 = 4.0;

/// A surface with an axis.
pub(crate) trait Axial<const K: usize>: Surface<K> {
    /// The best surface for a direction by a linear problem, with its sum of
    /// squared residuals.
    fn guess<I>(direction: &Vector3<f64>, points: &I) -> Option<(Self, f64)>
    where
        I: Iterator<Item = Vector3<f64>> + Clone;

    /// Its axis.
    fn axis(&self) -> &Axis;

    /// Whether two surfaces are one: their directions agree.
    fn agrees(&self, other: &Self) -> bool;
}

/// The best start value, or why there is none.
pub(crate) fn search<const K: usize, S: Axial<K>>(
    cloud: &Cloud<'_>,
    spread: &Spread,
) -> Result<S, FitError> {
    let points = cloud.sample(SAMPLE);
    let mut search = Search::new(&points, None);
    search.over_lattice(spread.axes);
    let [a1, a2, a3] = spread.axes;
    let [s1, s2, s3] = spread.values;
    search.over_lattice([a1 * s1, a2 * s2, a3 * s3]);
    search.around_best();
    search.answer(cloud)
}

/// The best start value whose axis is within 30 degrees of `direction`.
pub(crate) fn search_near<const K: usize, S: Axial<K>>(
    cloud: &Cloud<'_>,
    direction: &Vector3<f64>,
) -> Result<S, FitError> {
    let direction = unit(direction).ok_or(FitError::NoDirection)?;
    let points = cloud.sample(SAMPLE);
    let mut search = Search::new(&points, Some(direction));
    search.start(&direction);
    if search.best.is_none() {
        // No way from exactly there: look around it.
        if let Some(axis) = Axis::new(&Vector3::zeros(), &direction) {
            search.around(&axis);
        }
    }
    search.around_best();
    search.answer(cloud)
}

/// What was found so far.
struct Search<'p, S, I> {
    points: &'p I,
    /// Only surfaces within [`NEAR`] of this direction count.
    near: Option<Vector3<f64>>,
    best: Option<Found<S>>,
    /// The least sum of a converged surface that is not the best one.
    other: f64,
}

/// Where one iteration ended.
#[derive(Clone, Copy)]
struct Found<S> {
    surface: S,
    sum: f64,
    converged: bool,
}

impl<'p, S, I> Search<'p, S, I>
where
    I: Iterator<Item = Vector3<f64>> + Clone,
{
    fn new(points: &'p I, near: Option<Vector3<f64>>) -> Self {
        Self {
            points,
            near,
            best: None,
            other: f64::INFINITY,
        }
    }

    /// The best surface, if it stands out.
    fn answer<const K: usize>(&self, cloud: &Cloud<'_>) -> Result<S, FitError>
    where
        S: Axial<K>,
    {
        let Some(best) = self.best else {
            return Err(FitError::NoConvergence { iterations: STEPS });
        };
        let n = count(self.points.clone().count());
        // Both exact: sums are nothing but rounding.
        let rounding = 1e4 * n * f64::EPSILON * f64::EPSILON;
        if self.other <= AMBIGUOUS * best.sum + rounding {
            let rms_mm = |sum: f64| cloud.mm(libm::sqrt(sum / n)).0;
            return Err(FitError::Ambiguous {
                best_rms_mm: rms_mm(best.sum),
                other_rms_mm: rms_mm(self.other),
            });
        }
        // Even if it did not converge: the fit that starts there says so.
        Ok(best.surface)
    }

    /// Starts from the locally best directions of a lattice on three vectors.
    fn over_lattice<const K: usize>(&mut self, [a1, a2, a3]: [Vector3<f64>; 3])
    where
        S: Axial<K>,
    {
        let direction = |steps: [i8; 3]| {
            let [i, j, k] = steps.map(f64::from);
            unit(&(a1 * i + a2 * j + a3 * k))
        };
        // Best first, so that a node is locally best if no earlier one is near. Each is put
        // in its place as it comes: the library's sorting wants 19 KB of stack.
        let mut nodes = Vec::<Node, NODES>::new();
        for steps in half_lattice() {
            let guess = direction(steps).and_then(|d| S::guess(&d, self.points));
            let score = guess.map_or(f64::INFINITY, |(_, sum)| sum);
            let node = Node { steps, score };
            let place = nodes.partition_point(|other| other.is_better(&node));
            // The table has room for all of them.
            let _ = nodes.insert(place, node);
        }
        let most = STARTS.max(WORK / self.points.clone().count().max(1));
        let mut starts = 0;
        for (rank, node) in nodes.iter().enumerate() {
            if starts >= most || !node.score.is_finite() {
                break;
            }
            let beaten = nodes.iter().take(rank).any(|better| node.near(better));
            if let Some(direction) = direction(node.steps).filter(|_| !beaten) {
                self.start(&direction);
                starts += 1;
            }
        }
    }

    /// Starts from directions around the best surface, as long as that finds a
    /// better one.
    fn around_best<const K: usize>(&mut self)
    where
        S: Axial<K>,
    {
        for _ in 0..ROUNDS {
            let Some(Found { surface, sum, .. }) = self.best else {
                return;
            };
            self.around(surface.axis());
            if self.best.is_none_or(|best| best.sum >= sum) {
                return;
            }
        }
    }

    /// Starts from directions around an axis.
    fn around<const K: usize>(&mut self, axis: &Axis)
    where
        S: Axial<K>,
    {
        // How far tilting moves the points across the surface depends on how
        // long it is.
        let (mut across2, mut along2) = (0.0, 0.0);
        for q in self.points.clone() {
            let [x, y, z] = axis.coordinates(&q);
            across2 += x * x + y * y;
            along2 += z * z;
        }
        let slope = libm::sqrt(across2 / (across2 + along2));
        for (x, y) in AROUND {
            let tilt = axis.e1 * (x * slope) + axis.e2 * (y * slope);
            self.start(&(axis.direction + tilt));
        }
    }

    /// Runs one iteration and keeps the better surface.
    fn start<const K: usize>(&mut self, direction: &Vector3<f64>)
    where
        S: Axial<K>,
    {
        let Some((start, _)) = S::guess(direction, self.points) else {
            return;
        };
        let found = match descend(start, self.points, STEPS) {
            Ok(end) => Found {
                surface: end.surface,
                sum: end.system.sum,
                converged: true,
            },
            Err(end) => Found {
                surface: end.surface,
                sum: end.sum,
                converged: false,
            },
        };
        if let Some(near) = self.near
            && found.surface.axis().direction.dot(&near).abs() < NEAR
        {
            return;
        }
        let Some(before) = self.best else {
            self.best = Some(found);
            return;
        };
        let (better, worse) = if found.sum < before.sum {
            (found, before)
        } else {
            (before, found)
        };
        if worse.converged && !worse.surface.agrees(&better.surface) {
            self.other = self.other.min(worse.sum);
        }
        self.best = Some(better);
    }
}

/// Tilts around a direction, in its slope: two rings of four.
const AROUND: [(f64, f64); 8] = [
    (0.15, 0.0),
    (-0.15, 0.0),
    (0.0, 0.15),
    (0.0, -0.15),
    (0.4, 0.4),
    (-0.4, 0.4),
    (0.4, -0.4),
    (-0.4, -0.4),
];

/// Largest component of a lattice direction; they are about 12 degrees apart.
const LATTICE: i8 = 3;
/// How many those are.
const NODES: usize = 145;

/// A scored direction.
#[derive(Clone, Copy)]
struct Node {
    steps: [i8; 3],
    score: f64,
}

impl Node {
    /// Of two that are as good, the one with the smaller steps: so the order is the same
    /// everywhere.
    fn is_better(&self, other: &Self) -> bool {
        let by_score = self.score.total_cmp(&other.score);
        by_score.then(self.steps.cmp(&other.steps)).is_lt()
    }

    /// Whether two nodes are neighbours, in the coordinates of the lattice.
    fn near(&self, other: &Self) -> bool {
        let (a, b) = (self.vector(), other.vector());
        let dot = a.dot(&b);
        dot * dot > NEIGHBOUR * NEIGHBOUR * a.dot(&a) * b.dot(&b)
    }

    fn vector(&self) -> Vector3<f64> {
        let [i, j, k] = self.steps.map(f64::from);
        Vector3::new(i, j, k)
    }
}

/// Vectors of whole numbers up to [`LATTICE`] without a common divisor, one of
/// each opposite pair.
fn half_lattice() -> impl Iterator<Item = [i8; 3]> {
    let range = || -LATTICE..=LATTICE;
    range()
        .flat_map(move |i| range().flat_map(move |j| range().map(move |k| [i, j, k])))
        .filter(|steps| {
            let positive = *steps > [0, 0, 0];
            let multiple = (2..=LATTICE).any(|d| steps.iter().all(|s| s % d == 0));
            positive && !multiple
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_directions_fill_the_table() {
        assert_eq!(half_lattice().count(), NODES);
    }
}
