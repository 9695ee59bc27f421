//! What a set of readings can tell, judged at the optimum and by how much it
//! scatters there, not by exact zeros.

// Every index runs over arrays of length K or 3.
#![allow(clippy::indexing_slicing, clippy::needless_range_loop)]

use nalgebra::Vector3;

use super::calibration::PointCalibration;
use super::error::{PointRefusal, Weakness};
use super::model::{Beam, View};
use crate::fit::solve::linalg::{Qr, Square, largest_variance, norm};
use crate::units::Mm;

/// Axis positions nearer than this to each other, seen from their ball, are
/// one place measured again.
const SAME_PLACE_MM: f64 = 1e-3;

/// A spread of the readings counts as none below this part of the radius.
const RANGE_LIMIT: f64 = 1e-3;

/// No sensor scatters by more than this part of the radius: what does is no measurement of this ball.
const MISFIT_PART: f64 = 1e-2;

/// A spread of the ball's normals counts as none below this cosine.
const SPREAD_LIMIT: f64 = 1e-4;

/// A spread of normals along a circle's axis counts as none below this.
const CIRCLE_LIMIT: f64 = 1e-3;

/// No scatter makes a wider spread than this look like a circle.
const WIDEST_CIRCLE: f64 = 0.02;

/// Spreads that noise alone makes are within so many times the noise.
const NOISE_FACTOR: f64 = 10.0;

/// The mean of the noise that pushes points out of a great circle's plane, in units of its standard error, and twice
/// for safety: at ten, one set in 65 000 passed.
const PUSH_FACTOR: f64 = 20.0;

/// Singular values of the scaled Jacobian below this are none.
const LEAST_SINGULAR: f64 = 1e-3;

/// Singular values of the scaled Jacobian below this are worth a warning.
const WEAK_SINGULAR: f64 = 0.03;

/// Largest standard uncertainty of a point over the radius, and of the
/// direction in radians, that a first-order covariance still describes.
const LARGEST_UNCERTAINTY: f64 = 0.1;

/// What can be told before any search.
pub(super) fn before<const K: usize>(view: &View<'_, K>) -> Result<(), PointRefusal> {
    let needed = K.saturating_add(1);
    // The places found so far: no more than are needed.
    let mut places = [Vector3::zeros(); 8];
    let mut distinct = 0_usize;
    for seen in view.sightings() {
        if distinct >= needed {
            break;
        }
        let known = places
            .iter()
            .take(distinct)
            .any(|p| norm(&(p - seen.from_center)) < SAME_PLACE_MM);
        if let (false, Some(free)) = (known, places.get_mut(distinct)) {
            *free = seen.from_center;
            distinct = distinct.saturating_add(1);
        }
    }
    if distinct < needed {
        return Err(PointRefusal::CoincidentPoints { distinct, needed });
    }
    if view.spread <= RANGE_LIMIT * view.least_radius() {
        return Err(PointRefusal::RangeNotVaried {
            spread: Mm(view.spread),
        });
    }
    Ok(())
}

/// What the optimum tells. Where the search only ended (not `settled`) its
/// residuals are no noise.
pub(super) fn at<const K: usize>(
    view: &View<'_, K>,
    beam: &Beam<K>,
    settled: bool,
) -> Result<(), PointRefusal> {
    let n = view.count();
    let root_n = libm::sqrt(n);
    let radius = view.least_radius();
    let mut normals = Qr::<3>::new();
    for seen in view.sightings() {
        let normal = beam.normal(&seen).ok_or(PointRefusal::NoConvergence)?;
        normals.add([normal.x, normal.y, normal.z], 0.0);
    }
    let rms = if settled { rms(view, beam) } else { 0.0 };
    let spreads = normals.triangle().svd().values.map(|s| s / root_n);
    if spreads[1] < SPREAD_LIMIT {
        // One reading that is metres off draws the beam with it, until the others see one place.
        let (spread, off) = (Mm(view.spread), Mm(self::rms(view, beam)));
        return Err(if off.0 > MISFIT_PART * radius {
            PointRefusal::Misfit { spread, rms: off }
        } else {
            PointRefusal::OnePlace
        });
    }
    // Readings that vary only as they scatter.
    if view.spread < NOISE_FACTOR * rms {
        let (spread, rms) = (Mm(view.spread), Mm(rms));
        return Err(if rms.0 > MISFIT_PART * radius {
            PointRefusal::Misfit { spread, rms }
        } else {
            PointRefusal::RangeInScatter { spread, rms }
        });
    }
    // On a great circle noise alone pushes the points out of its plane, until
    // what the ball curves away makes up for the mean of the noise.
    let pushed = PUSH_FACTOR * rms / (radius * root_n);
    let flat = spreads[2] < SPREAD_LIMIT || spreads[2] * spreads[2] < pushed;
    // A narrow cap is as thin, but not in one direction only.
    if flat && spreads[2] < 0.5 * spreads[1] {
        return Err(PointRefusal::GreatCircle {
            off_plane: Mm(radius * spreads[2]),
        });
    }
    if view.free_radius() {
        one_circle(view, beam)?;
    }
    match weakest(view, beam) {
        Some(weak) if weak.factor * LEAST_SINGULAR <= 1.0 => Ok(()),
        Some(weak) => Err(PointRefusal::Degenerate(weak)),
        None => Err(PointRefusal::Degenerate(Weakness {
            what: "beam",
            factor: f64::INFINITY,
        })),
    }
}

