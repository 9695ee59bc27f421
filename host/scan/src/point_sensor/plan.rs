//! Places from which a calibration is well determined, and the program that goes there.
//!
//! Spirals over the top of the ball, one at each of several stand-offs: a spiral spreads the
//! normals, which shows the offset; the stand-offs spread the readings, which shows the
//! direction. What to expect is not guessed: the places go through the calibration itself.

use serde::Serialize;
use umi_core::point::{BallReading, CalibrationBall, PointQuestion, PointSensor, calibrate};
use umi_core::units::{Mm, Point};

use super::doubts::few_readings;
use crate::ScanError;
use crate::rigid::Vec3;

/// Steeper than this, 60 degrees, a ball sends little light back whatever the sensor's
/// angle, and gives nothing that the conditioning needs.
const WIDEST_RAD: f64 = 1.05;

/// The part of the sensor's angle that is used.
const PART_OF_ANGLE: f64 = 0.9;

/// The part of the depth of field that is used.
const PART_OF_RANGE: f64 = 0.8;

/// The turn from one place of a spiral to the next: the golden angle spreads them evenly.
const GOLDEN_ANGLE_RAD: f64 = 2.399_963_229_728_653;

/// Most places: what a board keeps.
const MOST_PLACES: usize = 400;

/// What is known before a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanQuestion {
    /// Centre of the ball in machine coordinates, mm.
    pub center_mm: [f64; 3],
    /// Its radius, mm.
    pub radius_mm: f64,
    /// Standard uncertainty of the centre, mm.
    pub u_center_mm: f64,
    /// Rough offset of the sensor, mm.
    pub offset_mm: [f64; 3],
    /// Rough direction of the beam, of any length.
    pub direction: [f64; 3],
    /// Stand-off, the middle of the depth of field, mm.
    pub stand_off_mm: f64,
    /// Depth of field, mm.
    pub range_mm: f64,
    /// Half the angle that the sensor sees, degrees.
    pub angle_deg: f64,
    /// Different stand-offs.
    pub stand_offs: usize,
    /// Places altogether.
    pub places: usize,
    /// Expected standard deviation of a distance from the ball, mm.
    pub sigma_mm: f64,
    /// Least step of the axes, mm.
    pub increment_mm: f64,
    /// Height to approach from, machine coordinates, mm.
    pub safe_z_mm: f64,
}

/// One place of the axes, and what the sensor should read there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlannedPlace {
    /// Position of the axes, machine coordinates.
    pub axes_mm: [f64; 3],
    /// The reading, if the rough offset and direction were right.
    pub gamma_mm: f64,
    /// Angle between beam and normal, degrees.
    pub incidence_deg: f64,
}

/// The set, and the uncertainty to expect of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorPlan {
    /// `point_sensor_plan`.
    pub kind: &'static str,
    /// The places in their order.
    pub places: Vec<PlannedPlace>,
    /// Expected standard uncertainties of the offset, the ball's centre included.
    pub u_offset_mm: [f64; 3],
    /// Expected standard uncertainties of the direction.
    pub u_direction: [f64; 3],
    /// Expected standard uncertainties of a point at the stand-off.
    pub u_point_mm: [f64; 3],
    /// What the calibration will warn of: `weak: few readings, …`.
    pub warnings: Vec<String>,
}

/// Makes the set.
///
/// # Errors
/// `bad_input` with what is wrong; what the calibration would refuse.
pub fn plan(question: &PlanQuestion) -> Result<SensorPlan, ScanError> {
    let direction = checked(question)?;
    let sensor = PointSensor {
        offset: Point::from_array_mm(question.offset_mm),
        direction,
        gain: 1.0,
    };
    let places = places(question, &sensor)?;
    let ball = CalibrationBall {
        center: Point::from_array_mm(question.center_mm),
        radius: Mm(question.radius_mm),
        u_center: Mm(question.u_center_mm),
        u_radius: Mm(0.0),
    };
    let readings: Vec<BallReading> = places
        .iter()
        .map(|place| BallReading {
            axes: Point::from_array_mm(place.axes_mm),
            gamma: Mm(place.gamma_mm),
            ball: 0,
        })
        .collect();
    let wanted = PointQuestion {
        direction,
        ..PointQuestion::default()
    };
    let fit = calibrate(&readings, &[ball], &wanted)?;
    // The readings are exact, so the scatter to expect is put in here.
    let variance = question.sigma_mm * question.sigma_mm;
    let mut total = fit.cov_balls;
    for (row, unit) in total.iter_mut().zip(&fit.cov_unit) {
        for (sum, unit) in row.iter_mut().zip(unit) {
            *sum += variance * unit;
        }
    }
    let root = |k: usize| total[k][k].max(0.0).sqrt();
    let place = fit
        .sensor
        .place_covariance(Mm(question.stand_off_mm), &total);
    let warnings = few_readings(fit.stats.dof).into_iter().collect();
    Ok(SensorPlan {
        kind: "point_sensor_plan",
        places,
        u_offset_mm: [0, 1, 2].map(root),
        u_direction: [3, 4, 5].map(root),
        u_point_mm: [0, 1, 2].map(|k: usize| place[k][k].max(0.0).sqrt()),
        warnings,
    })
}

