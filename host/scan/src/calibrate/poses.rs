//! Poses from which a line scanner's mount is well determined, and the uncertainty to expect.
//!
//! What to expect is not guessed: the profiles that the poses would give go through the
//! calibration itself. What they leave open is refused there, by name.

use nalgebra::{DMatrix, DVector, Vector3};
use serde::Serialize;
use umi_kinematics::{AxisChain, JointKind, Pose};

use super::observations::{Observation, Observations};
use super::sensor::{Artefact, SensorOptions, sensor_by, uncertain, widest_in_words};
use crate::ScanError;
use crate::rigid::Vec3;

/// What is known before.
#[derive(Debug, Clone)]
pub struct PosesQuestion {
    /// A ball or a plane.
    pub on: Artefact,
    /// The ball's centre, or a point in the middle of the plane, in the workpiece's frame.
    pub at_mm: Vec3,
    /// Of the ball.
    pub radius_mm: f64,
    /// Of the plane, in the workpiece's frame, of any length.
    pub normal: Vec3,
    /// How much of the plane is seen about its middle, to each side.
    pub plane_reach_mm: f64,
    /// The rotary joints that move: name, from, to in degrees.
    pub swings: Vec<(String, f64, f64)>,
    /// How long the laser line is.
    pub field_mm: f64,
    /// How deep the sensor sees, about z = `stand_off_mm` of its frame.
    pub range_mm: f64,
    /// z of the middle of what the sensor sees, in its frame.
    pub stand_off_mm: f64,
    /// Profiles.
    pub poses: usize,
    /// Samples of a profile that will be used.
    pub samples: usize,
    /// Expected standard deviation of a sample's distance from the artefact.
    pub sigma_mm: f64,
    /// Which components of the shift stay as they are.
    pub hold: [bool; 3],
    /// The ball's centre is known.
    pub known: bool,
}

/// The answer of `umi scan calibrate plan --machine`.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedPoses {
    /// The names of the joints.
    pub joints: Vec<String>,
    /// Their values for each pose, mm and degrees.
    pub poses: Vec<Vec<f64>>,
    /// Samples that lie on the artefact, altogether.
    pub observations: usize,
    /// Standard uncertainty of wx, wy, wz to expect; 0 where held.
    pub u_turn_rad: [f64; 3],
    /// Of tx, ty, tz.
    pub u_shift_mm: [f64; 3],
    /// The least singular value over the largest, rotations worth 100 mm.
    pub conditioning: f64,
}

/// Steeper than this a surface sends too little light back: 65 degrees.
const LEAST_COSINE: f64 = 0.42;
/// Most poses and samples of a plan.
const MOST: usize = 2000;
/// Steps of additive sequences that spread evenly in up to six dimensions: powers of the inverse
/// of the root of x⁷ = x + 1.
const SPREAD: f64 = 1.112_775_684_278_7;
/// A pose that sees fewer samples is replaced.
const FEWEST: usize = 6;

