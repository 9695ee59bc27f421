//! Poses that look alike: the axes and orders behind them.

use nalgebra::Matrix3;
use serde_json::{Value, json};

use crate::ScanError;
use crate::localise::search::pairs::Prepared;
use crate::rigid::{Pose, Vec3, rotation, rotation_vector, rows};
use crate::solve::eigen;

/// An axis about which the part looks the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SymmetryAxis {
    /// The direction in part coordinates.
    pub axis: Vec3,
    /// A point on it in part coordinates, in mm.
    pub point_mm: Vec3,
    /// How many times in a whole turn; 0: at any angle.
    pub order: u32,
}

/// The middle of the part's surface, and its principal axes as columns.
fn principal(prepared: &Prepared) -> (Vec3, Matrix3<f64>) {
    let n = prepared.samples.len().max(1) as f64;
    let middle = prepared.samples.iter().map(|s| s.at).sum::<Vec3>() / n;
    let mut spread = Matrix3::zeros();
    for s in &prepared.samples {
        let off = s.at - middle;
        spread += off * off.transpose() / n;
    }
    (middle, eigen(&spread).1)
}

/// Reflections of the part that are worth a try: in the planes of its principal axes and of its box, and in the middles.
pub(in crate::localise) fn reflections(prepared: &Prepared) -> Vec<Pose> {
    let (middle, axes) = principal(prepared);
    let centre = (prepared.corners[0] + prepared.corners[7]) / 2.0;
    [(middle, axes), (centre, Matrix3::identity())]
        .into_iter()
        .flat_map(|(point, axes)| {
            let planes = (0..3).map(move |k| {
                let n = axes.column(k).into_owned();
                Matrix3::identity() - n * n.transpose() * 2.0
            });
            let all = planes.chain([-Matrix3::identity()]);
            all.map(move |rotation| Pose {
                rotation,
                translation_mm: point - rotation * point,
            })
        })
        .collect()
}

/// Motions of the part onto itself that are worth a try: turns by 1/2 to 1/12 about its principal axes.
pub(in crate::localise) fn candidates(prepared: &Prepared) -> Vec<Pose> {
    let (middle, axes) = principal(prepared);
    let (low, high) = (prepared.corners[0], prepared.corners[7]);
    let centre = (low + high) / 2.0;
    let mut all = Vec::new();
    let mut about = |axis: Vec3, point: Vec3, parts: &[u32]| {
        for &n in parts {
            let turn = rotation(&(axis * (std::f64::consts::TAU / f64::from(n))));
            all.push(Pose {
                rotation: turn,
                translation_mm: point - turn * point,
            });
        }
    };
    for k in 0..3 {
        about(
            axes.column(k).into_owned(),
            middle,
            &[2, 3, 4, 5, 6, 8, 10, 12],
        );
        let mut axis = Vec3::zeros();
        axis[k] = 1.0;
        about(axis, centre, &[2, 3, 4, 5, 6, 8, 10, 12]);
    }
    all
}

/// A turn is a whole one's part if it is so to this angle in rad; a symmetry does not shift along its axis by more than
/// this share of the part's size, and its axis goes through the part.
const WHOLE: f64 = 0.01;
const SHIFTED: f64 = 0.02;
/// A symmetry whose least turn was not found has at most this order.
const FEW: u32 = 6;
/// So many turns about one axis, none of them a whole one's part, are turns by any angle.
const ANY: usize = 3;

/// How many times such a turn makes the part look the same in a whole one, if it is of that kind: two parts in one scan
/// can stand at any angle to each other.
fn order(angle: f64) -> Option<u32> {
    let of = |n: u32, times: u32| std::f64::consts::TAU * f64::from(times) / f64::from(n);
    let first = (std::f64::consts::TAU / angle).round() as u32;
    if first >= 2 && (of(first, 1) - angle).abs() < WHOLE {
        return Some(first);
    }
    (2..=FEW).find(|&n| (2..n).any(|times| (of(n, times) - angle).abs() < WHOLE))
}

