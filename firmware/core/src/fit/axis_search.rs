//! Start values for surfaces with an axis, without a hint.
//!
//! # Design
//! A set of directions, even on the hemisphere and denser along elongated point
//! sets, is scored: with the direction held, the rest of the surface is a linear
//! problem. Every direction that is better than all its neighbours starts a
//! damped Newton iteration, and the best minimum wins. If another minimum is
//! about as good, the points do not tell which surface it is: refused.
//!
//! # Limitations
//! Long lists are searched through at most [`SAMPLE`] of their points (the fit
//! then uses all), so a surface seen only by a small part of them can be missed.

use nalgebra::Vector3;

use super::FitError;
use super::cloud::{Cloud, Spread, count};
use super::least_squares::{Surface, descend};
use super::linalg::unit;

/// Points that take part in the search.
const SAMPLE: usize = 128;
/// Iterations started.
const STARTS: usize = 8;
/// Steps of each.
const STEPS: u32 = 60;
/// Cosine of the angle within which directions are neighbours (25 degrees).
const NEIGHBOUR: f64 = 0.906_307_787_036_65;
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

    /// Whether two surfaces are one: their directions agree.
    fn agrees(&self, other: &Self) -> bool;
}

/// Whole-number directions with components up to 3, one of each opposite pair
/// and no multiples: about 12 degrees apart.
const LATTICE: i32 = 3;
/// How many those are, and 13 with components up to 1.
const DIRECTIONS: usize = 145 + 13;

/// The best start value, or why there is none.
pub(crate) fn search<const K: usize, S: Axial<K>>(
    cloud: &Cloud<'_>,
    spread: &Spread,
) -> Result<S, FitError> {
    let points = cloud.sample(SAMPLE);
    let mut candidates = [const { None::<Candidate> }; DIRECTIONS];
    for (slot, direction) in candidates.iter_mut().zip(directions(spread)) {
        let score = S::guess(&direction, &points).map_or(f64::INFINITY, |(_, sum)| sum);
        *slot = Some(Candidate {
            direction,
            score,
            seen: false,
        });
    }

    let mut best: Option<Found<S>> = None;
    // The best sum of a converged surface that is not the best one.
    let mut other = f64::INFINITY;
    for _ in 0..STARTS {
        let Some(direction) = next_start(&mut candidates) else {
            break;
        };
        let Some((start, _)) = S::guess(&direction, &points) else {
            continue;
        };
        let found = match descend(start, &points, STEPS) {
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
        let Some(before) = &best else {
            best = Some(found);
            continue;
        };
        let same = before.surface.agrees(&found.surface);
        let (better, worse) = if found.sum < before.sum {
            (found, *before)
        } else {
            (*before, found)
        };
        if worse.converged && !same {
            other = other.min(worse.sum);
        }
        best = Some(better);
    }
    let Some(best) = best else {
        return Err(FitError::NoConvergence { iterations: 0 });
    };
    let n = count(points.count());
    // Both exact: sums are nothing but rounding.
    let rounding = 1e4 * n * f64::EPSILON * f64::EPSILON;
    if other <= AMBIGUOUS * best.sum + rounding {
        let rms_mm = |sum: f64| cloud.mm(libm::sqrt(sum / n)).0;
        return Err(FitError::Ambiguous {
            best_rms_mm: rms_mm(best.sum),
            other_rms_mm: rms_mm(other),
        });
    }
    // Even if it did not converge: the fit that starts there says so.
    Ok(best.surface)
}

/// Where one iteration ended.
#[derive(Clone, Copy)]
struct Found<S> {
    surface: S,
    sum: f64,
    converged: bool,
}

struct Candidate {
    direction: Vector3<f64>,
    score: f64,
    seen: bool,
}

/// The best direction not yet seen that has no better neighbour.
fn next_start(candidates: &mut [Option<Candidate>]) -> Option<Vector3<f64>> {
    loop {
        let best = candidates
            .iter_mut()
            .flatten()
            .filter(|c| !c.seen && c.score.is_finite())
            .min_by(|a, b| a.score.total_cmp(&b.score))?;
        best.seen = true;
        let (direction, score) = (best.direction, best.score);
        // All seen ones are better or equal.
        let beaten = candidates.iter().flatten().any(|c| {
            c.seen && c.score <= score && c.direction != direction && {
                c.direction.dot(&direction).abs() > NEIGHBOUR
            }
        });
        if !beaten {
            return Some(direction);
        }
    }
}

/// The directions to try, in the frame of the principal axes: the axes
/// themselves are among them, and a moved point set is searched alike.
fn directions(spread: &Spread) -> impl Iterator<Item = Vector3<f64>> {
    let [a1, a2, a3] = spread.axes;
    let [s1, s2, s3] = spread.values;
    let even = half_lattice(LATTICE).map(move |[i, j, k]| a1 * i + a2 * j + a3 * k);
    // Close to the long axis of long point sets: by the ratio of the spreads.
    let stretched =
        half_lattice(1).map(move |[i, j, k]| a1 * (i * s1) + a2 * (j * s2) + a3 * (k * s3));
    even.chain(stretched).filter_map(|v| unit(&v))
}

/// Vectors of whole numbers up to `limit` without a common divisor, one of each
/// opposite pair.
fn half_lattice(limit: i32) -> impl Iterator<Item = [f64; 3]> {
    let range = move || -limit..=limit;
    range()
        .flat_map(move |i| range().flat_map(move |j| range().map(move |k| (i, j, k))))
        .filter(|&(i, j, k)| {
            let positive = i > 0 || (i == 0 && (j > 0 || (j == 0 && k > 0)));
            let multiple = (2..=3).any(|d| i % d == 0 && j % d == 0 && k % d == 0);
            positive && !multiple
        })
        .map(|(i, j, k)| [f64::from(i), f64::from(j), f64::from(k)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_directions_fill_the_table() {
        assert_eq!(
            half_lattice(LATTICE).count() + half_lattice(1).count(),
            DIRECTIONS
        );
    }
}
