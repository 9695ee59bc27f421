//! Centres of balls on a part that turns, straight from a scan: at each angle at which the axis stood still, the ball of
//! the profiles that were taken there. They are what [`axis`](crate::calibrate::axis) wants.
//!
//! A centre is told in the frame of what carries the axis, with the joints before it taken back to 0: there the axis
//! stands as the machine file has it, wherever those joints were. Joints behind it must stand still in all of the scan.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use umi_core::fit::sphere;
use umi_core::units::Point;
use umi_kinematics::{AxisChain, JointKind, Pose};

use super::Balls;
use crate::ScanError;
use crate::calibrate::features::algebraic_centre;
use crate::calibrate::shapes::{ProfileShape, Wanted, find};
use crate::format::profiles::{self, Depth};
use crate::format::triggers::Triggers;
use crate::merge::Merger;
use crate::pair::{PairOptions, pair};

/// What is looked for, and how.
#[derive(Debug, Clone)]
pub struct CentresOptions {
    /// How profiles find their latches.
    pub pairing: PairOptions,
    /// The sensor sees so many microseconds after the edge.
    pub latency_us: f64,
    /// The name of the rotary axis.
    pub axis: String,
    /// Of the balls.
    pub radius_mm: f64,
    /// A sample within this of an arc may be of it; then within four standard deviations.
    pub within_mm: f64,
    /// Balls are further apart than this.
    pub apart_mm: f64,
    /// At most so many samples of a profile are taken, evenly.
    pub samples: usize,
    /// An axis that turns by no more stands still.
    pub still_deg: f64,
}

/// What was found, used and left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeenCentres {
    /// The axis.
    pub axis: String,
    /// Profiles that were read.
    pub profiles: u64,
    /// With a latch.
    pub paired: u64,
    /// In which there was no arc of such a ball.
    pub nothing_found: u64,
    /// With an arc, in a stand that gave no centre: the axis was turning, or the profiles reach over too little of the ball.
    pub too_narrow: u64,
    /// With an arc, in a stand whose arcs are of no one ball of this radius.
    pub no_ball: u64,
    /// The centres, as they came.
    pub centres: Vec<SeenCentre>,
    /// What is odd, but no reason to refuse.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// A ball at an angle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeenCentre {
    /// What the axis showed.
    pub angle_deg: f64,
    /// Which ball.
    pub ball: String,
    /// In the frame of what carries the axis.
    pub centre_mm: [f64; 3],
    /// Profiles that it is of.
    pub profiles: u64,
    /// Of the samples about the ball.
    pub rms_mm: f64,
    /// Largest standard uncertainty, by the samples' scatter alone.
    pub u_mm: f64,
}

impl SeenCentres {
    /// The table `angle_deg,ball,x_mm,y_mm,z_mm`, with what each centre rests on beside it.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::from("angle_deg,ball,x_mm,y_mm,z_mm,profiles,rms_mm,u_mm\n");
        for c in &self.centres {
            let [x, y, z] = c.centre_mm;
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{},{},{x},{y},{z},{},{},{}",
                c.angle_deg, c.ball, c.profiles, c.rms_mm, c.u_mm
            );
        }
        text
    }
}

/// Profiles of a ball must reach over so much of its radius, across the laser's plane.
const LEAST_REACH: f64 = 0.3;
/// A ball needs profiles of at least so many.
const FEWEST_PROFILES: usize = 3;
/// Joints behind the axis that move by less stand still, mm or degrees.
const STILL: f64 = 0.005;
/// A radius that is off by more of its standard uncertainties is another one.
const OFF_SIGMAS: f64 = 5.0;

/// What was seen of a ball while the axis stood.
struct Stand {
    ball: String,
    profiles: u64,
    points: Vec<Vector3<f64>>,
    /// The least and the greatest place of a profile's plane, along its normal.
    reach_mm: [f64; 2],
}