/// The axes of the group that these motions of the part belong to. `box_corners`: those of the part.
pub(in crate::localise) fn axes(motions: &[Pose], box_corners: &[Vec3]) -> Vec<SymmetryAxis> {
    let (low, high) = crate::surface::bounds(box_corners.iter());
    let (centre, size) = ((low + high) / 2.0, (high - low).norm());
    let mut found: Vec<(SymmetryAxis, f64, usize)> = Vec::new();
    for motion in motions {
        let w = rotation_vector(&motion.rotation);
        let angle = w.norm();
        if angle < 0.05 {
            continue;
        }
        let mut axis = w / angle;
        let off = (centre - on_axis(motion, &axis)).cross(&axis).norm();
        if motion.translation_mm.dot(&axis).abs() > SHIFTED * size || off > 0.5 * size {
            continue;
        }
        // One of the two directions: the largest component is positive.
        if axis[axis.iamax()] < 0.0 {
            axis = -axis;
        }
        let same = found
            .iter_mut()
            .find(|(known, ..)| known.axis.cross(&axis).norm() < 0.03);
        match same {
            Some((_, least, count)) => {
                *least = least.min(angle);
                *count += 1;
            }
            None => found.push((
                SymmetryAxis {
                    axis,
                    point_mm: on_axis(motion, &axis),
                    order: 0,
                },
                angle,
                1,
            )),
        }
    }
    found
        .into_iter()
        .filter_map(|(axis, least, count)| {
            // Several turns of no order are turns by any angle; one is no symmetry.
            let any = (count >= ANY).then_some(0);
            let order = order(least).or(any)?;
            Some(SymmetryAxis { order, ..axis })
        })
        .collect()
}

/// The refusal of a scan with several answers: `what` and what to do (`advice`).
pub(in crate::localise) fn ambiguous(
    axes: &[SymmetryAxis],
    motions: &[Pose],
    what: &str,
    advice: &str,
) -> ScanError {
    let listed: Vec<Value> = axes
        .iter()
        .map(|a| json!({"axis": a.axis.as_slice(), "point_mm": a.point_mm.as_slice(), "order": a.order}))
        .collect();
    let poses: Vec<Value> = motions
        .iter()
        .map(|m| json!({"rotation": rows(&m.rotation), "translation_mm": m.translation_mm.as_slice()}))
        .collect();
    let mut words: Vec<String> = axes
        .iter()
        .map(|a| {
            let turn = match a.order {
                0 => "turned by any angle".to_string(),
                order => format!("turned by {} degrees", degrees(order)),
            };
            format!("{turn} about {}", named(&a.axis))
        })
        .collect();
    if let ([first, other, ..], true) = (motions, words.is_empty()) {
        let by = first.inverse().after(other);
        let (shift, turn) = (
            by.translation_mm.norm(),
            rotation_vector(&by.rotation).norm(),
        );
        words.push(if turn < 0.05 {
            format!("shifted by {shift:.1} mm")
        } else {
            format!(
                "turned by {:.1} degrees, its origin shifted by {shift:.1} mm, which is no symmetry: are there two of it in the scan?",
                turn.to_degrees()
            )
        });
    }
    let how = match words.is_empty() {
        true => String::new(),
        false => format!(" ({})", words.join("; ")),
    };
    ScanError::refused("ambiguous", format_args!("{what}{how}: {advice}"))
        .with("symmetries", listed)
        .with("poses", poses)
}

