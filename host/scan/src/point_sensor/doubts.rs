//! What makes a calibration doubtful, though it fits: each is told with its figure.
//!
//! The offset t takes up nearly all of a wrong radius, a wrong gain or one wrong reading, and what is left of it looks
//! like noise. So each is tried: the same readings with the radius free, with the gain free, and without the
//! reading that is farthest off. Where that leaves far less than chance would, it is told.
//!
//! # Limitations
//!
//! A radius is tried where there is one ball. Of several wrong readings one is named; leave it out, and the next is.

use umi_core::point::{
    BallReading, CalibrationBall, PointCalibration, PointQuestion, ResidualNoise, calibrate,
};

use super::readings::SensorReadings;
use crate::solve::student::{NORMAL_95, coverage_95};

/// More standard uncertainties than this are no chance.
const SURE: f64 = 10.0;
/// So many degrees of freedom say what chance is. With one reading left out, or one unknown more, that is.
const LEAST_DOF: usize = 6;
/// Less than this is no matter: mm, and part of a reading.
const LEAST_MM: f64 = 1e-5;
const LEAST_GAIN: f64 = 1e-5;
/// A direction that is known no better than this is told, radians: 2 µm for each millimetre beside the distance of the
/// readings.
const LOOSE_RAD: f64 = 0.002;

/// Everything doubtful about a fit.
pub(super) fn doubts(
    readings: &SensorReadings,
    read: &[BallReading],
    balls: &[CalibrationBall],
    wanted: &PointQuestion,
    fit: &PointCalibration,
) -> Vec<String> {
    let wrong: Vec<String> = [
        outlier(readings, read, balls, wanted, fit),
        model(read, balls, wanted, fit),
    ]
    .into_iter()
    .flatten()
    .collect();
    // What is wrong scatters, and so leaves the direction open: that is no fault of the places.
    let loose = wrong.is_empty().then(|| loose(fit)).flatten();
    let is_noisy = fit.stats.sigma.is_some();
    let few = is_noisy.then(|| few_readings(fit.stats.dof)).flatten();
    repeated(read)
        .into_iter()
        .chain(few)
        .chain(loose)
        .chain(wrong)
        .collect()
}

/// Readings that are others once more.
fn repeated(read: &[BallReading]) -> Option<String> {
    let bits = |r: &BallReading| {
        let [x, y, z] = r.axes.to_array_mm().map(f64::to_bits);
        (x, y, z, r.gamma.0.to_bits(), r.ball)
    };
    let mut seen: Vec<_> = read.iter().map(bits).collect();
    seen.sort_unstable();
    seen.dedup();
    let count = read.len() - seen.len();
    (count > 0).then(|| {
        format!(
            "repeated: {count} readings are others to the last figure: each counts as a new one, and the uncertainty comes out too small; leave them out"
        )
    })
}

/// So few readings that their scatter hardly says how they scatter: every standard uncertainty is made of it. What else
/// could be wrong ([`outlier`], [`model`]) is not tried with them either.
pub(super) fn few_readings(dof: usize) -> Option<String> {
    let factor = coverage_95(dof as u64).filter(|_| dof <= LEAST_DOF)?;
    Some(format!(
        "weak: few readings, {dof} more than unknowns: their scatter is known so badly that 95 % of errors are within {factor:.1} times u, not 2, and a wrong reading, radius or gain is not told; measure 13 places or more"
    ))
}

/// A direction that is not known well. Few readings count by Student's t: what holds 95 % is as wide as with that uncertainty.
fn loose(fit: &PointCalibration) -> Option<String> {
    if fit.weak.is_some() {
        return None;
    }
    let covariance = fit.covariance()?;
    let variance: f64 = (3..6)
        .filter_map(|i| Some(*covariance.get(i)?.get(i)?))
        .sum();
    let rad = variance.sqrt() * coverage_95(fit.stats.dof as u64)? / NORMAL_95;
    (rad > LOOSE_RAD).then(|| {
        format!(
            "weak: the direction is known to {:.1} mrad only (standard uncertainty, widened by Student's t): a point is off by {:.1} um for each millimetre that its reading is beside {:.2} mm; spread the readings over a wider cone and over the depth of field",
            rad * 1e3,
            rad * 1e3,
            fit.mean_gamma.0
        )
    })
}

