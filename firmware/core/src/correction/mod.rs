//! A correction: what a control can express of a registration, as its text.
//!
//! A correction is made in two steps. [`plan`] says what a dialect can express
//! of a registration and what it leaves at the part; [`write()`] turns a plan
//! into a program, and needs a [`Cleared`] for it: only a setup without any
//! reason against it yields one. [`dialect`] is the table of what controls
//! understand.
//!
//! # What is expressed
//!
//! The program was written for the nominal clamping, in the work offset with
//! origin `O`. The part now stands at `q = R p + t` in that same frame. With the
//! rotation `M` that the control can make, rounded to its steps, about a point
//! `d` (the origin, where it takes no other), and a shift `O'` that is written:
//!
//! ```text
//! wanted     machine(p) = O + R p + t
//! possible   machine(p) = O' + d + M (p - d)
//! choose     O' = O + R c + t - d - M (c - d)          c the part's middle
//! left over  (R - M) (p - c), and the rounding of O' and d
//! ```
//!
//! So the rounding of angles (half of 0.001 degree is 0.9 µm at 100 mm) and the
//! tilt that a control may not have are as small as they can be at the part. The
//! uncorrected is computed with the numbers as they are written, at the part's eight
//! corners: it is linear in `p`, so no point of the part has more.
//!
//! # Limitations
//!
//! A three-axis machine's tool does not lean with the part: a flat end mill of
//! radius r leaves a heel of r times the tilt, whichever way the path is corrected.
//! That is for the job's limit on the tilt. Where a control can lean the coordinates, a move
//! in X and Y moves Z too: a part program that calls the correction with Z at the top of its
//! travel must come down first (`G53 G0 Z…`).

mod alarm;
pub mod dialect;
mod program;
mod run_check;
mod withheld;

use nalgebra::{Matrix3, Vector3};
use umi_protocol::job::{CorrectionSpec, ProgramEnd};

use crate::registration::RigidTransform;
use crate::units::Mm;
use dialect::{Form, Turn};

pub use alarm::{alarm, alarm_compares};
pub use program::{Cleared, Figures, write, write_given};
pub(crate) use run_check::Compared;
pub use run_check::RunCheck;
pub use withheld::{broken_off, withheld};

/// A correction in the control's steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// The new work offset, or the shift of the set.
    shift: [i64; 3],
    /// The work offset that was probed with.
    probed: [i64; 3],
    /// The point about which it turns.
    point: [i64; 2],
    /// The axis about which it turns.
    axis: [i64; 3],
    /// Angles about X, Y and Z; the last one alone where there is one.
    angles: [i64; 3],
    /// Largest error left at the part's corners.
    pub uncorrected: Mm,
}

/// The numbers do not fit the control's format, or its angles would not be unique.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotExpressible;

/// The largest component of the axis of a rotation as it is written: a direction
/// needs no unit, and with this one its rounding is 0.5 µrad.
const AXIS_MM: f64 = 1000.0;

/// Three angles are not unique where the middle one is 90 degrees; closer to it than
/// this cosine says they are refused.
const LEAST_COSINE: f64 = 1e-3;

/// What `spec`'s dialect can express of `transform`, nominal to measured.
///
/// # Errors
/// [`NotExpressible`] if a number is not finite or too large for the control.
#[inline(never)]
pub fn plan(spec: &CorrectionSpec, transform: &RigidTransform) -> Result<Plan, NotExpressible> {
    let form = dialect::form(spec.dialect);
    let mm = Steps::new(form.decimals_mm, form.limit_mm);
    let deg = Steps::new(form.decimals_deg, 360.0);
    let RigidTransform {
        rotation,
        translation_mm,
    } = transform;
    let min = Vector3::from(spec.part_min_mm);
    let max = Vector3::from(spec.part_max_mm);
    let origin = Vector3::from(spec.probed_origin_mm);
    let mut plan = Plan {
        shift: [0; 3],
        probed: mm.whole_each(&origin)?,
        point: [0; 2],
        axis: [0; 3],
        angles: [0; 3],
        uncorrected: Mm(0.0),
    };

    let mut middle = (min + max) * 0.5;
    let mut point = Vector3::zeros();
    if form.turn == Turn::Point {
        plan.point = [mm.whole(middle.x)?, mm.whole(middle.y)?];
        let [x, y] = plan.point.map(|steps| mm.value(steps));
        middle = Vector3::new(x, y, middle.z);
        point = middle;
    }
    let base = if form.in_set {
        mm.value_each(plan.probed)
    } else {
        Vector3::zeros()
    };

    let turn = plan.turn(spec, &form, transform, &mm, &deg)?;
    let wanted = |p: &Vector3<f64>| origin + rotation * p + translation_mm;
    let turned = |p: &Vector3<f64>| point + turn * (p - point);
    plan.shift = mm.whole_each(&(wanted(&middle) - turned(&middle) - base))?;

    // What the control will do, with the numbers as they are written.
    let shift = base + mm.value_each(plan.shift);
    let mut uncorrected_mm: f64 = 0.0;
    for corner in corners(&min, &max) {
        let error_mm = libm::sqrt((shift + turned(&corner) - wanted(&corner)).norm_squared());
        // `max` would pass over a NaN.
        if error_mm.is_nan() || error_mm > uncorrected_mm {
            uncorrected_mm = error_mm;
        }
    }
    if !uncorrected_mm.is_finite() {
        return Err(NotExpressible);
    }
    plan.uncorrected = Mm(uncorrected_mm);
    Ok(plan)
}