/// Plans poses.
///
/// # Errors
/// `bad_input`; `missing_axis` for a joint that is none or not rotary; `unreachable` where the
/// linear axes cannot bring the sensor there; what the calibration says of the poses:
/// `unidentifiable`, `too_few_points`; `uncertain` where it would say so at the noise that is expected.
pub fn poses(machine: &AxisChain, question: &PosesQuestion) -> Result<PlannedPoses, ScanError> {
    check(question)?;
    let swings = swings(machine, question)?;
    let moving: Vec<(usize, String)> = machine
        .moving()
        .filter(|(_, joint)| joint.constant().is_none())
        .map(|(place, joint)| (place, joint.name.clone()))
        .collect();
    let mut all = Observations {
        features: vec!["0".into()],
        ..Observations::default()
    };
    let mut poses = Vec::new();
    // Poses from which too little is seen are left out, and others tried in their place.
    for number in 0..8 * question.poses {
        if poses.len() == question.poses {
            break;
        }
        let spread = |dimension: i32| {
            let step = SPREAD.powi(-dimension - 1);
            2.0 * (0.5 + step * (number as f64 + 1.0)).fract() - 1.0
        };
        let q = joints(machine, question, &swings, &spread)?;
        let flange = machine.flange_in_workpiece(&q);
        let seen = profile(question, &flange.after(&machine.sensor));
        if seen.len() < FEWEST.min(question.samples) {
            continue;
        }
        all.points
            .extend(seen.into_iter().map(|seen_mm| Observation {
                flange: all.flanges.len(),
                feature: 0,
                seen_mm,
            }));
        all.profiles.push(poses.len().to_string());
        all.flanges.push(flange);
        poses.push(moving.iter().map(|(place, _)| q[*place]).collect());
    }
    if poses.len() < question.poses {
        return Err(ScanError::refused(
            "unreachable",
            format_args!(
                "from {} of {} poses only enough of the artefact is seen: swing the rotary axes \
                 less, or give the field and range of the sensor",
                poses.len(),
                question.poses
            ),
        ));
    }
    let known = question.known.then(|| {
        let at = (String::from("0"), question.at_mm);
        std::iter::once(at).collect()
    });
    let options = SensorOptions {
        on: question.on,
        radius_mm: Some(question.radius_mm),
        centres: known,
        hold: question.hold,
        bars: Vec::new(),
        allow_misfit: false,
        drop_outliers: false,
    };
    let found = sensor_by(&all, &machine.sensor, &options, "give --known")?;
    let covariance = found
        .covariance_unit
        .map(|row| row.map(|unit| unit * question.sigma_mm.powi(2)));
    refuse_uncertain(&covariance, question)?;
    let u = |i: usize| question.sigma_mm * found.covariance_unit[i][i].max(0.0).sqrt();
    Ok(PlannedPoses {
        joints: moving.into_iter().map(|(_, name)| name).collect(),
        poses,
        observations: all.points.len(),
        u_turn_rad: [u(0), u(1), u(2)],
        u_shift_mm: [u(3), u(4), u(5)],
        conditioning: found.conditioning,
    })
}

/// Poses that the calibration would refuse once they are taken.
fn refuse_uncertain(covariance: &[[f64; 6]; 6], question: &PosesQuestion) -> Result<(), ScanError> {
    let Some(worst) = uncertain(covariance) else {
        return Ok(());
    };
    let centre = if question.on == Artefact::Sphere && !question.known {
        ", make the ball's centre known (--known)"
    } else {
        ""
    };
    let motion = widest_in_words(covariance);
    Err(ScanError::refused(
        "uncertain",
        format_args!(
            "by these poses {worst}: they hardly show the motion {motion} of the flange (t: shift along its axes in mm, w: turn \
             about them in rad). Swing more rotary axes, or farther{centre}, or hold a shift with --hold"
        ),
    )
    .with("component", worst.component)
    .with("standard_uncertainty", worst.uncertainty)
    .with("motion", motion))
}

fn check(question: &PosesQuestion) -> Result<(), ScanError> {
    let bad = |what: &str| Err(ScanError::refused("bad_input", what));
    let above = |value: f64| value.is_finite() && value > 0.0;
    if !question.at_mm.iter().all(|v| v.is_finite()) || !question.stand_off_mm.is_finite() {
        return bad("a place is not finite");
    }
    let lengths = [question.field_mm, question.range_mm, question.sigma_mm];
    if !lengths.into_iter().all(above) {
        return bad("field, range and noise must be above 0");
    }
    match question.on {
        Artefact::Sphere if !above(question.radius_mm) => return bad("a ball needs a radius"),
        Artefact::Plane if !(above(question.normal.norm()) && above(question.plane_reach_mm)) => {
            return bad("a plane needs a normal, and a reach above 0");
        }
        _ => {}
    }
    if !(1..=MOST).contains(&question.poses) || !(1..=MOST).contains(&question.samples) {
        return bad("1 to 2000 poses, and as many samples");
    }
    Ok(())
}