/// The unit direction of a question that makes sense.
fn checked(question: &PlanQuestion) -> Result<Vec3, ScanError> {
    let bad = |message: &str| Err(ScanError::refused("bad_input", message));
    let positive = |x: f64| x.is_finite() && x > 0.0;
    let finite = |all: &[f64; 3]| all.iter().all(|x| x.is_finite());
    if !finite(&question.center_mm) || !finite(&question.offset_mm) {
        return bad("centre and offset are finite lengths in mm");
    }
    if !positive(question.radius_mm) || !positive(question.increment_mm) {
        return bad("the ball's radius and the increment are lengths above 0");
    }
    if !positive(question.range_mm) || !positive(2.0 * question.stand_off_mm - question.range_mm) {
        return bad(
            "the depth of field lies about the stand-off: it is above 0 and below twice it",
        );
    }
    if !(positive(question.angle_deg) && question.angle_deg <= 90.0) {
        return bad("the sensor's angle is above 0 and at most 90 degrees");
    }
    if !positive(question.sigma_mm)
        || !question.u_center_mm.is_finite()
        || question.u_center_mm < 0.0
    {
        return bad(
            "the standard deviations are lengths: sigma above 0, that of the centre 0 or more",
        );
    }
    if question.stand_offs < 2 {
        return bad(
            "two stand-offs at least: readings that are all alike do not show the direction",
        );
    }
    if question.places < 4 * question.stand_offs || question.places > MOST_PLACES {
        return bad("four places for each stand-off at least, and 400 at most");
    }
    let direction = Vec3::from(question.direction);
    let length = direction.norm();
    if !positive(length) {
        return bad("the direction has no length");
    }
    let direction = direction / length;
    if direction.z >= -0.5 {
        return bad("the beam points down, within 60 degrees: the program approaches from above");
    }
    if !question.safe_z_mm.is_finite() {
        return bad("the safe height is a length in mm");
    }
    Ok(direction)
}

fn places(question: &PlanQuestion, sensor: &PointSensor) -> Result<Vec<PlannedPlace>, ScanError> {
    let cone = (question.angle_deg.to_radians() * PART_OF_ANGLE).min(WIDEST_RAD);
    let up = -sensor.direction;
    let e1 = up.cross(&Vec3::new(0.0, 1.0, 0.0)).normalize();
    let e2 = up.cross(&e1);
    let center = Vec3::from(question.center_mm);
    let (levels, all) = (question.stand_offs, question.places);
    let mut places = Vec::with_capacity(all);
    for level in 0..levels {
        // Earlier levels take what does not part evenly.
        let number = all / levels + usize::from(level < all % levels);
        let part = level as f64 / (levels - 1) as f64 - 0.5;
        let gamma = question.stand_off_mm + part * PART_OF_RANGE * question.range_mm;
        for k in 0..number {
            let cos = 1.0 - (k as f64 + 0.5) / number as f64 * (1.0 - cone.cos());
            let sin = (1.0 - cos * cos).sqrt();
            let turn = GOLDEN_ANGLE_RAD * (k + 7 * level) as f64;
            let normal = up * cos + (e1 * turn.cos() + e2 * turn.sin()) * sin;
            let foot = center + normal * question.radius_mm - sensor.direction * gamma;
            let exact = foot - sensor.offset.mm;
            // The axes stand on whole increments; the beam then strikes nearby.
            let axes = exact.map(|x| (x / question.increment_mm).round() * question.increment_mm);
            places.push(seen(question, sensor, axes)?);
        }
    }
    let highest = places.iter().map(|p| p.axes_mm[2]).fold(f64::MIN, f64::max);
    if question.safe_z_mm < highest {
        return Err(ScanError::refused(
            "bad_input",
            format_args!(
                "the safe height {} mm is below the highest place, {highest:.3} mm",
                question.safe_z_mm
            ),
        ));
    }
    Ok(places)
}

/// What the sensor reads with the axes there.
fn seen(
    question: &PlanQuestion,
    sensor: &PointSensor,
    axes: Vec3,
) -> Result<PlannedPlace, ScanError> {
    let from = axes + sensor.offset.mm - Vec3::from(question.center_mm);
    let along = from.dot(&sensor.direction);
    let root = along * along - from.norm_squared() + question.radius_mm * question.radius_mm;
    if root.is_nan() || root <= 0.0 {
        return Err(ScanError::refused(
            "bad_input",
            "a place misses the ball: the increment is too large for its radius",
        ));
    }
    let gamma = -along - root.sqrt();
    let normal = (from + sensor.direction * gamma) / question.radius_mm;
    let cos = -normal.dot(&sensor.direction);
    Ok(PlannedPlace {
        axes_mm: axes.into(),
        gamma_mm: gamma,
        incidence_deg: cos.clamp(-1.0, 1.0).acos().to_degrees(),
    })
}