impl Plan {
    /// Puts the rotation into numbers; gives the rotation that these make.
    fn turn(
        &mut self,
        spec: &CorrectionSpec,
        form: &Form,
        transform: &RigidTransform,
        mm: &Steps,
        deg: &Steps,
    ) -> Result<Matrix3<f64>, NotExpressible> {
        let r = &transform.rotation;
        let rad = |steps: i64| deg.value(steps).to_radians();
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        // Where a main program's end resets the rotation, the offset must do alone: what
        // that leaves is for the limit to judge.
        let lost = form.turn_ends_with_program && spec.ends_with == ProgramEnd::M30;
        match form.turn {
            Turn::No => {}
            _ if lost => {}
            Turn::Point | Turn::Origin => {
                let [_, _, c] = &mut self.angles;
                *c = deg.whole(transform.turn_and_tilt_deg().0)?;
                return Ok(about(&z, rad(*c)));
            }
            Turn::Axis => {
                let (angle, axis) = transform.angle_axis();
                let axis = axis.unwrap_or(z);
                self.axis = mm.whole_each(&(axis * (AXIS_MM / axis.amax())))?;
                let [_, _, c] = &mut self.angles;
                *c = deg.whole(angle.0.to_degrees())?;
                let written = mm.value_each(self.axis);
                let length = libm::sqrt(written.norm_squared());
                return Ok(about(&(written / length), rad(*c)));
            }
            Turn::Angles => {
                // R = Rz(c) Ry(b) Rx(a)
                let cosine = libm::hypot(r.m11, r.m21);
                if cosine.is_nan() || cosine < LEAST_COSINE {
                    return Err(NotExpressible);
                }
                let angles = [
                    libm::atan2(r.m32, r.m33),
                    libm::atan2(-r.m31, cosine),
                    libm::atan2(r.m21, r.m11),
                ];
                for (slot, angle) in self.angles.iter_mut().zip(angles) {
                    *slot = deg.whole(angle.to_degrees())?;
                }
                let [a, b, c] = self.angles.map(rad);
                return Ok(about(&z, c) * about(&y, b) * about(&x, a));
            }
        }
        // An axis is needed even where nothing turns.
        let [_, _, k] = &mut self.axis;
        *k = mm.whole(AXIS_MM)?;
        Ok(Matrix3::identity())
    }

    /// The numbers that the check value is made of.
    fn checked(&self, form: &Form) -> [i64; 9] {
        let [x, y, z] = self.shift;
        let ([u, v], [a, b, c]) = (self.point, self.angles);
        let [o, p, q] = match form.in_set {
            true => self.probed,
            false => [0; 3],
        };
        match form.turn {
            Turn::Angles => [x, y, z, a, b, c, o, p, q],
            _ => [x, y, z, u, v, c, o, p, q],
        }
    }
}

/// The rotation about a unit axis, right-handed (Rodrigues 1840).
fn about(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (sin, cos) = libm::sincos(angle);
    Matrix3::identity() * cos + axis.cross_matrix() * sin + axis * axis.transpose() * (1.0 - cos)
}

/// The eight corners of a box.
pub fn corners(
    min: &Vector3<f64>,
    max: &Vector3<f64>,
) -> impl Iterator<Item = Vector3<f64>> + use<> {
    let (min, max) = (*min, *max);
    (0u8..8).map(move |bits| {
        let pick = |bit: u8, low: f64, high: f64| if bits & bit == 0 { low } else { high };
        Vector3::new(
            pick(1, min.x, max.x),
            pick(2, min.y, max.y),
            pick(4, min.z, max.z),
        )
    })
}

/// Numbers of a control: whole multiples of a power of ten.
struct Steps {
    per_unit: f64,
    limit: f64,
}

impl Steps {
    fn new(decimals: u8, limit: f64) -> Self {
        Self {
            per_unit: f64::from(10u32.pow(u32::from(decimals))),
            limit,
        }
    }

    /// The nearest step, refused beyond the limit.
    fn whole(&self, value: f64) -> Result<i64, NotExpressible> {
        // Not `>`: a NaN is refused, too.
        if value.abs() <= self.limit {
            #[allow(clippy::cast_possible_truncation, reason = "just bounded")]
            Ok(libm::round(value * self.per_unit) as i64)
        } else {
            Err(NotExpressible)
        }
    }

    fn whole_each(&self, values: &Vector3<f64>) -> Result<[i64; 3], NotExpressible> {
        let [[x, y, z]] = values.data.0;
        Ok([self.whole(x)?, self.whole(y)?, self.whole(z)?])
    }

    #[allow(clippy::cast_precision_loss, reason = "bounded by `whole`")]
    fn value(&self, steps: i64) -> f64 {
        // Dividing by the whole number gives the nearest decimal fraction.
        steps as f64 / self.per_unit
    }

    fn value_each(&self, steps: [i64; 3]) -> Vector3<f64> {
        steps.map(|steps| self.value(steps)).into()
    }
}

#[cfg(test)]
mod tests;