/// The rotary joints that move, with their ranges.
fn swings(
    machine: &AxisChain,
    question: &PosesQuestion,
) -> Result<Vec<(usize, f64, f64)>, ScanError> {
    let mut swings = Vec::new();
    for (name, from, to) in &question.swings {
        let joint = machine
            .moving()
            .find(|(_, joint)| &joint.name == name && joint.kind == JointKind::Rotary)
            .filter(|(_, joint)| joint.constant().is_none());
        let Some((place, _)) = joint else {
            return Err(ScanError::refused(
                "missing_axis",
                format_args!("the machine has no rotary joint {name:?} that moves"),
            )
            .with("joint", name.as_str()));
        };
        if !(from.is_finite() && to.is_finite() && from <= to) {
            return Err(ScanError::refused(
                "bad_input",
                format_args!("{name}: a swing goes from a lesser angle to a greater one"),
            ));
        }
        swings.push((place, *from, *to));
    }
    Ok(swings)
}

/// All joints of a pose: the rotary ones by the spread, the linear ones so that a place in the
/// middle of what the sensor sees is on the artefact.
fn joints(
    machine: &AxisChain,
    question: &PosesQuestion,
    swings: &[(usize, f64, f64)],
    spread: &dyn Fn(i32) -> f64,
) -> Result<Vec<f64>, ScanError> {
    let mut q: Vec<f64> = machine
        .joints
        .iter()
        .map(|joint| joint.constant().unwrap_or(0.0))
        .collect();
    for (dimension, (place, from, to)) in (3..).zip(swings) {
        q[*place] = from + (to - from) * (0.5 + 0.5 * spread(dimension));
    }
    let (at, seen) = match question.on {
        // The line crosses the ball beside its middle, which stands somewhere in the field.
        Artefact::Sphere => (
            question.at_mm,
            Vector3::new(
                0.2 * question.field_mm * spread(0),
                0.6 * question.radius_mm * spread(1),
                question.stand_off_mm + 0.3 * question.range_mm * spread(2) - question.radius_mm,
            ),
        ),
        Artefact::Plane => {
            let normal = question.normal.normalize();
            let e1 = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
            let along = e1 * spread(0) + normal.cross(&e1) * spread(1);
            (
                question.at_mm + along * (0.4 * question.plane_reach_mm),
                Vector3::new(
                    0.0,
                    0.0,
                    question.stand_off_mm + 0.3 * question.range_mm * spread(2),
                ),
            )
        }
    };
    let linear: Vec<usize> = machine
        .moving()
        .filter(|(_, joint)| joint.kind == JointKind::Linear && joint.constant().is_none())
        .map(|(place, _)| place)
        .collect();
    // Seen from the workpiece, the place moves evenly with every linear axis.
    let place = |q: &[f64]| machine.sensor_in_workpiece(q).point(&seen);
    let now = place(&q);
    let mut by = DMatrix::zeros(3, linear.len());
    for (column, &joint) in linear.iter().enumerate() {
        let mut moved = q.clone();
        moved[joint] += 1.0;
        by.set_column(column, &(place(&moved) - now));
    }
    let wanted = DVector::from_column_slice((at - now).as_slice());
    if !linear.is_empty()
        && let Ok(step) = by.svd(true, true).solve(&wanted, 1e-9)
    {
        for (&joint, step) in linear.iter().zip(step.iter()) {
            q[joint] += step;
        }
    }
    // As a control's program has them: 1 µm, 0.001°.
    for (place, joint) in machine.joints.iter().enumerate() {
        if joint.constant().is_none() {
            q[place] = (q[place] * 1e3).round() / 1e3;
        }
    }
    if (place(&q) - at).norm() > 0.1 {
        return Err(ScanError::refused(
            "unreachable",
            "the linear axes cannot bring the sensor over the artefact: three are needed",
        ));
    }
    Ok(q)
}

