//! From the fit's unknowns to t, a and g, and how well they are known.

// Every index runs over arrays of length K or 7.
#![allow(clippy::indexing_slicing, clippy::needless_range_loop)]

use super::calibration::PointCalibration;
use super::identify;
use super::model::{Beam, View};
use super::sensor::PointSensor;
use crate::fit::Statistics;
use crate::fit::solve::linalg::{Square, added, propagate};
use crate::units::{Mm, Point};

/// One rounding, so that a fit is exact below an rms of 1e-11 mm.
const ROUNDING: Mm = Mm(1e-11 / crate::fit::EXACT_FIT_ROUNDINGS);

/// The answer in the caller's terms.
pub(super) fn answer<const K: usize>(
    view: &View<'_, K>,
    beam: &Beam<K>,
    cov_local: &Square<K>,
    mirror: bool,
) -> PointCalibration {
    let sensor = sensor_of(beam, view.mean_gamma);
    let to_sensor = offset_direction_gain(view, beam);
    PointCalibration {
        sensor,
        radius_error: Mm(beam.radius_error),
        stats: statistics(view, beam),
        cov_unit: propagate(&to_sensor, cov_local),
        cov_balls: from_balls(view, beam, cov_local, &to_sensor),
        mean_gamma: Mm(view.mean_gamma),
        radius_variance_unit: beam.radius_at.map_or(0.0, |at| cov_local[at][at]),
        mirror,
        weak: identify::weak(view, beam),
    }
}

/// Residuals: rms of d, sigma of d times its weight.
fn statistics<const K: usize>(view: &View<'_, K>, beam: &Beam<K>) -> Statistics {
    let residuals = |weighted: bool| {
        view.sightings().map(move |seen| {
            let residual = beam.residual(&seen);
            if weighted {
                residual
            } else {
                residual / seen.weight
            }
        })
    };
    let plain = Statistics::new(residuals(false), view.dof(), ROUNDING);
    let sigma = Statistics::new(residuals(true), view.dof(), ROUNDING).sigma;
    Statistics { sigma, ..plain }
}

/// How t, a and g move with the unknowns: t = c - γ̄ g a.
fn offset_direction_gain<const K: usize>(view: &View<'_, K>, beam: &Beam<K>) -> [[f64; K]; 7] {
    let [e1, e2] = beam.across;
    let reach = view.mean_gamma * beam.gain;
    let mut rows = [[0.0; K]; 7];
    for axis in 0..3 {
        rows[axis][axis] = 1.0;
        rows[axis][3] = -reach * e1[axis];
        rows[axis][4] = -reach * e2[axis];
        if let Some(at) = beam.gain_at {
            rows[axis][at] = -view.mean_gamma * beam.direction[axis];
        }
        rows[axis + 3][3] = e1[axis];
        rows[axis + 3][4] = e2[axis];
    }
    if let Some(at) = beam.gain_at.and_then(|at| rows[6].get_mut(at)) {
        *at = 1.0;
    }
    rows
}

/// What the standard uncertainties of the balls add. An error of a centre's
/// coordinate, or of a radius, is one for all readings of that ball; its effect
/// is `inv(JᵀJ) Jᵀ v` with v the change of the residuals by it.
fn from_balls<const K: usize>(
    view: &View<'_, K>,
    beam: &Beam<K>,
    cov_local: &Square<K>,
    to_sensor: &[[f64; K]; 7],
) -> Square<7> {
    let mut total = [[0.0; 7]; 7];
    for (index, ball) in view.balls.iter().enumerate() {
        let [u_center, u_radius] = [ball.u_center.0, ball.u_radius.0];
        if u_center == 0.0 && u_radius == 0.0 {
            continue;
        }
        // Jᵀv for the three coordinates and the radius.
        let mut pulls = [[0.0; K]; 4];
        for seen in view.sightings().filter(|seen| seen.ball == index) {
            let (Some(gradient), Some(normal)) = (beam.gradient(&seen), beam.normal(&seen)) else {
                continue;
            };
            let changes = [normal.x, normal.y, normal.z, 1.0];
            for (pull, change) in pulls.iter_mut().zip(changes) {
                for k in 0..K {
                    pull[k] += gradient[k] * seen.weight * change;
                }
            }
        }
        for (pull, u) in pulls.iter().zip([u_center, u_center, u_center, u_radius]) {
            let mut effect = [0.0; 7];
            for row in 0..7 {
                for i in 0..K {
                    for j in 0..K {
                        effect[row] += to_sensor[row][i] * cov_local[i][j] * pull[j] * u;
                    }
                }
            }
            total = added(&total, &effect);
        }
    }
    total
}

/// The beam as the caller knows it.
fn sensor_of<const K: usize>(beam: &Beam<K>, mean_gamma: f64) -> PointSensor {
    PointSensor {
        offset: Point {
            mm: beam.foot - beam.direction * (mean_gamma * beam.gain),
        },
        direction: beam.direction,
        gain: beam.gain,
    }
}