/// Finds the balls at each angle of an axis.
///
/// # Errors
/// `missing_axis` for an axis that is none, or turns the sensor; `moved` where a joint behind it did; `motion_lost`;
/// `too_few_points` where no ball was found; those of pairing and merging.
pub fn centres(
    path: &Path,
    triggers: &Triggers,
    machine: &AxisChain,
    options: &CentresOptions,
) -> Result<SeenCentres, ScanError> {
    let joint = find_axis(machine, &options.axis)?;
    let behind = (machine.workpiece_chain.iter().position(|&j| j == joint))
        .map_or(&[][..], |at| &machine.workpiece_chain[at + 1..]);
    let merger = Merger::new(machine, triggers, options.latency_us)?;
    let came = profiles::stamps(path)?;
    let pairing = pair(&came.stamps, triggers, &options.pairing)?;
    if pairing.pairs.iter().any(|pair| !merger.knows(pair.latch)) {
        return Err(ScanError::refused(
            "motion_lost",
            "the board lost motion of an axis during this scan: scan again",
        ));
    }
    let latches: std::collections::HashMap<u64, usize> = pairing
        .pairs
        .iter()
        .map(|pair| (pair.profile, pair.latch))
        .collect();
    let mut seen = SeenCentres {
        axis: options.axis.clone(),
        profiles: came.stamps.len() as u64,
        paired: latches.len() as u64,
        nothing_found: 0,
        too_narrow: 0,
        no_ball: 0,
        centres: Vec::new(),
        warnings: came.warning().into_iter().collect(),
    };
    let mut balls = Balls::unknown(options.apart_mm);
    let mut radii = Vec::new();
    let mut begin: Option<Vec<f64>> = None;
    // The angle at which the axis stands, and what was seen there.
    let mut angle_deg = f64::NAN;
    let mut stands: Vec<Stand> = Vec::new();
    profiles::visit(path, Depth::Samples, |profile| {
        let Some(&latch) = latches.get(&profile.stamp.profile) else {
            return Ok(());
        };
        let q = merger.joints(latch);
        let at_begin = begin.get_or_insert_with(|| q.clone());
        for &other in behind {
            let by = q[other] - at_begin[other];
            if by.abs() > STILL {
                return Err(moved(&machine.joints[other].name, &options.axis, by));
            }
        }
        let angle = q[joint];
        // Not so for the first one either, where there is no angle yet.
        if (angle - angle_deg).abs() > options.still_deg || angle_deg.is_nan() {
            close(&mut stands, angle_deg, options, &mut radii, &mut seen);
            angle_deg = angle;
        }
        let wanted = Wanted::Arc(Some(options.radius_mm));
        let found = find(profile.samples, wanted, options.within_mm);
        let (Some(found), Some(pose)) = (found, machine.sensor_before(joint, &q)) else {
            seen.nothing_found += 1;
            return Ok(());
        };
        let ProfileShape::Circle { x, z, .. } = found.shape else {
            seen.nothing_found += 1;
            return Ok(());
        };
        // Balls are told apart on the part that turns.
        let about = pose.point(&Vector3::new(x, 0.0, z));
        let turned = machine.joints[joint].transform(angle).inverse();
        let Some(ball) = balls.name(&turned.point(&about)) else {
            seen.nothing_found += 1;
            return Ok(());
        };
        let every = found.kept.len().div_ceil(options.samples.max(1));
        let points = found.kept.iter().step_by(every).filter_map(|&place| {
            let sample = profile.samples.get(place)?;
            Some(pose.point(&Vector3::new(sample.x_mm, 0.0, sample.z_mm)))
        });
        let across = across_plane(&pose);
        match stands.iter_mut().find(|stand| stand.ball == ball) {
            Some(stand) => {
                stand.profiles += 1;
                stand.points.extend(points);
                stand.reach_mm = [stand.reach_mm[0].min(across), stand.reach_mm[1].max(across)];
            }
            None => stands.push(Stand {
                ball,
                profiles: 1,
                points: points.collect(),
                reach_mm: [across; 2],
            }),
        }
        Ok(())
    })?;
    close(&mut stands, angle_deg, options, &mut radii, &mut seen);
    if seen.centres.is_empty() {
        return Err(ScanError::refused(
            "too_few_points",
            format_args!(
                "at no angle of {} was a ball of {} mm found in {} profiles with a latch: let the axis stand still while the \
                 line goes over the ball, with {FEWEST_PROFILES} profiles or more on it; of {} profiles with an arc the axis was \
                 turning or the line went over too little of the ball, {} had no arc",
                options.axis,
                options.radius_mm,
                seen.paired,
                seen.too_narrow,
                seen.nothing_found
            ),
        )
        .with("too_narrow", seen.too_narrow)
        .with("nothing_found", seen.nothing_found)
        .with("no_ball", seen.no_ball));
    }
    seen.warnings
        .extend(other_radius(&radii, options.radius_mm));
    Ok(seen)
}

fn find_axis(machine: &AxisChain, name: &str) -> Result<usize, ScanError> {
    let refused = |what: &str| {
        let turning = machine.workpiece_chain.iter();
        let turning = turning.filter_map(|&place| machine.joints.get(place));
        let turning: Vec<&str> = turning
            .filter(|joint| joint.kind == JointKind::Rotary && joint.constant().is_none())
            .map(|joint| joint.name.as_str())
            .collect();
        let there = if turning.is_empty() {
            "the machine file has none".to_owned()
        } else {
            format!("there are: {}", turning.join(", "))
        };
        ScanError::refused(
            "missing_axis",
            format_args!("{name:?} {what}. A rotary axis that carries the part is needed: {there}"),
        )
        .with("joint", name)
    };
    let Some(place) = machine.joints.iter().position(|joint| joint.name == name) else {
        return Err(refused("is no joint of the machine file"));
    };
    let joint = &machine.joints[place];
    if joint.kind != JointKind::Rotary {
        return Err(refused("does not turn"));
    }
    if joint.constant().is_some() {
        return Err(refused("never moves: the machine file gives it a value"));
    }
    if !machine.workpiece_chain.contains(&place) {
        return Err(refused(
            "does not carry the part; of an axis that turns the sensor, give the centres themselves",
        ));
    }
    Ok(place)
}