/// What the sensor would see of the artefact, exactly.
fn profile(question: &PosesQuestion, sensor: &Pose) -> Vec<Vec3> {
    let back = sensor.inverse();
    let at = back.point(&question.at_mm);
    let normal = back.rotation * question.normal;
    let middle = question.stand_off_mm;
    (0..question.samples)
        .filter_map(|i| {
            let share = (i as f64 + 0.5) / question.samples as f64 - 0.5;
            let (z, facing, point) = match question.on {
                Artefact::Sphere => {
                    // Samples of the ball's own width: a real profile has more beside it.
                    let x = at.x + 2.0 * share * question.radius_mm;
                    let height = question.radius_mm.powi(2) - at.y.powi(2) - (x - at.x).powi(2);
                    let height = (height > 0.0).then(|| height.sqrt())?;
                    let z = at.z + height;
                    (z, height / question.radius_mm, Vector3::new(x, 0.0, z))
                }
                Artefact::Plane => {
                    let x = share * question.field_mm;
                    let unit = normal.normalize();
                    let z = (unit.dot(&at) - unit.x * x) / unit.z;
                    (z, unit.z.abs(), Vector3::new(x, 0.0, z))
                }
            };
            let within = (z - middle).abs() <= 0.5 * question.range_mm
                && point.x.abs() <= 0.5 * question.field_mm;
            let on =
                question.on == Artefact::Sphere || (point - at).norm() <= question.plane_reach_mm;
            (facing >= LEAST_COSINE && within && on && z.is_finite()).then_some(point)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine() -> AxisChain {
        let mut text = String::new();
        for (name, kind, direction, at) in [
            ("X", "linear", "[1,0,0]", ""),
            ("Y", "linear", "[0,1,0]", ""),
            ("Z", "linear", "[0,0,1]", ""),
            ("A", "rotary", "[-1,0,0]", "point_mm = [0, 85, 0]"),
            ("C", "rotary", "[0,0,-1]", "point_mm = [0, 0, 0]"),
        ] {
            text += &format!(
                "[[joint]]\nname = \"{name}\"\nkind = \"{kind}\"\ndirection = {direction}\n{at}\n"
            );
        }
        text += "[chain]\nsensor = [\"X\", \"Y\", \"Z\"]\nworkpiece = [\"A\", \"C\"]\n\
                 [sensor]\ntranslation_mm = [0.7, 28, -120]\n";
        AxisChain::parse(&text).unwrap()
    }

    /// A head of C and A, C askew by so much: were it upright, a plane square to Z would not show the shift along X.
    fn head(askew: f64) -> AxisChain {
        let upright = format!("[0, {askew}, 1]");
        let mut text = String::new();
        for (name, kind, direction, at) in [
            ("X", "linear", "[1,0,0]", ""),
            ("Y", "linear", "[0,1,0]", ""),
            ("Z", "linear", "[0,0,1]", ""),
            ("C", "rotary", &upright, "point_mm = [7, 17, 30]"),
            ("A", "rotary", "[1,0,0]", "point_mm = [3, 20, 36]"),
        ] {
            text += &format!(
                "[[joint]]\nname = \"{name}\"\nkind = \"{kind}\"\ndirection = {direction}\n{at}\n"
            );
        }
        text += "[chain]\nsensor = [\"X\", \"Y\", \"Z\", \"C\", \"A\"]\nworkpiece = []\n\
                 [sensor]\ntranslation_mm = [0.7, 28, -120]\n";
        AxisChain::parse(&text).unwrap()
    }

    /// What the calibration would call uncertain is not planned.
    #[test]
    fn poses_that_would_leave_a_shift_uncertain_are_refused() {
        let swung = |a: f64| vec![("A".into(), -a, a), ("C".into(), -40.0, 40.0)];
        let flat = PosesQuestion {
            swings: swung(40.0),
            normal: Vec3::z(),
            ..question(Artefact::Plane)
        };
        let error = poses(&head(2e-4), &flat).unwrap_err();
        assert_eq!(error.code, "uncertain", "{error}");
        assert_eq!(error.details["motion"], "tx", "{error}");
        assert!(
            error.message.contains("or hold a shift with --hold"),
            "{error}"
        );
        assert!(!error.message.contains("--known"), "{error}");
        assert!(poses(&head(0.2), &flat).is_ok());
        // A hardly moves.
        let ball = PosesQuestion {
            swings: swung(0.005),
            ..question(Artefact::Sphere)
        };
        let error = poses(&machine(), &ball).unwrap_err();
        assert_eq!(error.code, "uncertain", "{error}");
        assert!(error.message.contains("--known"), "{error}");
    }

    /// What is advised is what the command and the machine have.
    #[test]
    fn the_advice_names_the_options_of_the_command() {
        let still = |on| PosesQuestion {
            swings: Vec::new(),
            ..question(on)
        };
        let ball = poses(&machine(), &still(Artefact::Sphere)).unwrap_err();
        assert!(ball.message.contains("; or give --known;"), "{ball}");
        assert!(ball.message.contains("No rotary axis moved"), "{ball}");
        let plane = poses(&machine(), &still(Artefact::Plane)).unwrap_err();
        assert!(!plane.message.contains("--known"), "{plane}");
        assert!(!plane.message.contains("--centres"), "{plane}");
        let flat = PosesQuestion {
            normal: Vec3::z(),
            ..question(Artefact::Plane)
        };
        let flat = poses(&machine(), &flat).unwrap_err();
        assert!(
            flat.message
                .contains("an inclined plane at more poses, with all rotary"),
            "{flat}"
        );
    }

    fn question(on: Artefact) -> PosesQuestion {
        PosesQuestion {
            on,
            at_mm: Vec3::new(40.0, 25.0, 30.0),
            radius_mm: 15.0,
            normal: Vec3::new(0.3, -0.2, 1.0),
            plane_reach_mm: 40.0,
            swings: vec![("A".into(), -30.0, 30.0), ("C".into(), -180.0, 180.0)],
            field_mm: 60.0,
            range_mm: 50.0,
            stand_off_mm: 0.0,
            poses: 30,
            samples: 13,
            sigma_mm: 0.005,
            hold: [false; 3],
            known: false,
        }
    }

    #[test]
    fn both_artefacts_determine_a_mount_on_a_tilting_table() {
        for on in [Artefact::Sphere, Artefact::Plane] {
            let plan = poses(&machine(), &question(on)).unwrap();
            assert_eq!(plan.poses.len(), 30);
            assert_eq!(plan.joints, ["X", "Y", "Z", "A", "C"]);
            assert!(plan.conditioning > 1e-3, "{on:?}: {plan:?}");
            assert!(plan.u_shift_mm.iter().all(|u| *u < 0.02 && *u > 1e-4));
            assert!(plan.u_turn_rad.iter().all(|u| *u < 1e-3 && *u > 1e-6));
        }
    }

    #[test]
    fn what_the_poses_leave_open_is_refused_by_name() {
        let still = PosesQuestion {
            swings: Vec::new(),
            ..question(Artefact::Sphere)
        };
        let error = poses(&machine(), &still).unwrap_err();
        assert_eq!(
            (error.code, &error.details["free"]),
            ("unidentifiable", &3.into())
        );
        // A flat plane: the shift along A.
        let flat = PosesQuestion {
            normal: Vec3::z(),
            ..question(Artefact::Plane)
        };
        let error = poses(&machine(), &flat).unwrap_err();
        assert_eq!(
            (error.code, &error.details["free"]),
            ("unidentifiable", &1.into())
        );
        let held = PosesQuestion {
            swings: Vec::new(),
            hold: [true; 3],
            ..question(Artefact::Sphere)
        };
        assert_eq!(poses(&machine(), &held).unwrap().u_shift_mm, [0.0; 3]);
        let wrong = PosesQuestion {
            swings: vec![("X".into(), 0.0, 1.0)],
            ..question(Artefact::Sphere)
        };
        assert_eq!(poses(&machine(), &wrong).unwrap_err().code, "missing_axis");
    }
}