/// A turn of which so many are a whole one, in degrees.
fn degrees(order: u32) -> String {
    let text = format!("{:.1}", 360.0 / f64::from(order));
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// A direction, as a machinist calls it.
fn named(axis: &Vec3) -> String {
    let along = axis.iamax();
    if axis[along].abs() > 1.0 - 1e-6 {
        return ["X", "Y", "Z"][along].to_owned();
    }
    let digits = [axis.x, axis.y, axis.z].map(|x| format!("{:.3}", (x * 1e3).round() / 1e3 + 0.0));
    format!("({})", digits.join(", "))
}

/// The point of the axis of a turn that is nearest to the origin.
fn on_axis(motion: &Pose, axis: &Vec3) -> Vec3 {
    let t = motion.translation_mm - axis * motion.translation_mm.dot(axis);
    let still = Matrix3::identity() - motion.rotation + axis * axis.transpose();
    still.try_inverse().map_or_else(Vec3::zeros, |inverse| {
        let p = inverse * t;
        p - axis * p.dot(axis)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_that_differ_by_a_shift_alone_are_told_by_it() {
        let shifted = Pose::shift_mm(Vec3::new(0.0, 12.0, 0.0));
        let said = ambiguous(&[], &[Pose::identity(), shifted], "alike", "scan more");
        assert_eq!(said.message, "alike (shifted by 12.0 mm): scan more");
    }

    #[test]
    fn symmetries_are_told_in_degrees_and_never_with_minus_zero() {
        let axis = |axis: Vec3, order| SymmetryAxis {
            axis,
            point_mm: Vec3::zeros(),
            order,
        };
        let all = [
            axis(Vec3::new(1.0, -1e-9, -0.0), 2),
            axis(Vec3::new(-1e-5, 0.6, 0.8), 7),
            axis(Vec3::new(0.0, 0.0, -1.0), 0),
        ];
        let said = ambiguous(&all, &[Pose::identity()], "alike", "scan more");
        assert_eq!(
            said.message,
            "alike (turned by 180 degrees about X; turned by 51.4 degrees about (0.000, 0.600, 0.800); turned by any angle \
             about Z): scan more"
        );
    }

    #[test]
    fn a_quarter_turn_is_an_axis_of_order_four_through_its_fixed_point() {
        let point = Vec3::new(10.0, -4.0, 7.0);
        let turn = |parts: f64| {
            let r = rotation(&(Vec3::z() * (std::f64::consts::TAU / parts)));
            Pose {
                rotation: r,
                translation_mm: point - r * point,
            }
        };
        let corners = [Vec3::new(0.0, -14.0, 0.0), Vec3::new(20.0, 6.0, 10.0)];
        let found = axes(&[turn(2.0), turn(4.0), turn(-4.0)], &corners);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].order, 4);
        assert!((found[0].point_mm - Vec3::new(10.0, -4.0, 0.0)).norm() < 1e-9);
    }

    /// Two parts in one scan stand at any angle to each other, and at any place: that is no symmetry of the part. A turn
    /// whose first part was not found is one.
    #[test]
    fn two_parts_in_a_scan_are_no_symmetry() {
        let corners = [Vec3::zeros(), Vec3::new(120.0, 70.0, 60.0)];
        let middle = Vec3::new(60.0, 35.0, 30.0);
        let about = |point: Vec3, degrees: f64, along: f64| {
            let r = rotation(&(Vec3::z() * degrees.to_radians()));
            Pose {
                rotation: r,
                translation_mm: point - r * point + Vec3::z() * along,
            }
        };
        let told = |motion: Pose| axes(&[motion], &corners).first().map(|axis| axis.order);
        assert_eq!(told(about(middle, 120.0, 0.0)), Some(3));
        assert_eq!(told(about(middle, 120.3, 0.0)), Some(3));
        assert_eq!(told(about(middle, 144.0, 0.0)), Some(5));
        assert_eq!(told(about(middle, 130.3, 0.0)), None);
        assert_eq!(told(about(middle, 120.0, 40.0)), None);
        assert_eq!(told(about(middle * 6.0, 120.0, 0.0)), None);
        let said = ambiguous(
            &[],
            &[Pose::identity(), about(middle, 130.3, 0.0)],
            "alike",
            "scan one",
        );
        assert!(
            said.message.contains("turned by 130.3 degrees"),
            "{}",
            said.message
        );
    }
}