/// The reading that is farthest off, where the others say that it is wrong.
fn outlier(
    readings: &SensorReadings,
    read: &[BallReading],
    balls: &[CalibrationBall],
    wanted: &PointQuestion,
    fit: &PointCalibration,
) -> Option<String> {
    let off = |fit: &PointCalibration, r: &BallReading| Some(fit.residual(r, balls.get(r.ball)?).0);
    let (worst, reading) = read.iter().enumerate().max_by(|(_, a), (_, b)| {
        let far = |r| off(fit, r).unwrap_or_default().abs();
        far(a).total_cmp(&far(b))
    })?;
    let mut others = read.to_vec();
    others.remove(worst);
    let without = calibrate(&others, balls, wanted).ok()?;
    if without.stats.dof < LEAST_DOF {
        return None;
    }
    let error = off(&without, reading)?;
    // What the others leave open at this reading counts as well.
    let sensor = &without.sensor;
    let place = sensor.place(reading.axes, reading.gamma);
    let normal = (place.mm - balls.get(reading.ball)?.center.mm).normalize();
    let covariance = sensor.place_covariance(reading.gamma, &without.covariance()?);
    let mut variance = 0.0;
    for (row, i) in covariance.iter().zip(normal.iter()) {
        for (element, j) in row.iter().zip(normal.iter()) {
            variance += i * element * j;
        }
    }
    let mut sigma = without.stats.sigma?.0;
    if wanted.noise == ResidualNoise::AlongBeam {
        sigma *= normal.dot(&sensor.direction).abs();
    }
    let u = (variance.max(0.0) + sigma * sigma).sqrt();
    let line = readings.used.get(worst)?.line;
    (error.abs() > (SURE * u).max(LEAST_MM)).then(|| {
        format!(
            "outlier: the reading in line {line} is {:+.4} mm off the ball by all others, {:.0} times what they scatter; without it the offset moves by {:.4} mm: leave it out, or measure it again",
            error,
            error.abs() / u,
            (sensor.offset.mm - fit.sensor.offset.mm).norm()
        )
    })
}

/// A radius or a gain with which the readings fit far better.
fn model(
    read: &[BallReading],
    balls: &[CalibrationBall],
    wanted: &PointQuestion,
    fit: &PointCalibration,
) -> Option<String> {
    let first = read.first()?.ball;
    let ball = balls.get(first)?;
    // A standard uncertainty of the radius is in the covariance already.
    let radius = (!wanted.free_radius && read.iter().all(|r| r.ball == first))
        .then_some(PointQuestion {
            free_radius: true,
            ..*wanted
        })
        .and_then(|with| better(read, balls, &with, fit))
        .filter(|(_, with)| with.radius_error.0.abs() > (3.0 * ball.u_radius.0).max(LEAST_MM));
    let gain = (!wanted.free_gain)
        .then_some(PointQuestion {
            free_gain: true,
            ..*wanted
        })
        .and_then(|with| better(read, balls, &with, fit))
        .filter(|(_, with)| (with.sensor.gain - 1.0).abs() > LEAST_GAIN);
    let moved = |with: &PointCalibration| (with.sensor.offset.mm - fit.sensor.offset.mm).norm();
    match (radius, gain) {
        (Some((times, with)), gain) if gain.as_ref().is_none_or(|(other, _)| times >= *other) => {
            Some(format!(
                "radius: the readings fit {times:.1} times better with a radius of {:.5} mm than with {:.5} mm; the offset then moves by {:.4} mm: check the radius, or free it (--free radius)",
                ball.radius.0 + with.radius_error.0,
                ball.radius.0,
                moved(&with)
            ))
        }
        (_, Some((times, with))) => Some(format!(
            "gain: the readings fit {times:.1} times better with a gain of {:.6}; the offset then moves by {:.4} mm: check that they are millimetres of this lens, or free it (--free gain)",
            with.sensor.gain,
            moved(&with)
        )),
        _ => None,
    }
}

/// How many times smaller the rms becomes with one unknown more, where that is no chance, and the fit.
fn better(
    read: &[BallReading],
    balls: &[CalibrationBall],
    with: &PointQuestion,
    fit: &PointCalibration,
) -> Option<(f64, PointCalibration)> {
    let with = calibrate(read, balls, with).ok()?;
    let squares = |of: &PointCalibration| of.stats.rms.0.powi(2) * read.len() as f64;
    let (before, after) = (squares(fit), squares(&with));
    let dof = with.stats.dof;
    let is_sure = (before - after) * dof as f64 > SURE * SURE * after;
    (dof >= LEAST_DOF && is_sure).then(|| ((before / after).sqrt(), with))
}
