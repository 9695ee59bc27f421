//! One observation that lies off all the rest: an angle that was written down wrong, a sample of a reflection.
//!
//! Each is left out alone. What its residuals `r` take from the sum of squares then is `rᵀ (1 - H)⁻¹ r`, with `H` its
//! block of the leverages; beside what is left, each by its degrees of freedom, that has an F distribution where it
//! belongs to the others (the externally studentised residual of Cook and Weisberg, Residuals and Influence in
//! Regression, 1982, section 2.2; for several rows together section 3.6). As many were tried as there are
//! (Bonferroni).

use nalgebra::{DMatrix, DVector};

use super::{ALARM, ROUNDING_MM, TAKEN, beyond_f};
use crate::calibrate::solve::Model;
use crate::calibrate::solve::scatter::whiten;

/// The observation that lies off the others.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::calibrate) struct Stray {
    /// Which, counted from 0.
    pub place: usize,
    /// What the others say less what it says, in mm, for each of its residuals.
    pub off_mm: DVector<f64>,
    /// Standard deviation of a residual of the others, in mm.
    pub others_mm: f64,
    /// The chance that the worst of so many lies so far off where all belong together.
    pub p: f64,
}

/// Looks for one among observations of `rows` residuals each, at the model's optimum. None where they belong together,
/// or where leaving one out leaves nothing to hold it against.
pub(in crate::calibrate) fn stray<M: Model>(model: &M, rows: usize) -> Option<Stray> {
    let (nuisances, targets) = model.unknowns();
    let whiten = whiten(model);
    let dof = model.residuals().checked_sub(whiten.nrows() + rows)?;
    let mut line = DVector::zeros(nuisances + targets);
    let mut own = DMatrix::zeros(whiten.nrows(), rows);
    let mut residuals = DVector::zeros(rows);
    let (mut ssq, mut place) = (0.0, 0);
    let mut worst: Option<(f64, usize, DVector<f64>)> = None;
    model.rows(&mut |value, derivatives| {
        line.fill(0.0);
        derivatives(line.as_mut_slice());
        own.set_column(place % rows, &(&whiten * &line));
        residuals[place % rows] = value;
        ssq += value * value;
        place += 1;
        if place % rows > 0 {
            return;
        }
        let left = DMatrix::identity(rows, rows) - own.tr_mul(&own);
        // One that alone decides an unknown cannot be off.
        let Some(left) = left
            .cholesky()
            .filter(|of| of.l_dirty().diagonal().min() > TAKEN.sqrt())
        else {
            return;
        };
        let off = left.solve(&residuals);
        let gain = residuals.dot(&off);
        if worst.as_ref().is_none_or(|(most, ..)| gain > *most) {
            worst = Some((gain, place / rows - 1, off));
        }
    });
    let (gain, which, off_mm) = worst?;
    // Rounding scatters by no law.
    let others_mm = ((ssq - gain).max(0.0) / dof.max(1) as f64)
        .sqrt()
        .max(ROUNDING_MM);
    let f = gain / rows as f64 / (others_mm * others_mm);
    let p = beyond_f(f, rows as f64, dof as f64) * (place / rows) as f64;
    (dof > 0 && p < ALARM).then_some(Stray {
        place: which,
        off_mm,
        others_mm,
        p,
    })
}