/// Refuses points on one circle, through which balls of any radius pass.
pub(super) fn one_circle<const K: usize>(
    view: &View<'_, K>,
    beam: &Beam<K>,
) -> Result<(), PointRefusal> {
    let (n, radius) = (view.count(), view.least_radius());
    let normals = || view.sightings().filter_map(|seen| beam.normal(&seen));
    let mean = normals().fold(Vector3::zeros(), |sum: Vector3<f64>, normal| {
        sum + normal / n
    });
    let mut centred = Qr::<3>::new();
    for normal in normals() {
        let off = normal - mean;
        centred.add([off.x, off.y, off.z], 0.0);
    }
    let along = centred.triangle().svd().values[2] / libm::sqrt(n);
    let scatter = NOISE_FACTOR * rms(view, beam) / radius;
    if along < CIRCLE_LIMIT.max(scatter.min(WIDEST_CIRCLE)) {
        return Err(PointRefusal::OneCircle {
            off_plane: Mm(radius * along),
        });
    }
    Ok(())
}

/// Root mean square of the residuals.
fn rms<const K: usize>(view: &View<'_, K>, beam: &Beam<K>) -> f64 {
    let squares = view
        .sightings()
        .map(|seen| beam.residual(&seen))
        .fold(0.0, |sum, residual| sum + residual * residual);
    libm::sqrt(squares / view.count())
}

/// The warning about a weak set.
pub(super) fn weak<const K: usize>(view: &View<'_, K>, beam: &Beam<K>) -> Option<Weakness> {
    weakest(view, beam).filter(|weak| weak.factor * WEAK_SINGULAR > 1.0)
}

/// Refuses what is too uncertain for its covariance to mean anything.
pub(super) fn certain(answer: &PointCalibration, radius: f64) -> Result<(), PointRefusal> {
    let Some(variance) = answer.stats.variance_mm2() else {
        return Ok(());
    };
    let place = answer
        .sensor
        .place_covariance(answer.mean_gamma, &answer.cov_unit);
    let point = libm::sqrt(variance * largest_variance(&place));
    let mut turn = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            turn[i][j] = answer.cov_unit[i + 3][j + 3];
        }
    }
    let direction_rad = libm::sqrt(variance * largest_variance(&turn));
    // Written so that NaN is refused too.
    if point <= LARGEST_UNCERTAINTY * radius && direction_rad <= LARGEST_UNCERTAINTY {
        return Ok(());
    }
    Err(PointRefusal::Uncertain {
        point: Mm(point),
        direction_rad,
    })
}

/// The weakest combination of the unknowns: angles and gain counted by what
/// they move at one standard deviation of the readings.
fn weakest<const K: usize>(view: &View<'_, K>, beam: &Beam<K>) -> Option<Weakness> {
    let mut qr = Qr::<K>::new();
    for seen in view.sightings() {
        let mut row = beam.gradient(&seen)?;
        for k in 3..K {
            if Some(k) != beam.radius_at {
                row[k] /= view.spread;
            }
        }
        qr.add(row, 0.0);
    }
    let (value, vector) = largest_eigenpair(&qr.triangle().inverse_gram()?);
    let mut most = 0;
    for k in 1..K {
        if vector[k].abs() > vector[most].abs() {
            most = k;
        }
    }
    let what = match most {
        0..3 => "offset",
        k if Some(k) == beam.gain_at => "gain",
        k if Some(k) == beam.radius_at => "radius",
        _ => "direction",
    };
    Some(Weakness {
        what,
        factor: libm::sqrt(view.count() * value),
    })
}

/// Largest eigenvalue of a positive semidefinite matrix, and its vector, by
/// squaring (power iteration that doubles its exponent).
fn largest_eigenpair<const K: usize>(matrix: &Square<K>) -> (f64, [f64; K]) {
    let mut power = *matrix;
    for _doubling in 0..12 {
        let largest = power.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        if !(largest > 0.0 && largest.is_finite()) {
            break;
        }
        let unit = power.map(|row| row.map(|x| x / largest));
        for i in 0..K {
            for j in 0..K {
                power[i][j] = (0..K).fold(0.0, |sum, k| sum + unit[i][k] * unit[k][j]);
            }
        }
    }
    // Any column that is not zero is the vector; the longest has most digits.
    let mut longest = 0;
    for k in 1..K {
        if power[k][k] > power[longest][longest] {
            longest = k;
        }
    }
    let mut vector = power[longest];
    let length = libm::sqrt(vector.iter().fold(0.0, |sum, x| sum + x * x));
    if length > 0.0 {
        vector = vector.map(|x| x / length);
    }
    (
        crate::fit::solve::linalg::quadratic_form(matrix, &vector),
        vector,
    )
}
