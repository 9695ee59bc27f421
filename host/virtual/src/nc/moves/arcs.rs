//! Arcs and helices: `G2`, `G3`.

use std::f64::consts::PI;

use nalgebra::Vector3;
use umi_core::units::Rad;

use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::motion::{AxisDrives, AxisMotion, MotionPath};
use crate::nc::memory::settings::ControlFamily;
use crate::nc::run::control::Control;
use crate::nc::run::execute::finite;
use crate::nc::run::words::Words;

/// Turns of one arc (LinuxCNC's P).
const MAX_TURNS: u32 = 1000;

impl Control {
    /// Moves on an arc in the selected plane; travel along its normal makes a helix.
    /// I, J and K lead from the start to the centre, or are its coordinates (`G90.1`). The
    /// angle follows from the start's and the end's directions; both ends on one spot are a
    /// full circle.
    pub(crate) fn arc(
        &mut self,
        words: &Words,
        from: Vector3<f64>,
        to: Vector3<f64>,
        axes: &mut dyn AxisDrives,
    ) -> Checked<()> {
        let [first, second, normal] = self.modal.plane.axes();
        let flat = |v: &Vector3<f64>| -> [f64; 2] {
            [first, second].map(|axis| v.get(axis).copied().unwrap_or(0.0))
        };
        let ([x0, y0], [x1, y1]) = (flat(&from), flat(&to));
        let is_left = self.modal.motion == 30;
        let tolerance = self.settings.arc_tolerance_mm.max(1e-9);

        let letters = [b'I', b'J', b'K'];
        let to_center = [first, second].map(|axis| {
            letters
                .get(axis)
                .and_then(|letter| self.length_word(words, *letter))
        });
        if letters.get(normal).is_some_and(|letter| words.has(*letter)) {
            return Err(Fault::new("the centre lies in the plane: I J, K I or J K"));
        }
        let radius = self.length_word(words, b'R');
        let (cx, cy, sweep) = match (radius, to_center) {
            (Some(_), [Some(_), _] | [_, Some(_)]) => {
                return Err(Fault::new("an arc has R or a centre, not both"));
            }
            (None, [None, None]) => {
                return Err(Fault::ps(22, "an arc needs R, or I, J, K to its centre"));
            }
            (Some(radius), _) => by_radius([x0, y0], [x1, y1], radius, is_left, tolerance)?,
            (None, [i, j]) => {
                let (cx, cy) = match (self.modal.has_absolute_centres, i, j) {
                    (false, i, j) => (x0 + i.unwrap_or(0.0), y0 + j.unwrap_or(0.0)),
                    (true, Some(i), Some(j)) => (i, j),
                    (true, ..) => {
                        return Err(Fault::new("G90.1 needs both coordinates of the centre"));
                    }
                };
                let start = (x0 - cx).hypot(y0 - cy);
                let end = (x1 - cx).hypot(y1 - cy);
                if start < 1e-9 {
                    return Err(Fault::new("the centre is the start: an arc needs a radius"));
                }
                // What is no number does not fit either.
                let fits = (start - end).abs() <= tolerance;
                if !fits {
                    return Err(Fault::ps(
                        20,
                        format!(
                            "the radii differ: {start:.4} mm at the start, {end:.4} mm at the end"
                        ),
                    ));
                }
                let turn = angle([x0 - cx, y0 - cy], [x1 - cx, y1 - cy], is_left);
                (cx, cy, turn)
            }
        };
        let is_linuxcnc = self.settings.dialect == ControlFamily::LinuxCnc;
        let turns = words.whole(b'P', MAX_TURNS)?;
        let sweep = match turns.filter(|_| is_linuxcnc) {
            None => sweep,
            Some(0) => return Err(Fault::new("P counts the turns of an arc: 1 or more")),
            Some(turns) => sweep + sweep.signum() * 2.0 * PI * f64::from(turns - 1),
        };
        let rise = (to - from).get(normal).copied().unwrap_or(0.0);
        let around = (x0 - cx).hypot(y0 - cy) * sweep;
        let rate = self.feed_along(words, around.hypot(rise))?;
        let mut center = from;
        let mut axis = Vector3::zeros();
        for (slot, value) in [(first, cx), (second, cy)] {
            if let Some(c) = center.get_mut(slot) {
                *c = value;
            }
        }
        if let Some(slot) = axis.get_mut(normal) {
            *slot = 1.0;
        }
        let frame = self.frame();
        axes.travel(&AxisMotion {
            to: finite(frame.apply(to))?,
            path: MotionPath::Arc {
                center: finite(frame.apply(center))?,
                axis: frame.turn * axis,
                sweep: Rad(sweep),
            },
            rate,
        })?;
        self.look(axes);
        Ok(())
    }
}

