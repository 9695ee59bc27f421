//! Ball bars: the distance of two balls that a certificate says, beside the one that was found.
//!
//! The mount has no scale of its own, so the distance is not sought but looked at: the scales of the
//! axes, the sensor's distances and a workpiece frame that is none show in it.

use nalgebra::{DVector, Vector3};
use serde::Serialize;

use crate::ScanError;

/// A bar whose length is certified.
#[derive(Debug, Clone, PartialEq)]
pub struct BallBar {
    /// The features that its balls are in the observations.
    pub balls: [String; 2],
    /// From centre to centre, in mm.
    pub length_mm: f64,
    /// The most by which the length that is found may be off, in mm.
    pub within_mm: f64,
}

impl BallBar {
    /// From `A,B,LENGTH,WITHIN`.
    ///
    /// # Errors
    /// In words what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wanted =
            || "give two features, their distance and how far it may be off, as 0,1,249.53,0.01";
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        let &[a, b, length, within] = &cells[..] else {
            return Err(wanted().into());
        };
        let above_zero = |text: &str| {
            let value: Option<f64> = text.parse().ok();
            value
                .filter(|mm| mm.is_finite() && *mm > 0.0)
                .ok_or_else(wanted)
        };
        if a == b {
            return Err("a bar has two balls".into());
        }
        Ok(Self {
            balls: [a.to_owned(), b.to_owned()],
            length_mm: above_zero(length)?,
            within_mm: above_zero(within)?,
        })
    }
}

/// A bar beside its certificate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BarAnswer {
    /// Its balls.
    pub balls: [String; 2],
    /// As certified, from centre to centre.
    pub certified_mm: f64,
    /// As found.
    pub found_mm: f64,
    /// Found less certified.
    pub off_mm: f64,
    /// The standard uncertainty of what was found, by the residuals; none without degrees of freedom.
    pub u_mm: Option<f64>,
}

/// The length that was found between two centres, and how it changes with them.
pub(super) fn length(a: &Vector3<f64>, b: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let from = b - a;
    let mm = from.norm();
    (mm, from / mm.max(1e-300))
}

/// How a length changes with all unknowns, of which the centres stand first.
pub(super) fn gradient(along: &Vector3<f64>, places: [usize; 2], unknowns: usize) -> DVector<f64> {
    let mut gradient = DVector::zeros(unknowns);
    for (place, sign) in places.into_iter().zip([-1.0, 1.0]) {
        for i in 0..3 {
            gradient[3 * place + i] = sign * along[i];
        }
    }
    gradient
}

/// Refuses a length that is further off than allowed.
pub(super) fn refuse_off(bar: &BallBar, found: &BarAnswer) -> Result<(), ScanError> {
    if found.off_mm.abs() <= bar.within_mm {
        return Ok(());
    }
    let [a, b] = &bar.balls;
    let u = found.u_mm.map_or_else(String::new, |u| {
        format!(", with a standard uncertainty of {u:.4} mm by the residuals")
    });
    Err(ScanError::refused(
        "bar_length",
        format_args!(
            "balls {a} and {b} are {:.4} mm apart by this calibration{u}, and {} mm by the certificate \
             ({:+.4} mm; at most {} mm is allowed): look at the scales of the axes, their temperature \
             and the sensor's own scale",
            found.found_mm, bar.length_mm, found.off_mm, bar.within_mm
        ),
    )
    .with("balls", vec![a.clone(), b.clone()])
    .with("certified_mm", bar.length_mm)
    .with("found_mm", found.found_mm)
    .with("u_mm", found.u_mm))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_two_balls_a_length_and_a_limit() {
        let bar = BallBar::parse("0, B,249.53,0.01").unwrap();
        assert_eq!(bar.balls, ["0", "B"]);
        assert_eq!((bar.length_mm, bar.within_mm), (249.53, 0.01));
        for wrong in [
            "0,1,249",
            "0,0,249,0.1",
            "0,1,-1,0.1",
            "0,1,nan,1",
            "0,1,2,0",
            "0,1,2,3,4",
        ] {
            assert!(BallBar::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        let centres = [Vector3::new(1.0, -2.0, 3.0), Vector3::new(40.0, 5.0, -6.0)];
        let (mm, along) = length(&centres[0], &centres[1]);
        let gradient = gradient(&along, [1, 0], 7);
        for k in 0..7 {
            let mut moved = [centres[1], centres[0]];
            if k < 6 {
                moved[k / 3][k % 3] += 1e-6;
            }
            let (after, _) = length(&moved[1], &moved[0]);
            assert!((gradient[k] - (after - mm) / 1e-6).abs() < 1e-6, "{k}");
        }
    }
}
