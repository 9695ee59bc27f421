//! Corrections in the words of a control.
//!
//! A correction is made in two steps. [`plan`] says what a dialect can express
//! of a registration and what it leaves at the part; [`write()`] turns a plan
//! into a program, and needs a [`Cleared`] for it: only a plate without any
//! reason against it yields one.
//!
//! # What `G10` and `G68` express
//!
//! The program was written for the nominal clamping, in the work offset with
//! origin `O`. The part now stands at `q = R p + t` in that same frame. With a
//! rotation about Z only, `Rz`, and the part's middle `c`:
//!
//! ```text
//! wanted     machine(p) = O + R p + t
//! possible   machine(p) = O' + c + Rz (p - c)          (G68 Xc Yc R)
//! choose     O' = O + R c + t - c
//! left over  (R - Rz) (p - c), and the rounding of O', c and the angle
//! ```
//!
//! Turning about the part's middle keeps the rounding of the angle (half of
//! 0.001 degree is 0.9 µm at 100 mm) and the tilt as small as they can be at
//! the part. The leftover is computed with the rounded numbers, at the part's
//! eight corners: it is linear in `p`, so no point of the part has more.

mod program;
pub mod rewrite;

use nalgebra::{Matrix3, Vector3};
use umi_protocol::job::{CorrectionSpec, Dialect, ProgramEnd};

use crate::registration::RigidTransform;
use crate::units::Mm;

pub use program::{Cleared, Figures, write};

/// What a dialect's numbers look like.
#[derive(Clone, Copy, Debug)]
struct Format {
    /// Smallest step of a length.
    increment_mm: f64,
    /// Smallest step of an angle.
    increment_deg: f64,
    /// Largest length that the control takes.
    limit_mm: f64,
}

/// The table of dialects.
const fn format(dialect: Dialect) -> Format {
    match dialect {
        // IS-B: 0.001 mm, 0.001 degree, five integer digits.
        Dialect::G10G68 => Format {
            increment_mm: 0.001,
            increment_deg: 0.001,
            limit_mm: 99_999.0,
        },
    }
}

/// Decimals of a `G10`/`G68` number; the increments above are 10^-3.
const DECIMALS: u32 = 3;

/// A correction in the control's increments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// The new work offset, 0.001 mm.
    origin_um: [i64; 3],
    /// Centre of the rotation, work coordinates, 0.001 mm.
    center_um: [i64; 2],
    /// Angle about Z, 0.001 degree.
    angle_mdeg: i64,
    /// Largest error left at the part's corners.
    pub leftover: Mm,
}

/// The numbers do not fit the control's format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotExpressible;

/// What `spec`'s dialect can express of `transform`, nominal to measured.
///
/// # Errors
/// [`NotExpressible`] if a number is not finite or too large for the control.
pub fn plan(spec: &CorrectionSpec, transform: &RigidTransform) -> Result<Plan, NotExpressible> {
    let format = format(spec.dialect);
    let RigidTransform {
        rotation,
        translation_mm,
    } = transform;
    let min = Vector3::from(spec.part_min_mm);
    let max = Vector3::from(spec.part_max_mm);
    let origin = Vector3::from(spec.probed_origin_mm);

    let middle = (min + max) * 0.5;
    let center_um = [steps(middle.x, &format)?, steps(middle.y, &format)?];
    let center = Vector3::new(
        millimetres(center_um[0], &format),
        millimetres(center_um[1], &format),
        middle.z,
    );

    // The rotation about Z that is nearest to R in the least-squares sense. A main
    // program's end (M30) resets G68, so there the offset must do alone: what it
    // leaves is for the limit to judge.
    let angle = match spec.ends_with {
        ProgramEnd::M99 => libm::atan2(rotation.m21 - rotation.m12, rotation.m11 + rotation.m22),
        ProgramEnd::M30 => 0.0,
    };
    let angle_mdeg = count(angle.to_degrees() / format.increment_deg)?;

    let new_origin = origin + rotation * center + translation_mm - center;
    let origin_um = [
        steps(new_origin.x, &format)?,
        steps(new_origin.y, &format)?,
        steps(new_origin.z, &format)?,
    ];

    // What the control will do, with the numbers as they are printed.
    let sent_origin = Vector3::new(
        millimetres(origin_um[0], &format),
        millimetres(origin_um[1], &format),
        millimetres(origin_um[2], &format),
    );
    #[allow(clippy::cast_precision_loss, reason = "below 2^53 by `count`")]
    let sent_angle = (angle_mdeg as f64 * format.increment_deg).to_radians();
    let (sin, cos) = libm::sincos(sent_angle);
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);

    let mut leftover_mm: f64 = 0.0;
    for corner in corners(&min, &max) {
        let wanted = origin + rotation * corner + translation_mm;
        let done = sent_origin + center + turn * (corner - center);
        let error_mm = libm::sqrt((done - wanted).norm_squared());
        // `max` would pass over a NaN.
        if error_mm.is_nan() || error_mm > leftover_mm {
            leftover_mm = error_mm;
        }
    }
    if !leftover_mm.is_finite() {
        return Err(NotExpressible);
    }
    Ok(Plan {
        origin_um,
        center_um,
        angle_mdeg,
        leftover: Mm(leftover_mm),
    })
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

/// A length in steps of the control.
fn steps(mm: f64, format: &Format) -> Result<i64, NotExpressible> {
    if mm.abs() > format.limit_mm {
        return Err(NotExpressible);
    }
    count(mm / format.increment_mm)
}

/// Steps as a length.
#[allow(clippy::cast_precision_loss, reason = "below 2^53 by `count`")]
fn millimetres(steps: i64, format: &Format) -> f64 {
    steps as f64 * format.increment_mm
}

/// The nearest whole number, refused where it could not be exact.
fn count(value: f64) -> Result<i64, NotExpressible> {
    const EXACT: f64 = 9.0e15;
    if value.is_finite() && value.abs() < EXACT {
        #[allow(clippy::cast_possible_truncation, reason = "just bounded")]
        Ok(libm::round(value) as i64)
    } else {
        Err(NotExpressible)
    }
}

#[cfg(test)]
mod tests;