/// The angle from one direction to another, positive to the left; none is a full turn.
fn angle(from: [f64; 2], to: [f64; 2], is_left: bool) -> f64 {
    let [x0, y0] = from;
    let [x1, y1] = to;
    let turn = libm::atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1);
    // An end that rounding puts a hair behind the start is a full circle, too.
    let turn = if turn.abs() < 1e-9 { 0.0 } else { turn };
    match (is_left, turn > 0.0) {
        (true, true) | (false, false) if turn != 0.0 => turn,
        (true, _) => turn + 2.0 * PI,
        (false, _) => turn - 2.0 * PI,
    }
}

/// Centre and angle from a radius: below half a turn, or above with a negative one.
fn by_radius(
    [x0, y0]: [f64; 2],
    [x1, y1]: [f64; 2],
    radius: f64,
    is_left: bool,
    tolerance: f64,
) -> Checked<(f64, f64, f64)> {
    let (dx, dy) = (x1 - x0, y1 - y0);
    let half = dx.hypot(dy) / 2.0;
    if half < 1e-9 {
        return Err(Fault::new(
            "an arc with R needs an end apart from its start: a full circle has I, J, K",
        ));
    }
    let reaches = half <= radius.abs() + tolerance;
    if !reaches {
        return Err(Fault::ps(
            20,
            format!(
                "R{radius} does not reach: the ends are {:.4} mm apart",
                2.0 * half
            ),
        ));
    }
    let height = libm::sqrt((radius * radius - half * half).max(0.0));
    // The centre of a left turn below half a turn lies to the left.
    let side = if is_left == (radius > 0.0) {
        height
    } else {
        -height
    };
    let (nx, ny) = (-dy / (2.0 * half), dx / (2.0 * half));
    let (cx, cy) = (
        f64::midpoint(x0, x1) + side * nx,
        f64::midpoint(y0, y1) + side * ny,
    );
    let turn = angle([x0 - cx, y0 - cy], [x1 - cx, y1 - cy], is_left);
    Ok((cx, cy, turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quarter turns both ways, three quarters, full circles.
    #[test]
    fn angles() {
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(angle([1.0, 0.0], [0.0, 1.0], true), PI / 2.0);
        near(angle([1.0, 0.0], [0.0, 1.0], false), -1.5 * PI);
        near(angle([1.0, 0.0], [1.0, 0.0], true), 2.0 * PI);
        near(angle([1.0, 0.0], [1.0, -1e-13], true), 2.0 * PI);
        near(angle([1.0, 0.0], [1.0, 0.0], false), -2.0 * PI);
    }

    /// R positive below half a turn, negative above; too short a radius is refused.
    #[test]
    fn radius() {
        let (cx, cy, turn) = by_radius([1.0, 0.0], [0.0, 1.0], 1.0, true, 0.01).expect("reaches");
        assert!(cx.abs() < 1e-12 && cy.abs() < 1e-12);
        assert!((turn - PI / 2.0).abs() < 1e-12);
        let (cx, cy, turn) = by_radius([1.0, 0.0], [0.0, 1.0], -1.0, true, 0.01).expect("reaches");
        assert!((cx - 1.0).abs() < 1e-12 && (cy - 1.0).abs() < 1e-12);
        assert!((turn - 1.5 * PI).abs() < 1e-12);
        assert!(by_radius([0.0, 0.0], [3.0, 0.0], 1.0, true, 0.01).is_err());
        assert!(by_radius([0.0, 0.0], [0.0, 0.0], 1.0, true, 0.01).is_err());
    }
}
