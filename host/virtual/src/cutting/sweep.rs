//! The way of a motion as straight pieces.

use nalgebra::{Rotation3, Unit, Vector3};

use crate::nc::MotionPath;

/// The farthest that a chord may leave its arc: a tenth of the machine's smallest
/// increment of 0.001 mm would be seen in a deviation map, a hundredth is not.
pub const CHORD_ERROR_MM: f64 = 1.0e-5;

/// More pieces than this are not made of an arc: one turn at a radius of 10 m.
const MAX_PIECES: u32 = 3_000_000;

/// The corners of a way, its start left out and its end exactly as given, each with
/// the part of the way that lies before it.
///
/// A chord of the angle `a` leaves a circle of radius `r` by `r (1 - cos(a/2))`,
/// which is below `r a²/8`.
pub fn corners(
    from: Vector3<f64>,
    to: Vector3<f64>,
    path: &MotionPath,
) -> impl Iterator<Item = (f64, Vector3<f64>)> + use<> {
    let arc = match *path {
        MotionPath::Line => None,
        MotionPath::Arc {
            center,
            axis,
            sweep,
        } => {
            let axis = Unit::new_normalize(axis);
            let arm = from - center.mm;
            let arm = arm - axis.scale(arm.dot(&axis));
            let rise = (to - from).dot(&axis);
            Some((from - arm, arm, axis, sweep.0, rise))
        }
    };
    let pieces = arc.as_ref().map_or(1, |(_, arm, _, sweep, _)| {
        let step = (8.0 * CHORD_ERROR_MM / arm.norm().max(CHORD_ERROR_MM)).sqrt();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a float's cast saturates, and is bounded next"
        )]
        let pieces = (sweep.abs() / step).ceil() as u32;
        pieces.clamp(1, MAX_PIECES)
    });
    (1..=pieces).map(move |piece| {
        let part = f64::from(piece) / f64::from(pieces);
        let corner = match &arc {
            Some((hub, arm, axis, sweep, rise)) if piece < pieces => {
                let turned = Rotation3::from_axis_angle(axis, sweep * part) * arm;
                hub + turned + axis.scale(rise * part)
            }
            _ => to,
        };
        (part, corner)
    })
}