fn moved(other: &str, axis: &str, by: f64) -> ScanError {
    ScanError::refused(
        "moved",
        format_args!(
            "the joint {other:?} is carried by {axis:?} and moved by {by:.4} in this scan: the balls moved on the part. Scan with \
             {other:?} at one place"
        ),
    )
    .with("joint", other)
}

/// Where the laser's plane stands along its own normal. Profiles of one scan have planes that are all but parallel.
fn across_plane(pose: &Pose) -> f64 {
    pose.rotation.column(1).dot(&pose.translation_mm)
}

/// The axis moves on: what was seen until now becomes centres, or is counted.
fn close(
    stands: &mut Vec<Stand>,
    angle_deg: f64,
    options: &CentresOptions,
    radii: &mut Vec<(f64, f64)>,
    seen: &mut SeenCentres,
) {
    for stand in stands.drain(..) {
        let [least, most] = stand.reach_mm;
        if stand.profiles < FEWEST_PROFILES as u64 || most - least < LEAST_REACH * options.radius_mm
        {
            seen.too_narrow += stand.profiles;
            continue;
        }
        let Some(ball) = of_radius(&stand.points, options.radius_mm) else {
            seen.no_ball += stand.profiles;
            continue;
        };
        if ball.rms_mm > options.within_mm {
            seen.no_ball += stand.profiles;
            continue;
        }
        radii.extend(own_radius(&stand.points));
        seen.centres.push(SeenCentre {
            angle_deg,
            ball: stand.ball,
            centre_mm: ball.centre_mm.into(),
            profiles: stand.profiles,
            rms_mm: ball.rms_mm,
            u_mm: ball.u_mm,
        });
    }
}

struct FoundBall {
    centre_mm: Vector3<f64>,
    rms_mm: f64,
    u_mm: f64,
}

/// The ball of a known radius through points, by Gauss and Newton; none where that goes nowhere.
fn of_radius(points: &[Vector3<f64>], radius_mm: f64) -> Option<FoundBall> {
    const STEPS: usize = 50;
    let mut centre = algebraic_centre(points);
    for _ in 0..STEPS {
        let (mut normal, mut right, mut squares) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for point in points {
            let arm = point - centre;
            let length = arm.norm();
            let out = arm.try_normalize(1e-9)?;
            let off = length - radius_mm;
            normal += out * out.transpose();
            right += out * off;
            squares += off * off;
        }
        let step = normal.cholesky()?.solve(&right);
        centre += step;
        if step.norm() < 1e-10 * radius_mm.max(1.0) {
            let dof = points.len().checked_sub(3).filter(|dof| *dof > 0)?;
            let variance = squares / dof as f64;
            let inverse = normal.try_inverse()?;
            let largest = inverse.symmetric_eigen().eigenvalues.max();
            return Some(FoundBall {
                centre_mm: centre,
                rms_mm: (squares / points.len() as f64).sqrt(),
                u_mm: (variance * largest).sqrt(),
            })
            .filter(|ball| ball.u_mm.is_finite());
        }
    }
    None
}

/// The radius that the points have by themselves, and its standard uncertainty.
fn own_radius(points: &[Vector3<f64>]) -> Option<(f64, f64)> {
    let points: Vec<Point> = points.iter().map(|&mm| Point { mm }).collect();
    let ball = sphere::fit(&points).ok()?;
    let sigma = ball.stats.sigma?.0;
    Some((ball.radius.0, sigma * ball.cov_unit[3][3].sqrt()))
}

/// A word where the balls have another radius than was said: their centres are off along the sensor's view by about as much.
fn other_radius(radii: &[(f64, f64)], radius_mm: f64) -> Option<String> {
    let weights: f64 = radii.iter().map(|(_, u)| u.powi(-2)).sum();
    let mean = radii.iter().map(|(r, u)| r * u.powi(-2)).sum::<f64>() / weights;
    let u_mm = weights.powf(-0.5);
    // Exact points know their radius to rounding.
    let limit = (OFF_SIGMAS * u_mm).max(1e-4);
    ((mean - radius_mm).abs() > limit).then(|| {
        format!(
            "radius: the balls look like {mean:.4} mm (standard uncertainty {u_mm:.4} mm), not {radius_mm} mm: the centres are off \
             along the sensor's view; look at --radius-mm, the ball's paint or dust, and the sensor's own scale"
        )
    })
}
