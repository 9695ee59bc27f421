//! From readings to a calibration.

use super::calibration::PointCalibration;
use super::error::PointRefusal;
use super::model::View;
use super::reading::{BallReading, CalibrationBall, PointQuestion, ResidualNoise};
use super::search::{self, Outcome};
use super::{identify, uncertainty};
use crate::fit::solve::linalg::unit;
use crate::units::Mm;

/// Calibrates a point sensor on one or several balls.
///
/// `readings` name their ball by its index in `balls`. The answer is the least
/// minimum of the sum of squared residuals with a on the side of
/// [`PointQuestion::direction`] and, with the radius free, a radius error below a
/// fifth of the radius (an infinite ball and a beam within the plane of the
/// axes would fit, too).
///
/// # Accuracy
/// Thirteen readings on three circles of a 120 degree cone of a 20 mm ball, 5 mm
/// of stand-off among them, with 1 µm of noise give t to 20 µm across the beam.
/// t and a are correlated: a point at the stand-off is known to 0.7 µm.
///
/// # Errors
/// Every [`PointRefusal`] says what to measure instead.
pub fn calibrate(
    readings: &[BallReading],
    balls: &[CalibrationBall],
    wanted: &PointQuestion,
) -> Result<PointCalibration, PointRefusal> {
    match (wanted.free_gain, wanted.free_radius) {
        (false, false) => solve::<5>(readings, balls, wanted),
        (true, false) => solve::<6>(readings, balls, wanted),
        (false, true) => {
            not_one_circle::<5>(readings, balls, wanted)?;
            solve::<6>(readings, balls, wanted)
        }
        (true, true) => {
            not_one_circle::<6>(readings, balls, wanted)?;
            solve::<7>(readings, balls, wanted)
        }
    }
}

/// Refuses points on one circle before the radius is asked for: with it free
/// the search would run along the circle's axis and end anywhere. The radius
/// that is given shows the circle well enough.
fn not_one_circle<const K: usize>(
    readings: &[BallReading],
    balls: &[CalibrationBall],
    wanted: &PointQuestion,
) -> Result<(), PointRefusal> {
    let rough = unit(&wanted.direction).ok_or(PointRefusal::NoDirection)?;
    let fixed = PointQuestion {
        free_radius: false,
        ..*wanted
    };
    let view = View::<K>::new(readings, balls, &fixed)?;
    identify::before(&view)?;
    match search::least(&view, &rough) {
        Outcome::Found(found) => identify::one_circle(&view, &found.beam),
        // What is wrong is told where all unknowns are free.
        Outcome::Nowhere(_) | Outcome::Valley(_) | Outcome::OtherWay { .. } => Ok(()),
    }
}

/// Passes of the weighted fit. The weights change by the angle that a changes
/// by, which is small after the first pass already.
const WEIGHT_PASSES: u32 = 4;

/// The calibration with K unknowns.
fn solve<const K: usize>(
    readings: &[BallReading],
    balls: &[CalibrationBall],
    wanted: &PointQuestion,
) -> Result<PointCalibration, PointRefusal> {
    let rough = unit(&wanted.direction).ok_or(PointRefusal::NoDirection)?;
    let mut view = View::<K>::new(readings, balls, wanted)?;
    identify::before(&view)?;
    // A set without an answer often shows why where the search ended.
    let found = match search::least(&view, &rough) {
        Outcome::Found(found) => found,
        Outcome::Nowhere(ended) => {
            return Err(ended
                .and_then(|beam| identify::at(&view, &beam, false).err())
                .unwrap_or(PointRefusal::NoConvergence));
        }
        Outcome::Valley(beam) => {
            // What is left there is noise, or the way that is left.
            return Err(identify::at(&view, &beam, false)
                .and_then(|()| identify::at(&view, &beam, true))
                .err()
                .unwrap_or(PointRefusal::NoConvergence));
        }
        Outcome::OtherWay { beam, rms } => {
            return Err(identify::at(&view, &beam, true)
                .err()
                .unwrap_or(PointRefusal::OtherWay { rms: Mm(rms) }));
        }
    };
    identify::at(&view, &found.beam, true)?;
    search::single(&view, &found)?;
    let mut beam = found.beam;
    let cov_local = match wanted.noise {
        ResidualNoise::Everywhere => search::settle(&view, &mut beam)?,
        ResidualNoise::AlongBeam => {
            let mut cov = [[0.0; K]; K];
            for _pass in 0..WEIGHT_PASSES {
                view.weigh_by(&beam);
                cov = search::settle(&view, &mut beam)?;
            }
            cov
        }
    };
    let answer = uncertainty::answer(&view, &beam, &cov_local, found.mirror);
    identify::certain(&answer, view.least_radius())?;
    Ok(answer)
}
